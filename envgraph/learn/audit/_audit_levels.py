"""Make the levels of an audit: mutations of the initial model, as tables, with the features that a student sees."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Final

import numpy as np
from numpy.random import Generator, SeedSequence, default_rng
from numpy.typing import NDArray

from envgraph.code import dataclass
from envgraph.env import Tabular
from envgraph.env.compiled import TableBuilder
from envgraph.errors import LIMITS, EvaluationError, InvalidArgument
from envgraph.files import replacement_draft
from envgraph.learn.audit._audit_settings import PROTOCOL, AuditSettings
from envgraph.learn.audit._state_features import Feature, StateFeatures
from envgraph.search import Domain, Variation
from envgraph.solve import optimal_return, steps_to_success
from envgraph.solve.learning import LevelTables

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class AuditLevels:
    """The levels of an audit. No two levels are the same model.

    Attributes:
        tables: the tables of all levels.
        optimum: float64 [levels], the greatest discounted return within the step limit.
        plan: int64 [levels], fewest steps to a success, 0 if there is none within the limit.
        training, probed, held_out, hard: int64, numbers of the levels: any levels for training and probing; solvable
            ones, and solvable ones with long plans, to test students on.
        drawn: number of models drawn, including those that were not valid or the same as an earlier one.
        numbers: int64 [levels], the number that seeds the drawing of each level.
        features: the feature that each input of a student means, in order.
    """

    tables: LevelTables
    optimum: NDArray[np.float64]
    plan: NDArray[np.int64]
    training: NDArray[np.int64]
    probed: NDArray[np.int64]
    held_out: NDArray[np.int64]
    hard: NDArray[np.int64]
    drawn: int
    numbers: NDArray[np.int64]
    features: tuple[Feature, ...] = ()

    @property
    def solvable(self) -> NDArray[np.bool_]:
        """Return bool [levels]: True if an episode can end in success."""
        return self.plan > 0

    def save(self, path: Path) -> None:
        """Write the levels to a file atomically."""
        tables = self.tables
        arrays = {f"tables_{one.name}": array for one, array in zip(fields(tables), tables.arrays, strict=False)}
        sizes = np.array([tables.inputs, tables.actions, tables.width, self.drawn])
        own = {name: getattr(self, name) for name in _SAVED_ARRAYS}
        with replacement_draft(path) as draft, draft.open("wb") as file:
            features = np.array(json.dumps(self.features))
            np.savez(file, allow_pickle=False, sizes=sizes, features=features, **arrays, **own)

    @classmethod
    def load(cls, path: Path) -> AuditLevels:
        """Read the levels from a file.

        Raises:
            InvalidArgument: the file cannot be read, or has another form.
        """
        try:
            with np.load(path, allow_pickle=False) as file:
                found = dict(file.items())
            *sizes, drawn = found.pop("sizes").tolist()
            features = tuple((name, tuple(row)) for name, row in json.loads(found.pop("features").item()))
            arrays = {name.removeprefix("tables_"): found.pop(name) for name in [*found] if name.startswith("tables_")}
            tables = LevelTables(**arrays, inputs=sizes[0], actions=sizes[1], width=sizes[2])
            return cls(tables, drawn=drawn, features=features, **found)
        except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
            raise InvalidArgument(
                f"{path}: the file does not contain the levels of an audit; remove it to make them again"
            ) from error


_SAVED_ARRAYS: Final = "optimum", "plan", "training", "probed", "held_out", "hard", "numbers"


@dataclass(frozen=True, slots=True)
class AuditLevel:
    tabular: Tabular
    seen: list[list[int]]
    plan: int
    optimum: float


class LevelGenerator:
    """A generator of levels. Each level depends only on its number, not on how many levels are drawn.

    Attributes:
        engine: the engine with the model of the level that was made last.
        features: the features of the states of all levels so far.
    """

    def __init__(self, domain: Domain, settings: AuditSettings) -> None:
        self._settings, self._domain = settings, domain
        problem = domain.problem(domain.engine())
        how = domain.settings()
        self._bounds = how.initial_applications
        self._variation = Variation(problem, how.max_attempts)
        self.engine = problem.engine
        self._origin = self.engine.commit()
        self._keys = domain.keys()
        assert domain.behaviour is not None, "the settings were checked"
        self._tables = TableBuilder(domain.behaviour, LIMITS["level states"])
        self.features = StateFeatures(domain, self.engine, self._keys, settings)
        self._hashes: set[int] = set()

    def draw(self, number: int) -> tuple[Tabular, int] | None:
        """Make the level of a number; return its table and shortest plan in steps, or None if invalid or not new."""
        return self.table_if_new() if self.make_model(number) else None

    def make_model(self, number: int) -> bool:
        """Make the model of a level number from the initial model; return False if no valid model is found."""
        self.engine.checkout(self._origin, discard=True)
        rng = default_rng(SeedSequence(self._domain.spec.seed, spawn_key=(number,)))
        return self.mutate(rng, self._bounds)

    def mutate(self, rng: Generator, bounds: tuple[int, int]) -> bool:
        """Apply `bounds[0]` to `bounds[1]` mutation rules to the model; on failure, restore it and return False."""
        variation = self._variation
        return variation.vary_until_valid(rng, lambda rng: variation.apply_several(rng, bounds)) is not None

    def table_if_new(self) -> tuple[Tabular, int] | None:
        """Record the current model; return its table and shortest plan (0: none), or None if recorded before."""
        if not self.is_new_model():
            return None
        tabular = self._tables.build(self.engine, self._keys)
        steps = steps_to_success(tabular)[tabular.start_states[tabular.start_probability > 0.0]].min()
        return tabular, int(steps) if steps <= min(tabular.n_states, self._settings.policy.limit) else 0

    def is_new_model(self) -> bool:
        """Record the current model; return True if no equal model was recorded before."""
        found = self.engine.model.state_hash()
        known = found in self._hashes
        self._hashes.add(found)
        return not known

    def make_level(self, tabular: Tabular, plan: int) -> AuditLevel:
        """Return the level of the current model, with its features and its optimum."""
        policy, scale = self._settings.policy, self._settings.scale
        optimum = optimal_return(tabular, policy.limit, discount=policy.discount) * scale
        return AuditLevel(tabular, self.features.features_of(tabular), plan, optimum)


def make_levels(domain: Domain, settings: AuditSettings, progress: Progress = lambda done, total: None) -> AuditLevels:
    """Draw the levels of an audit: first those for training, then those for probing, then those for tests.

    Raises:
        EvaluationError: too few levels are different, or solvable.
    """
    maker = LevelGenerator(domain, settings)
    levels: list[AuditLevel] = []
    numbers: list[int] = []
    groups = _LevelGroups(settings)
    number = -1
    while not groups.is_full:
        number += 1
        if number > PROTOCOL.patience * groups.total:
            raise _too_few_levels(groups, domain)
        drawn = maker.draw(number)
        group = None if drawn is None else groups.group_for(drawn[1])
        if drawn is None or group is None:
            continue
        group.append(len(levels))
        levels.append(maker.make_level(*drawn))
        groups.plans.append(drawn[1])
        numbers.append(number)
        progress(len(levels), groups.total)
    return AuditLevels(
        tables=join_tables(levels, len(maker.features.numbers), settings.scale),
        optimum=np.array([level.optimum for level in levels]),
        plan=np.array(groups.plans, np.int64),
        **{name: np.array(places, np.int64) for name, places in groups.places.items()},
        drawn=number + 1,
        numbers=np.array(numbers, np.int64),
        features=tuple(maker.features.numbers),
    )


class _LevelGroups:
    """The groups of levels of an audit, filled one after the other.

    Attributes:
        places: numbers of the levels of each group.
        plans: the shortest plan of each level that was added.
        total: number of levels needed in all.
    """

    def __init__(self, settings: AuditSettings) -> None:
        self._sizes = {
            "training": settings.levels,
            "probed": settings.probed,
            "held_out": settings.held_out,
            "hard": settings.held_out // 2,
        }
        self.places: dict[str, list[int]] = {name: [] for name in self._sizes}
        self.plans: list[int] = []
        self.total = sum(self._sizes.values())
        self._least: float | None = None

    @property
    def is_full(self) -> bool:
        """Return True if all groups are full."""
        return len(self.plans) == self.total

    def group_for(self, plan: int) -> list[int] | None:
        """Return the level numbers of the group that needs a level with this shortest plan (0: unsolvable); or None."""
        name = next(name for name, size in self._sizes.items() if len(self.places[name]) < size)
        if name in ("held_out", "hard") and not plan:
            return None
        if name == "hard":
            if self._least is None:
                self._least = float(np.quantile([self.plans[one] for one in self.places["held_out"]], PROTOCOL.hard))
            if plan <= self._least:
                return None
        return self.places[name]


def _too_few_levels(groups: _LevelGroups, domain: Domain) -> EvaluationError:
    found = ", ".join(f"{len(one):,} {name.replace('_', '-')}" for name, one in groups.places.items())
    span = domain.spec.audit.span() if domain.spec.audit else None
    hint = "widen `initial_applications` of `[mutation]`, or ask for fewer `levels` and `held_out` in `[audit]`"
    return EvaluationError(f"the mutation rules make too few different levels: {found}", span, hint)


def join_tables(levels: Sequence[AuditLevel], inputs: int, scale: float, width: int = 1) -> LevelTables:
    """Return the tables of levels joined into one, in order, with the features of their states as inputs."""
    tables, seen = [level.tabular for level in levels], [level.seen for level in levels]
    return LevelTables.of(tables, seen, inputs=inputs, scale=scale, width=width)
