"""Families: the environments that a run made or a file holds, and everything needed to rebuild them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from envgraph.env import Behaviour, Explored, KeyIndex, Scene, scene_of
from envgraph.errors import Diagnostic, EnvgraphError, InvalidArgument, LoadError, did_you_mean
from envgraph.graph import Model, model_from_json, model_to_json
from envgraph.lang import FORMATS, Bundle, DiskFiles, file_format, parse_json, read_source
from envgraph.search._components import Components
from envgraph.search._domain import Domain
from envgraph.search._shown import family_html, member_html, member_svg, member_text
from envgraph.search._store import RunStore, dump_json
from envgraph.search._tables import Progress, Tables

FORMAT = "envgraph-family-1"


@dataclass(frozen=True, slots=True)
class Member:
    """One environment of a family.

    Attributes:
        name: "E1" for the first in the order of the curriculum, and so on.
        measures: value of every measure, by name.
        model: its model, as JSON text.
        individual: id in the run store, or None.
        initial: whether it is the initial model.
    """

    name: str
    measures: Mapping[str, float]
    model: str
    individual: int | None = None
    initial: bool = False
    _family: Family | None = field(default=None, compare=False, repr=False)

    def _repr_html_(self) -> str | None:
        return None if self._family is None else member_html(self._family, self)


@dataclass(frozen=True)
class Family:
    """Environments in the order of the curriculum, with the texts of their domain.

    Attributes:
        name: of the family.
        bundle: the texts of the domain; the first root is the family file.
        members: from the easiest to the hardest by the measure that orders the curriculum, then the initial model.
        domain: what the texts say, with the overrides.
        overrides: seed, generations and population of the run where they are not those of the family file.
        tables: where the states of the members are kept once they have been enumerated.
    """

    name: str
    bundle: Bundle
    members: tuple[Member, ...]
    domain: Domain = field(compare=False, repr=False)
    overrides: Mapping[str, int] = field(default_factory=dict)
    tables: Tables = field(default_factory=Tables.of_user, compare=False, repr=False)
    _explored: dict[tuple[str, bool], Explored] = field(default_factory=dict, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "members", tuple(replace(one, _family=self) for one in self.members))

    @cached_property
    def keys(self) -> KeyIndex:
        """Indices of objects that mean the same in every member."""
        return self.domain.keys(*(self.model(member) for member in self.members))

    @property
    def behaviour(self) -> Behaviour:
        """What the agent can do.

        Raises:
            InvalidArgument: the family has no environment.
        """
        behaviour = self.domain.behaviour
        if behaviour is None:
            raise InvalidArgument(f"family `{self.name}` has no environment: its family file names none")
        return behaviour

    @property
    def limit(self) -> int | None:
        """Steps after which an episode is truncated, or None."""
        return self.domain.spec.limit or self.behaviour.limit

    def member(self, variant: int | str | None = None) -> Member:
        """A member by its name, or by its number from 1; the last one, the target, for None.

        Raises:
            InvalidArgument: there is no such member.
        """
        if variant is None:
            return self.members[-1]
        names = [member.name for member in self.members]
        text = str(variant)
        if text in names:
            return self.members[names.index(text)]
        if text.isdecimal() and 1 <= int(text) <= len(names):
            return self.members[int(text) - 1]
        hint = did_you_mean(text, names) or f"there are {', '.join(names)}"
        raise InvalidArgument(f"family `{self.name}` has no environment `{variant}`; {hint}")

    def model(self, member: Member) -> Model:
        """A fresh copy of a member's model."""
        return model_from_json(member.model, self.domain.metamodel, file=f"{self.name}/{member.name}")

    def explored(
        self, member: Member, *, pictures: bool = False, progress: Progress | None = None
    ) -> Explored:
        """The table of a member's reachable states, enumerated when it is first asked for and then kept in `tables`.

        Args:
            member: of this family.
            pictures: whether there is to be a scene of every state, if the behaviour says how to draw it.
            progress: called with the number of states found so far, now and then; not if the table is known.

        Raises:
            InvalidArgument: the family has no environment.
            EvaluationError: there are too many states.
        """
        name, kept = member.name, self._explored
        known = kept.get((name, True)) or kept.get((name, pictures))
        if known is None:
            behaviour = self.behaviour  # raises where there is none
            known = self._explored[name, pictures] = self.tables.explored(
                self.domain, behaviour, self.model(member), self.keys, pictures=pictures, progress=progress
            )
        return known

    def scene(self, member: Member) -> Scene | None:
        """The picture of a member, or None where the behaviour says nothing about drawing."""
        behaviour = self.domain.behaviour
        if behaviour is None or behaviour.draw is None:
            return None
        return scene_of(self.model(member), behaviour.draw, behaviour.parameters)

    def svg(self, member: Member) -> str:
        """A picture of a member: as its behaviour says how to draw, else as boxes and lines."""
        return member_svg(self, member)

    def text(self, member: Member) -> str:
        """The same in letters."""
        return member_text(self, member)

    def _repr_html_(self) -> str:
        return family_html(self)

    def class_counts(self) -> dict[str, tuple[int, ...]]:
        """Number of objects of each class in every member, for the classes in which the members differ."""
        models = [self.model(member) for member in self.members]
        classes = [cls.name for cls in self.domain.metamodel.class_list if not cls.abstract]
        counts = {cls: tuple(len(model.exact_extent(cls)) for model in models) for cls in classes}
        return {cls: numbers for cls, numbers in counts.items() if len(set(numbers)) > 1}

    def diversity(self) -> float:
        """The family measure over the members."""
        problem = self.domain.problem(self.domain.engine())
        return problem.diversity.score([member.measures[problem.diversity_of] for member in self.members])


