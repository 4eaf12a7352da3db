"""The levels of an audit: what the mutation rules make of the initial model, as tables, with what a student sees."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import prod
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.random import SeedSequence, default_rng
from numpy.typing import NDArray

from envgraph.behaviour import ObserveFind, ObserveObject
from envgraph.code import dataclass
from envgraph.env import KeyIndex, Tabular, key_reader
from envgraph.env.compiled import Tables
from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.files import replacing
from envgraph.learn.audit._settings import AuditSettings
from envgraph.match import FREE
from envgraph.metamodel import Value
from envgraph.pattern import ObjectType
from envgraph.rewrite import Engine
from envgraph.search import Domain, Variation
from envgraph.solve import optimal_return, steps_to_success
from envgraph.solve.learning import LevelTables

MOST_STATES: Final = 20_000
"""Of a level."""

HARD: Final = 0.8
"""A level is hard whose shortest plan is longer than those of so many of the held-out levels."""

PATIENCE: Final = 20
"""So many times as many levels are drawn as are wanted, until it is said that there are too few."""

Feature = tuple[str, tuple[Value, ...]]
"""What may be seen: what it is about, and the values."""

_View = tuple[str, str, tuple[object, ...], list[tuple[int, Callable[[int], Any]]]]
"""A pattern's name in the settings and its full name, arguments that ask for all rows, and which values of its rows are
objects, with what reads their keys."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class AuditLevels:
    """All levels of an audit; no two are the same model.

    Attributes:
        tables: of the levels.
        optimum: float64 [levels], the greatest discounted return within the limit.
        plan: int64 [levels], fewest steps to a success, 0 where there are none within the limit.
        training, probed, held_out, hard: int64, which levels they are: any for training and probing, solvable ones to
            be tested on, and solvable ones with long plans.
        drawn: how many models were drawn; the others were the same as one before, or not valid.
    """

    tables: LevelTables
    optimum: NDArray[np.float64]
    plan: NDArray[np.int64]
    training: NDArray[np.int64]
    probed: NDArray[np.int64]
    held_out: NDArray[np.int64]
    hard: NDArray[np.int64]
    drawn: int

    @property
    def solvable(self) -> NDArray[np.bool_]:
        """Of each level, whether an episode can end in success."""
        return self.plan > 0

    def save(self, path: Path) -> None:
        """Write a file, as a whole or not at all."""
        tables = self.tables
        names = (
            "first",
            "start_first",
            "starts",
            "start_chance",
            "to",
            "chance",
            "reward",
            "ended",
            "seen_first",
            "seen",
        )
        arrays = {f"tables_{name}": array for name, array in zip(names, tables.arrays, strict=True)}
        sizes = np.array([tables.inputs, tables.actions, tables.width, self.drawn])
        own = {name: getattr(self, name) for name in _OWN}
        with replacing(path) as draft, draft.open("wb") as file:
            np.savez(file, allow_pickle=False, sizes=sizes, **arrays, **own)

    @classmethod
    def load(cls, path: Path) -> AuditLevels:
        """Read a file.

        Raises:
            InvalidArgument: it cannot be read as such a file.
        """
        try:
            with np.load(path, allow_pickle=False) as file:
                found = dict(file.items())
            *sizes, drawn = found.pop("sizes").tolist()
            arrays = {
                name.removeprefix("tables_"): found.pop(name)
                for name in [*found]
                if name.startswith("tables_")
            }
            return cls(
                LevelTables(**arrays, inputs=sizes[0], actions=sizes[1], width=sizes[2]), drawn=drawn, **found
            )
        except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
            raise InvalidArgument(f"{path}: not the levels of an audit") from error


_OWN: Final = "optimum", "plan", "training", "probed", "held_out", "hard"


@dataclass(frozen=True, slots=True)
class _Level:
    tabular: Tabular
    seen: list[list[int]]
    plan: int
    optimum: float


