"""A search for all states that rules can reach.

Every move is made once and undone, so a state costs the changes that lead to it from its predecessor. States are
compared by a hash of their facts, or, up to isomorphism, by the numbers that `IsomorphismClasses` assigns to them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from math import inf
from typing import TYPE_CHECKING, Any, Final, Literal

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument, RuleError
from envgraph.graph import IsomorphismClasses, Model, Version, defer_interrupts
from envgraph.rewrite._choice_enumeration import Branches
from envgraph.rewrite._matches import Row, Shape
from envgraph.rewrite.explore._exploration import Ending, Exploration, ExplorationRecord, Firings, State
from envgraph.rewrite.explore._state_walks import StateWalk, walk_of_savepoints, walk_of_versions
from envgraph.rewrite.run._rule_runner import REFUSALS, RuleRunner

if TYPE_CHECKING:
    from envgraph.rewrite.engine._engine import Engine

COMPILE_AFTER: Final = 50_000
"""Moves of an engine in the time that it takes to compile a program; `python -m benchmarks philosophers`."""

Strategy = Literal["breadth", "depth"]
Sameness = Literal["identity", "isomorphism"]

Predicate = str | Callable[["Engine"], bool]
"""The name of a pattern or rule, true if it has a match, or a function of the engine."""

StateTest = Callable[[], bool]
"""A function that returns True if a condition holds in the current state."""


@dataclass(frozen=True, slots=True)
class Mover:
    """The moves of a rule or unit in a state: one for each match of a rule, or for each outcome of a unit's choices.

    Attributes:
        name: name of the rule or unit.
        shape: shape of the matches of a rule; None for a unit.
        moves: iterates over the moves in the current state. The state is restored before the iterator continues.
        make_move: makes a move. It returns the match of the rule or the firings of the unit, or None if nothing was
            applied. It raises a `RuleError` if the move is refused; the model is then unchanged.
    """

    name: str
    shape: Shape | None
    moves: Callable[[], Iterator[Any]]
    make_move: Callable[[Any], Row | Firings | None]


def _rule_mover(rule: RuleRunner) -> Mover:
    rule.prepare(())  # raises for a rule that needs arguments

    def make(row: Row) -> Row:
        rule.fire(row)
        return row

    return Mover(rule.name, rule.shape, lambda: iter(sorted(rule.all_rows())), make)


def _random_branches() -> Iterator[Branches]:
    """Yield the same `Branches` once for each sequence of random choices, ready for a run."""
    branches = Branches()
    while branches.advance():
        yield branches


def _movers(engine: Engine, names: Iterable[str]) -> list[Mover]:
    """Return the movers of rules, units and groups, each rule and unit once.

    Raises:
        InvalidArgument: `names` is empty, or has an unknown name or a rule or unit that needs values.
    """
    if not isinstance(names, Iterable):
        raise InvalidArgument(f"expected names of rules, units and groups, not {names!r}")
    members = dict.fromkeys(member for name in names for member in engine.group(name))
    if not members:
        raise InvalidArgument("pass at least one name of a rule, group or unit")
    return [_mover(engine, member) for member in members]


def _mover(engine: Engine, name: str) -> Mover:
    signature = engine.signature(name)
    if signature.kind == "rule":
        return _rule_mover(engine.prepare(name))
    required = [f"`{parameter.name}`" for parameter in signature.parameters if parameter.is_required]
    if required:
        raise InvalidArgument(f"unit `{name}` needs values for {', '.join(required)}")

    def make(branches: Branches) -> Firings | None:
        return tuple(engine.runs.execute(name, {}, branches, strict=True)[0].firings) or None

    return Mover(name, None, _random_branches, make)


@dataclass(slots=True)
class RunningExploration:
    """A running exploration.

    Attributes:
        movers: rules and units to execute in every state, in this order.
        predicates: the tests to evaluate in every state, by name.
        goal: the test that ends the search, or None.
        limit: maximal number of states, and maximal number of runs of one unit in one state.
        depth: maximal number of moves from the first state; None for no maximum.
        explore_compiled: explores from the first state with a compiled program, and returns the result, or the reason
            why this is not possible.
        compile_after: number of transitions and repeated moves after which `explore_compiled` is called.
        not_compiled: see `Exploration`.

    Raises:
        InvalidArgument: the limit is below 1, the strategy or `up_to` is unknown, or the depth is negative or used
            with a depth-first search.
    """

    model: Model
    movers: Sequence[Mover]
    predicates: Mapping[str, StateTest]
    goal: StateTest | None
    limit: int
    depth: int | None
    strategy: Strategy
    up_to: Sameness
    keep: bool
    explore_compiled: Callable[[Callable[[], None]], Exploration | str] | None = None
    compile_after: float = inf
    not_compiled: str = f"it makes fewer than {COMPILE_AFTER:,} moves"
    _record: ExplorationRecord = field(default_factory=ExplorationRecord)
    _numbers_by_hash: dict[int, int] = field(default_factory=dict)
    _by_shape: dict[int, int] = field(default_factory=dict)
    _shapes: IsomorphismClasses = field(default_factory=IsomorphismClasses)
    _is_truncated: bool = False

    def __post_init__(self) -> None:
        if self.limit < 1:
            raise InvalidArgument(f"`limit` is {self.limit}, but must be at least 1")
        if self.strategy not in ("breadth", "depth"):
            raise InvalidArgument(f'`strategy` must be "breadth" or "depth", not {self.strategy!r}')
        if self.depth is not None and (type(self.depth) is not int or self.depth < 0):
            raise InvalidArgument(f"`depth` is {self.depth!r}, but must be a whole number from 0")
        if self.depth is not None and self.strategy == "depth":
            raise InvalidArgument(
                '`depth` needs `strategy="breadth"`, because a depth-first search may find a long path to a state first'
            )
        if self.up_to not in ("identity", "isomorphism"):
            raise InvalidArgument(f'`up_to` must be "identity" or "isomorphism", not {self.up_to!r}')

    def explore(self) -> Exploration:
        """Explore, and return the result. At the end, or after an exception, the model is in its first state again."""
        walking = walk_of_versions if self.keep else walk_of_savepoints
        with defer_interrupts() as check, walking(self.model) as walk:
            self._state_number(0)
            ending = self._record_state(0, self.model.version if self.keep else None)
            found = ending or self._run_search(walk, check)
            if isinstance(found, Exploration):
                return found
        shapes = {mover.name: mover.shape for mover in self.movers if mover.shape is not None}
        ending = found or ("limit" if self._is_truncated else "exhausted")
        return Exploration(self._record, self.model, shapes, tuple(self.predicates), ending, self.not_compiled)

    def _run_search(self, walk: StateWalk, check: Callable[[], None]) -> Exploration | Ending | None:
        record, deep = self._record, self.strategy == "depth"
        opened = deque([(record.states[0], self._moves())])
        while opened:
            state, moves = opened[-1 if deep else 0]
            if state.depth == self.depth:
                return "depth"
            if len(record.sources) + walk.repeated >= self.compile_after and self.explore_compiled is not None:
                walk.restore_state(0)
                result = self.explore_compiled(check)
                if isinstance(result, Exploration):
                    return result
                self.not_compiled, self.explore_compiled = result, None
            walk.restore_state(state.number)
            for mover, choice in moves:
                check()
                walk.begin_move()
                done = self._make_move(state, mover, choice)
                if done is None:
                    walk.undo_move()
                    continue
                ending = self._add_new_state(walk, state, mover.name, done)
                if ending is not None:
                    return ending
                found = record.states[-1]
                walk.store_state(found.number)
                opened.append((found, self._moves()))
                if deep:
                    break
            else:
                record.expanded.append(state.number)
                opened.pop() if deep else opened.popleft()
        return None

    def _moves(self) -> Iterator[tuple[Mover, Any]]:
        for mover in self.movers:
            for number, choice in enumerate(mover.moves()):
                if number >= self.limit and mover.shape is None:
                    self._is_truncated = True
                    break
                yield mover, choice

    def _make_move(self, state: State, mover: Mover, choice: Any) -> Row | Firings | None:
        """Make a move, and return its match or firings if it leads to a new state.

        Return None if the move leads to a known state (the transition is recorded), is refused or applies nothing.
        """
        record = self._record
        try:
            done = mover.make_move(choice)
        except RuleError as error:
            if error.reason not in REFUSALS:
                raise
            record.refused += 1
            return None
        if done is None:
            return None
        new = len(record.states)
        target = self._state_number(new)
        if target == new:
            return done
        record.add_transition(state.number, target, mover.name, done)
        return None

    def _state_number(self, new: int) -> int:
        """Return the number of the current state. A new state gets the number `new`."""
        total = self.model.graph.store.hash_sum
        known = self._numbers_by_hash.get(total)
        if known is None:
            known = new
            if self.up_to == "isomorphism":
                known = self._by_shape.setdefault(self._shapes.class_number(self.model.graph.store), new)
                self._record.merged += known < new
            self._numbers_by_hash[total] = known
        return known

    def _add_new_state(self, walk: StateWalk, source: State, name: str, done: Row | Firings) -> Ending | None:
        """Record a new state and the transition to it. Return "goal" if the search ends here, else None.

        Return "limit", without recording anything, if there are as many states as the limit already.
        """
        record = self._record
        number = len(record.states)
        if number >= self.limit:
            return "limit"
        record.add_transition(source.number, number, name, done)
        return self._record_state(source.depth + 1, walk.accept_move())

    def _record_state(self, depth: int, version: Version | None) -> Ending | None:
        """Record the current state with the predicates that hold. Return "goal" if it is a goal."""
        record = self._record
        number = len(record.states)
        holds = tuple([name for name, test in self.predicates.items() if test()])
        record.states.append(State(number, depth, holds, version))
        record.found_by.append(len(record.sources) - 1)
        if self.goal is not None and self.goal():
            record.goal = number
            return "goal"
        return None


def explore(
    engine: Engine,
    rules: str | Iterable[str],
    *,
    limit: int = 100_000,
    depth: int | None = None,
    strategy: Strategy = "breadth",
    up_to: Sameness = "identity",
    goal: Predicate | None = None,
    predicates: Iterable[str] | Mapping[str, Predicate] = (),
    keep: bool = False,
) -> Exploration:
    """Find the states that rules, groups and units can reach from the current state, and the transitions between them.

    From each state every rule is applied at every match, in the order of the matched objects and values, and a unit
    runs with every sequence of random choices. Weights and priorities of rules are ignored, and event rules do not
    fire. Two states are equal if they have the same objects with the same values and links. At the end, or after an
    exception or Ctrl-C, the engine is in the state in which it was. The result depends only on the state and the
    arguments.

    An exploration with many transitions is continued by a program that numba compiles, if numba is installed and there
    are only rules, which environments can compile, and named goals. This does not change the result.

    Args:
        rules: names of rules, groups and units.
        limit: maximal number of states; if there are more, the exploration ends with `ending` "limit".
        depth: maximal number of moves to a state; deeper states are not explored. Only with strategy "breadth".
        strategy: "breadth" explores states with few moves first, so that paths are shortest; or "depth".
        up_to: with "isomorphism", states that differ only by ids are equal. Rules that create objects need this
            if they can return to an earlier state.
        goal: ends the search in a state where it holds: the name of a pattern or rule that has a match, or a function
            of the engine. Such functions must not change the model.
        predicates: goals to evaluate in every state: their names, or a mapping from your own names to them.
        keep: store a version of every state, for `checkout`. Uncommitted changes are committed first.

    Raises:
        InvalidArgument: unknown name, unit or rule that needs values, limit below 1, or a wrong depth.
        TransactionError: `keep` was given inside a transaction.
        RuleError, EvaluationError: a rule or unit contains a mistake. Refused applications are only counted.
    """
    if isinstance(predicates, str):
        predicates = (predicates,)
    if not isinstance(predicates, Iterable):
        raise InvalidArgument(f"expected names of predicates, not {predicates!r}")
    asked = predicates if isinstance(predicates, Mapping) else {name: name for name in predicates}
    movers = _movers(engine, [rules] if isinstance(rules, str) else rules)
    tests = {name: _state_test(engine, predicate) for name, predicate in asked.items()}
    wanted = None if goal is None else _state_test(engine, goal)
    search = RunningExploration(engine.model, movers, tests, wanted, limit, depth, strategy, up_to, keep)
    obstacles = {
        '`strategy` is "depth"': strategy == "depth",
        '`up_to` is "isomorphism"': up_to == "isomorphism",
        "`keep` is true": keep,
        "a goal or predicate is a function": any(map(callable, [goal, *asked.values()])),
        "it runs units": not all(mover.shape for mover in movers),
        "numba is not installed": find_spec("numba") is None,
    }
    search.not_compiled = next((reason for reason, holds in obstacles.items() if holds), search.not_compiled)
    if not any(obstacles.values()):
        _prepare_compiled(engine, search, asked, goal)
    with engine.runs.unnoticed():
        return search.explore()


def _prepare_compiled(engine: Engine, search: RunningExploration, predicates: Mapping[str, Any], goal: Any) -> None:
    """Set how a compiled program explores, and when: at once if an earlier exploration has compiled it."""
    shapes = {mover.name: mover.shape for mover in search.movers}
    tests = {name: engine.queries.resolve_query(predicate)[1] for name, predicate in predicates.items()}
    wanted = goal and engine.queries.resolve_query(goal)[1]
    cache, key = engine.catalog.compiled_explorations, (*shapes, None, *tests.values(), None, wanted)

    def explore_compiled(check: Callable[[], None]) -> Exploration | str:
        # By name, because `env` is built on this package; it is imported when it is worth its time.
        function: Any = import_module("envgraph.env.compiled").explore_compiled
        programs = cache.setdefault(key, {})
        return function(engine, shapes, tests, wanted, search.limit, search.depth, programs, check)  # type: ignore[no-any-return]

    search.explore_compiled, search.compile_after = explore_compiled, 0 if cache.get(key) else COMPILE_AFTER


def _state_test(engine: Engine, predicate: Predicate) -> Callable[[], bool]:
    if callable(predicate):
        return lambda: bool(predicate(engine))
    if not isinstance(predicate, str):
        raise InvalidArgument(f"a predicate must be the name of a pattern or a function, not {predicate!r}")
    _, pattern, free = engine.queries.resolve_query(predicate)
    return partial(engine.matcher.exists, pattern, free)
