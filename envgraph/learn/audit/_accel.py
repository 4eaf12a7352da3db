"""Make new levels by applying mutation rules to others: the editor of ACCEL (Parker-Holder et al. 2022)."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from envgraph.graph import Version
from envgraph.learn.audit._audit_levels import AuditLevel, AuditLevels, LevelGenerator, join_tables
from envgraph.learn.audit._audit_settings import AuditSettings
from envgraph.search import Domain
from envgraph.solve.learning import PolicyLearner

EDITS: Final = (1, 5)
"""Minimum and maximum number of mutation rules that are applied to a level."""


class LevelEditor:
    """A function that makes new valid levels from others, as versions of the model. No new level is a test level.

    The model of a training level is made again from its number when it is first edited. Features that occur in no
    training level are hidden from the student.

    Args:
        domain: the domain, with its mutation rules and constraints.
        settings: the settings of the audit.
        levels: the levels of the audit.
        student: a student that gets the tables of new levels.

    Attributes:
        levels: the levels of the audit, then the new ones.
    """

    def __init__(self, domain: Domain, settings: AuditSettings, levels: AuditLevels, student: PolicyLearner) -> None:
        self.levels, self._student, self._scale = levels, student, settings.scale
        self._maker = LevelGenerator(domain, settings)
        self._maker.features.numbers.update({one: place for place, one in enumerate(levels.features)})
        self._versions: dict[int, Version] = {}
        for level in np.concatenate([levels.probed, levels.held_out, levels.hard]).tolist():
            self._maker.make_model(int(levels.numbers[level]))
            self._maker.is_new_model()

    def __call__(self, parents: NDArray[np.int64], rng: Generator) -> NDArray[np.int64]:
        """Return the number of a new child of each parent, or the parent's own number if no edit makes a new level.

        New children are added to `levels`, and the student gets the extended tables.
        """
        made: list[AuditLevel] = []
        before, found = len(self.levels.plan), parents.copy()
        for place, parent in enumerate(parents.tolist()):
            child = self._make_child(parent, rng, before + len(made))
            if child is not None:
                found[place] = before + len(made)
                made.append(child)
        if made:
            self._add_levels(made)
        return found

    def _make_child(self, parent: int, rng: Generator, number: int) -> AuditLevel | None:
        maker, tables = self._maker, self.levels.tables
        maker.engine.checkout(self._version_of(parent), discard=True)
        taken = maker.table_if_new() if maker.mutate(rng, EDITS) else None
        if taken is None or taken[0].next_state.shape[2] > tables.width:
            return None
        self._versions[number] = maker.engine.commit()
        level = maker.make_level(*taken)
        return replace(level, seen=[[one for one in row if one < tables.inputs] for row in level.seen])

    def _version_of(self, level: int) -> Version:
        if level not in self._versions:
            self._maker.make_model(int(self.levels.numbers[level]))
            self._versions[level] = self._maker.engine.commit()
        return self._versions[level]

    def _add_levels(self, new_levels: list[AuditLevel]) -> None:
        levels = self.levels
        new = join_tables(new_levels, levels.tables.inputs, self._scale, levels.tables.width)
        self.levels = replace(
            levels,
            tables=levels.tables.extended_by(new),
            optimum=np.append(levels.optimum, [level.optimum for level in new_levels]),
            plan=np.append(levels.plan, [level.plan for level in new_levels]),
        )
        self._student.replace_levels(self.levels.tables)