class Sight:
    """What a student sees of the states of a level: a set of features, each of which holds or not.

    For an object that the environment observes they are the rows, without their first value, that the patterns of
    `sees` have with it in the initial model of the level; of an object for which no pattern is named, it is which one
    it is. Every other observed value but the first of its range is a feature of its own. The rows of the patterns of
    `knows` hold in all states of the level.

    Args:
        domain: of the levels.
        engine: its model is a level, whenever it is asked.
        keys: the indices of objects.
        settings: has the patterns.

    Attributes:
        features: all that were seen, by their number.
    """

    def __init__(self, domain: Domain, engine: Engine, keys: KeyIndex, settings: AuditSettings) -> None:
        self._engine, self._keys = engine, keys
        self._sees = [self._view(name, 1) for name in settings.sees]
        self._knows = [self._view(name, 0) for name in settings.knows]
        self._components = [*_components(domain, engine, keys)]
        self.features: dict[Feature, int] = {}

    def of(self, tabular: Tabular) -> list[list[int]]:
        """The features of each state of the present model's table."""
        values = _decoded(tabular)
        known = [self._number(name, row) for name, rows in self._rows(self._knows) for row in rows]
        around: dict[Value, list[tuple[str, tuple[Value, ...]]]] = {}
        for name, rows in self._rows(self._sees):
            for first, *rest in rows:
                around.setdefault(first, []).append((name, tuple(rest)))
        columns = []
        for place, cls in enumerate(self._components):
            objects = self._keys.objects(self._engine.model, cls) if cls else ()
            found: dict[int, list[int]] = {}
            for value in np.unique(values[:, place]).tolist():
                if cls and self._anchored(cls):
                    node = objects[value] if value < len(objects) else None
                    facts = around.get(node, []) if node is not None else [("none", ())]
                    found[value] = [self._number(f"{place}:{name}", row) for name, row in facts]
                else:
                    found[value] = [self._number(f"{place}", (value,))] if value or cls else []
            columns.append([found[value] for value in values[:, place].tolist()])
        return [sum(parts, known) for parts in zip(*columns, strict=True)]

    def _number(self, name: str, row: tuple[Value, ...]) -> int:
        return self.features.setdefault((name, row), len(self.features))

    def _rows(self, patterns: Sequence[_View]) -> Iterator[tuple[str, list[tuple[Value, ...]]]]:
        matcher = self._engine.matcher
        for name, qualified, free, objects in patterns:
            rows = matcher.rows(qualified, free)
            yield name, [_renamed(row, objects) for row in rows] if objects else [*map(tuple, rows)]

    def _view(self, name: str, first: int) -> _View:
        """A pattern; objects in its rows, from the first place on, are named by their keys, the same in all levels."""
        library = self._engine.library
        qualified = (library.resolve(name) or library.get(name)).qualified_name
        types = library.parameter_types(qualified)
        objects = [
            (place, key_reader(self._engine.model, one.cls))
            for place, one in enumerate(types)
            if place >= first and isinstance(one, ObjectType)
        ]
        return name, qualified, (FREE,) * len(types), objects

    def _anchored(self, cls: str) -> bool:
        library, metamodel = self._engine.library, self._engine.model.metamodel
        for _, qualified, *_ in self._sees:
            first = library.parameter_types(qualified)[0]
            if isinstance(first, ObjectType) and (
                metamodel.covers(first.cls, cls) or metamodel.covers(cls, first.cls)
            ):
                return True
        return False


def _renamed(row: Sequence[Value], objects: Sequence[tuple[int, Callable[[int], Any]]]) -> tuple[Value, ...]:
    named = list(row)
    for place, read in objects:
        node = row[place]
        assert type(node) is int, "an object"
        named[place] = str(read(node))
    return tuple(named)


def _components(domain: Domain, engine: Engine, keys: KeyIndex) -> Iterator[str | None]:
    """Of each component of an observation the class of the objects that it is an index of, or None."""
    behaviour = domain.behaviour
    assert behaviour is not None, "the settings were checked"
    for one in behaviour.observations:
        each = None if isinstance(one, ObserveFind) else one.each
        times = keys.size(each.type) if each and each.type else 1
        yield from [one.among if isinstance(one, ObserveObject) else None] * times


def _decoded(tabular: Tabular) -> NDArray[np.int64]:
    """The components of the observation of each state [states, components]."""
    rest, columns = tabular.observation, []
    for size in tabular.observation_shape:
        columns.append(rest % size)
        rest = rest // size
    return np.stack(columns, axis=1)


class _Maker:
    """Draws levels, each from numbers of its own, so that a level is the same however many there are."""

    def __init__(self, domain: Domain, settings: AuditSettings) -> None:
        self._settings, self._domain = settings, domain
        problem = domain.problem(domain.engine())
        how = domain.settings()
        self._bounds = how.initial_applications
        self._variation = Variation(problem, how.max_attempts)
        self._engine = problem.engine
        problem.valid()  # from the first question on patterns are kept current, unless a version is held by then
        self._origin = self._engine.commit()
        self._keys = domain.keys()
        assert domain.behaviour is not None, "the settings were checked"
        self._tables = Tables(domain.behaviour, MOST_STATES)
        self.sight = Sight(domain, self._engine, self._keys, settings)
        self._hashes: set[int] = set()

    def draw(self, number: int) -> tuple[Tabular, int] | None:
        """The table of a number's level and its shortest plan; None if it is no level, or one that there was before."""
        engine = self._engine
        rng = default_rng(SeedSequence(self._domain.spec.seed, spawn_key=(number,)))
        engine.checkout(self._origin, discard=True)
        if self._variation.attempts(rng, lambda rng: self._variation.several(rng, self._bounds)) is None:
            return None
        found = engine.model.state_hash()
        if found in self._hashes:
            return None
        self._hashes.add(found)
        tabular = self._tables.table(engine, self._keys)
        steps = steps_to_success(tabular)[tabular.start_states[tabular.start_probability > 0.0]].min()
        return tabular, int(steps) if steps <= min(tabular.n_states, self._settings.policy.limit) else 0

    def keep(self, tabular: Tabular, plan: int) -> _Level:
        """The level that was drawn last, with all that is asked of it."""
        policy, scale = self._settings.policy, self._settings.scale
        optimum = optimal_return(tabular, policy.limit, discount=policy.discount) * scale
        return _Level(tabular, self.sight.of(tabular), plan, optimum)


