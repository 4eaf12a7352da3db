"""Models as members of families: versions of one model, with what an objective asks of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Any, Final, TypeVar, cast

from envgraph.code import dataclass
from envgraph.env import Behaviour, KeyIndex, Tabular, TooManyStates, indexed_classes
from envgraph.env.compiled import Program, Tables, program_over
from envgraph.errors import EvaluationError, InvalidArgument, RuleError
from envgraph.graph import Model, Version
from envgraph.rewrite import Row
from envgraph.search._store import Trace
from envgraph.search.problem._problem import CountWithin, Forbid, Problem, Require
from envgraph.solve.learning import InProgram, Table, flatten

MOST_STATES: Final = 50_000
"""Of a member that has a table: thousands are tried."""

T = TypeVar("T")

Firings = Sequence[tuple[str, Row]]


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """A member of a family; a `Candidate`.

    Attributes:
        version: of the model.
        trace: the rules that lead to it from the target, and their matches.
        state: hash of the model.
        measures: value of every measure, by name.
        model: see `Candidate`.
        tabular: its reachable states; this and the others are made when they are first asked for.
        table: the same, for learners.
        place: where learners find it that need no table: the only member of a compiled program.
    """

    version: Version
    trace: Trace
    state: int
    measures: Mapping[str, float]
    _levels: Levels = field(repr=False)
    _made: dict[object, Any] = field(default_factory=dict, repr=False)

    @property
    def model(self) -> Model:
        self._levels.go_to(self.version)
        return self._levels.engine.model

    @property
    def tabular(self) -> Tabular:
        return self.once("tabular", lambda: self._levels.tabular_of(self))

    @property
    def table(self) -> Table:
        return self.once("table", lambda: flatten(self.tabular))

    @property
    def place(self) -> InProgram:
        return self.once("place", lambda: self._levels.place_of(self))

    def once(self, key: object, make: Callable[[], T]) -> T:
        """See `Candidate`; that there are too many states is kept, too."""
        if key not in self._made:
            try:
                self._made[key] = make()
            except TooManyStates as error:
                self._made[key] = error
        found = self._made[key]
        if isinstance(found, TooManyStates):
            raise found
        return cast(T, found)


class Levels:
    """Makes levels of the states that an engine comes to.

    Args:
        problem: says what is valid, and measures; its engine stands at the target.
        behaviour: of the environments; None where there are none, and so no tables.

    Attributes:
        rejected: how many models were no members, by what was wrong with them.
        exempted: texts of the constraints that only the target must satisfy.
        origin: the version of the target.
        made: how many tables and programs were made.
    """

    def __init__(self, problem: Problem, behaviour: Behaviour | None) -> None:
        self.problem, self.engine = problem, problem.engine
        self.rejected: Counter[str] = Counter()
        self.exempted: dict[str, None] = {}
        self.made = 0
        self._behaviour = behaviour
        self._programs: dict[Any, Program] = {}
        problem.valid()  # from the first question on patterns are kept current, unless a version is held by then
        self.origin = self.engine.commit()

    @cached_property
    def target(self) -> Level:
        """The last member of each family.

        Raises:
            InvalidArgument: the initial model is no member.
        """
        self.go_to(self.origin)
        target = self._level(self.origin, ())
        if target is None:
            raise InvalidArgument(f"the target is no member of a family: {next(iter(self.rejected))}")
        return target

    @property
    def behaviour(self) -> Behaviour:
        """Of the environments.

        Raises:
            InvalidArgument: there are none.
        """
        if self._behaviour is None:
            raise InvalidArgument("the family has no environment: its family file names none")
        return self._behaviour

    @cached_property
    def keys(self) -> KeyIndex:
        """Numbers of objects: those of the target."""
        self.go_to(self.origin)
        return KeyIndex.of(self.engine.model, indexed_classes(self.behaviour, self.engine.model.metamodel))

    @cached_property
    def _tables(self) -> Tables:
        return Tables(self.behaviour, MOST_STATES)

    def here(self, trace: Trace) -> Level | None:
        """The level of the present model, which is committed; None, and a reason is counted, if it is none."""
        return self._level(None, trace)

    def go_to(self, version: Version) -> None:
        """Let the engine stand at a version."""
        self.engine.checkout(version, discard=True)

    def replayed(self, firings: Firings) -> bool:
        """Apply rules at matches to the present model; if one of them cannot be, none is."""
        try:
            self.engine.replay(firings)
        except (RuleError, EvaluationError):
            return False
        return True

    def exempt(self) -> None:
        """Drop the queries that the present model violates, for all members but the target; see `exempted`."""
        queries = (one for one in self.problem.constraints if isinstance(one, Require | Forbid | CountWithin))
        violated = [one for one in queries if not one.holds(self.engine)]
        if violated:
            self.exempted.update(dict.fromkeys(map(str, violated)))
            kept = [one for one in self.problem.constraints if one not in violated]
            self.problem = replace(self.problem, constraints=kept)

    def measured(self) -> dict[str, float] | None:
        """The measures of the present model; None, and a reason is counted, if it is no member."""
        judged = self.problem.judged()
        if isinstance(judged, str):
            self.rejected[judged] += 1
        return None if isinstance(judged, str) else judged

    def tabular_of(self, level: Level) -> Tabular:
        """The table of a level.

        Raises:
            EvaluationError, RuleError: as `explore`; `TooManyStates` if there are more than 50,000.
        """
        self.made += 1
        tables, keys = self._tables, self.keys
        self.go_to(level.version)
        return tables.table(self.engine, keys)

    def place_of(self, level: Level) -> InProgram:
        """The place of a level in a program; programs have one text as long as the levels allow it.

        Raises:
            NotCompiled: something in its behaviour only the live engine has.
        """
        self.made += 1
        keys = self.keys
        self.go_to(level.version)
        program = program_over(self._programs, self.engine, self.behaviour, keys)
        program.functions("learn")  # compiled before threads ask for it
        return InProgram(program, 0)

    def value(self, measures: Mapping[str, float]) -> float:
        """What the diversity reads."""
        return measures[self.problem.diversity_of]

    def diversity(self, family: Sequence[Level]) -> float:
        """Of a family."""
        return self.problem.diversity.score([self.value(level.measures) for level in family])

    def _numbered(self) -> bool:
        """Whether the target has all objects of the present model that are observed; else a reason is counted."""
        here = KeyIndex.of(self.engine.model, [*self.keys.keys]).keys
        new = [name for name, keys in here.items() if not {*keys} <= {*self.keys.keys[name]}]
        self.rejected.update(f"it has a `{name}` that the target lacks, and that is observed" for name in new)
        return not new

    def _level(self, version: Version | None, trace: Trace) -> Level | None:
        measures = self.measured()
        if measures is None or (version is None and not self._numbered()):
            return None
        state = self.engine.model.state_hash()
        return Level(version or self.engine.commit(), trace, state, measures, self)
