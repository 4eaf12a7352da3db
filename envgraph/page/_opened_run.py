"""Describe a run that is open on the page: its members, the rules that made them, and the results of training."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from envgraph.errors import SHOWN
from envgraph.graph import value_text
from envgraph.page._certificate import certificate_of
from envgraph.page._pictures import draw_state
from envgraph.page._shown_model import ShownModel
from envgraph.page._work import JsonObject

if TYPE_CHECKING:
    from envgraph.search import Family, Member

_TRAINING_COLUMNS: Final = ("trained on", "kind", "agents", "success", "95 % interval", "mean return")
"""Columns of the table about a training."""


class OpenedRun:
    """A family with its run, if it was opened from one.

    Attributes:
        name: the name of the run or family.
        family: its members.
        path: the run store; None for a family file.
    """

    def __init__(self, name: str, family: Family, path: Path | None) -> None:
        self.name, self.family, self.path = name, family, path
        self._certificates = {one.name: certificate_of(one.certificates) for one in family.members if one.certificates}

    def show_member(self, name: str) -> ShownModel:
        """Return the model of a member, with the definitions of its run."""
        family = self.family
        member = family.member(name)
        return ShownModel(family.domain.engine(family.model(member)), member.name)

    def certificate(self, name: str) -> JsonObject | None:
        """Return the stored certificate of a member; None if it was not verified."""
        return self._certificates.get(self.family.member(name).name)

    def describe(self) -> JsonObject:
        """Return everything about the run for the page: measures, members, lineage, target, and training."""
        from envgraph.search import Outcome

        family = self.family
        outcome = Outcome.of(family)
        members = family.members[-SHOWN.rows :]  # the target is the last
        found: JsonObject = {
            "name": self.name,
            "family": family.name,
            "summary": str(outcome),
            "measures": [
                {"name": "members", "value": len(family.members)},
                {"name": "diversity", "value": outcome.diversity},
                *({"name": name, "value": value} for name, value in outcome.objective.items()),
            ],
            "members": [self.describe_member(one) for one in members],
            "target": self.describe_member(family.members[-1]),
            "training": list(self._training()),
        }
        return {**found, "lineage": self._lineage(members)}

    def describe_member(self, member: Member) -> JsonObject:
        """Return the picture, measures and certificate of a member."""
        from envgraph.search import format_measures

        family = self.family
        engine = family.domain.engine(family.model(member))
        measures = ", ".join(" ".join(fact) for fact in format_measures(family, member))
        return {
            "name": member.name,
            "title": f"{member.name}: {measures}" if measures else member.name,
            "initial": member.initial,
            **{key: value for key, value in draw_state(engine, family.domain.behaviour).items() if key != "dot"},
            "measures": dict(member.measures),
            "certificate": self._certificates.get(member.name),
        }

    def _lineage(self, members: tuple[Member, ...]) -> list[JsonObject]:
        """Return for each member the rules that led to it from the initial model; [] for a family file."""
        from envgraph.search import RunStore, lineage

        if self.path is None:
            return []
        found: list[JsonObject] = []
        with RunStore.open(self.path) as store:
            for member in members:
                assert member.individual is not None, "members of runs are individuals"
                steps = []
                for step in lineage(store, self.family.domain, member.individual):
                    values = (f"{name}={value_text(one)}" for name, one in step.match.items())
                    steps.append(f"{step.rule}({', '.join(values)})")
                found.append({"name": member.name, "steps": steps})
        return found

    def _training(self) -> Iterator[JsonObject]:
        """Yield a table for each budget of steps with which agents were trained on the run."""
        folder = None if self.path is None else self.path.parent / "training"
        files = [] if folder is None else sorted(folder.rglob("summary.csv"))
        for file in files:
            *student, budget = file.parent.relative_to(folder or file).parts
            if not budget.isdecimal():  # those of the stages of a curriculum
                continue
            with file.open(encoding="utf-8", newline="") as opened:
                rows = [_format_result(row) for row in csv.DictReader(opened)]
            title = ", ".join([f"{int(budget):,} steps on each environment", *student])
            yield {"title": title, "header": list(_TRAINING_COLUMNS), "rows": rows}


def _format_result(row: Mapping[str, str]) -> list[str]:
    """Return a row of a summary as texts for `_TRAINING_COLUMNS`."""
    success, low, high = (f"{float(row[name]):.1%}" for name in ("success_rate", "success_low", "success_high"))
    return [row["label"], row["kind"], row["runs"], success, f"{low} to {high}", f"{float(row['mean_return']):.3g}"]