def make_levels(
    domain: Domain, settings: AuditSettings, progress: Progress = lambda done, total: None
) -> AuditLevels:
    """Draw the levels of an audit: first those for training, then those for probing, then those for tests.

    Raises:
        EvaluationError: too few levels are different, or solvable.
    """
    maker = _Maker(domain, settings)
    levels: list[_Level] = []
    groups = _Groups(settings)
    number = -1
    while not groups.full:
        number += 1
        if number > PATIENCE * groups.total:
            raise _too_few(groups, domain)
        drawn = maker.draw(number)
        group = None if drawn is None else groups.wants(drawn[1])
        if drawn is None or group is None:
            continue
        group.append(len(levels))
        levels.append(maker.keep(*drawn))
        groups.plans.append(drawn[1])
        progress(len(levels), groups.total)
    return AuditLevels(
        tables=_joined(levels, len(maker.sight.features), settings.scale),
        optimum=np.array([level.optimum for level in levels]),
        plan=np.array(groups.plans, np.int64),
        **{name: np.array(places, np.int64) for name, places in groups.places.items()},
        drawn=number + 1,
    )


class _Groups:
    """What levels are for, filled one group after the other.

    Attributes:
        places: the levels of each group.
        plans: the shortest plan of each level that was kept.
        total: levels that are wanted in all.
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
    def full(self) -> bool:
        """Whether nothing is wanted any more."""
        return len(self.plans) == self.total

    def wants(self, plan: int) -> list[int] | None:
        """The group that a level with such a plan goes into; None if it has no use."""
        name = next(name for name, size in self._sizes.items() if len(self.places[name]) < size)
        if name in ("held_out", "hard") and not plan:
            return None
        if name == "hard":
            if self._least is None:
                self._least = float(np.quantile([self.plans[one] for one in self.places["held_out"]], HARD))
            if plan <= self._least:
                return None
        return self.places[name]


def _too_few(groups: _Groups, domain: Domain) -> EvaluationError:
    found = ", ".join(f"{len(one):,} {name.replace('_', '-')}" for name, one in groups.places.items())
    span = domain.spec.audit.span() if domain.spec.audit else None
    hint = (
        "widen `initial_applications` of `[mutation]`, or ask for fewer `levels` and `held_out` in `[audit]`"
    )
    return EvaluationError(f"the mutation rules make too few different levels: {found}", span, hint)


def _joined(levels: Sequence[_Level], inputs: int, scale: float) -> LevelTables:
    """The tables of all levels, one after the other; all are as wide as the widest."""
    first = np.cumsum([0, *(level.tabular.n_states for level in levels)])
    start_first = np.cumsum([0, *(len(level.tabular.start_states) for level in levels)])
    width = max(level.tabular.next_state.shape[2] for level in levels)
    actions = levels[0].tabular.n_actions
    size = int(first[-1]) * actions * width
    to, ended = np.zeros(size, np.int32), np.zeros(size, np.int8)
    chance, reward = np.zeros(size), np.zeros(size)
    for level, begin in zip(levels, first.tolist(), strict=False):
        tabular = level.tabular
        count = prod(tabular.next_state.shape[:2])
        rows = slice(begin * actions, begin * actions + count)
        known = slice(0, tabular.next_state.shape[2])
        to.reshape(-1, width)[rows, known] = tabular.next_state.reshape(count, -1) + begin
        chance.reshape(-1, width)[rows, known] = tabular.probability.reshape(count, -1)
        reward.reshape(-1, width)[rows, known] = tabular.reward.reshape(count, -1) * scale
        ended.reshape(-1, width)[rows, known] = tabular.terminated.reshape(count, -1)
    seen = [row for level in levels for row in level.seen]
    return LevelTables(
        first=first,
        start_first=start_first,
        starts=np.concatenate(
            [level.tabular.start_states + begin for level, begin in zip(levels, first.tolist(), strict=False)]
        ).astype(np.int64),
        start_chance=np.concatenate([level.tabular.start_probability for level in levels]),
        to=to,
        chance=chance,
        reward=reward,
        ended=ended,
        seen_first=np.cumsum([0, *map(len, seen)]),
        seen=np.array([one for row in seen for one in row], np.int32),
        inputs=inputs,
        actions=actions,
        width=width,
    )