def ordered(
    domain: Domain, found: Sequence[tuple[Mapping[str, float], str, int | None, bool]]
) -> tuple[Member, ...]:
    """Members from measures, model, individual and initial flag, in the order of the curriculum.

    The initial model comes last, as the target, or last among its equals where the family file wants it `ordered`.
    Equal values keep the given order.
    """
    curriculum = domain.spec.curriculum
    measure = str(curriculum.order or domain.spec.diversity.options["of"])
    last = curriculum.initial == "last"
    ranked = sorted(found, key=lambda one: (last and one[3], one[0][measure], one[3]))
    return tuple(Member(f"E{place}", *one) for place, one in enumerate(ranked, start=1))


def run_file(location: str | Path, directory: Path = Path("runs")) -> Path:
    """Where a run store is: `location` may be the file, its directory, or the name of a run below `directory`.

    Raises:
        InvalidArgument: there is no such run.
    """
    path = Path(location)
    for candidate in (path, path / "run.sqlite", directory / path / "run.sqlite"):
        if candidate.is_file():
            return candidate
    known = sorted(file.parent.name for file in directory.glob("*/run.sqlite") if file.is_file())
    there_are = f"there are {', '.join(known)}" if known else "`envgraph generate` makes one"
    hint = did_you_mean(str(location), known) or there_are
    raise InvalidArgument(f"there is no run `{location}` in {directory}; {hint}")


def open_family(
    location: str | Path, directory: Path = Path("runs"), components: Components | None = None
) -> Family:
    """The family of a run store or of a family file.

    Args:
        location: a run store, its directory, the name of a run below `directory`, or a family file (.json).
        directory: where runs are kept.
        components: what the names in the domain's family file mean; by default the ones that come with envgraph.

    Raises:
        InvalidArgument: there is no such run or file, or the run has no family yet.
        LoadError: the file is no family file.
    """
    format = file_format(DiskFiles(), str(location))
    if format in ("family", "json"):
        return read_family(Path(location), components)
    if format != "sqlite" and Path(location).is_file():
        what = FORMATS[format] if format else "of no format that is known"
        raise InvalidArgument(f"`{location}` is {what}, not a run (run.sqlite) or a family as JSON")
    with RunStore.open(run_file(location, directory)) as store:
        settings = store.settings()
        domain = Domain.from_bundle(store.bundle(), components)
        return family_of(store, domain.with_overrides(settings.get("overrides", {})))


def family_of(store: RunStore, domain: Domain) -> Family:
    """The family of the last generation of a run, of the domain whose texts it keeps.

    Raises:
        InvalidArgument: the run has no generation yet.
    """
    last = store.last_generation()
    if last is None:
        raise InvalidArgument(f"{store.path} has no generation yet: `envgraph generate --resume` goes on")
    settings = store.settings()
    found = []
    for id_ in last.members:
        individual = store.individual(id_)
        model = individual.model or _replayed(domain, store, id_)
        found.append(
            (individual.measures, model, id_, individual.parent is None and not settings.get("imported"))
        )
    name, overrides = str(settings.get("name", "family")), settings.get("overrides", {})
    tables = Tables.of_run(store.path)
    return Family(name, store.bundle(), ordered(domain, found), domain, overrides, tables)


def _replayed(domain: Domain, store: RunStore, id_: int) -> str:
    engine = domain.engine()
    for ancestor in store.lineage(id_):
        engine.replay(ancestor.trace)
    return dump_json(model_to_json(engine.model))


def write_family(family: Family) -> str:
    """The text of a family file: texts of the domain and models of the members, one JSON document."""
    document = {
        "format": FORMAT,
        "name": family.name,
        "roots": list(family.bundle.roots),
        "texts": dict(family.bundle.texts),
        "overrides": dict(family.overrides),
        "keys": family.keys.to_json(),
        "members": [
            {
                "name": member.name,
                "initial": member.initial,
                "measures": dict(member.measures),
                "model": json.loads(member.model),
            }
            for member in family.members
        ],
    }
    return json.dumps(document, ensure_ascii=False, indent=1) + "\n"


def read_family(path: Path, components: Components | None = None) -> Family:
    """Read what `write_family` wrote; `components` as for `open_family`.

    Raises:
        LoadError: the file is missing, or no family file.
    """
    value, spans = parse_json(read_source(DiskFiles(), str(path)))
    try:
        return _family(value, components)
    except (KeyError, TypeError, AttributeError) as error:
        raise LoadError([Diagnostic("bad-format", "this is no family file", spans[()], _WRITTEN)]) from error
    except EnvgraphError as error:
        if isinstance(error, LoadError):
            raise
        raise LoadError([Diagnostic("bad-format", str(error), spans[()], _WRITTEN)]) from error


_WRITTEN = "`envgraph export RUN -o family.json` writes one; `envgraph import` reads ga4cl files"


def _family(value: Any, components: Components | None) -> Family:
    if value["format"] != FORMAT:
        raise InvalidArgument(f"format {value['format']!r} is not {FORMAT!r}")
    bundle = Bundle(tuple(value["roots"]), {str(name): str(text) for name, text in value["texts"].items()})
    members = tuple(
        Member(
            str(entry["name"]),
            {str(name): float(measure) for name, measure in entry["measures"].items()},
            dump_json(entry["model"]),
            initial=bool(entry["initial"]),
        )
        for entry in value["members"]
    )
    if not members:
        raise InvalidArgument("the family is empty")
    overrides = {str(name): int(number) for name, number in value["overrides"].items()}
    domain = Domain.from_bundle(bundle, components).with_overrides(overrides)
    family = Family(str(value["name"]), bundle, members, domain, overrides)
    stored = KeyIndex.from_json(value["keys"], family.domain.metamodel)
    if stored != family.keys:
        raise InvalidArgument("the keys are not those of the members")
    return family
