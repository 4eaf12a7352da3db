"""Members of families as versions of one model, with the data that objectives need."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Any, TypeVar, cast

from envgraph.code import dataclass
from envgraph.env import Behaviour, KeyIndex, Tabular, TooManyStates, indexed_classes
from envgraph.env.compiled import Program, Tables, program_over
from envgraph.errors import LIMITS, EvaluationError, InvalidArgument, RuleError
from envgraph.graph import Model, Version
from envgraph.rewrite import Row
from envgraph.search._store import Trace
from envgraph.search.problem._problem import CountWithin, Forbid, Problem, Require
from envgraph.solve.learning import InProgram, Table, flatten

T = TypeVar("T")

Firings = Sequence[tuple[str, Row]]


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """A member of a family, which is a version of the engine's model; a `Candidate`.

    Attributes:
        version: the version of the model.
        trace: the rule applications that lead from the target to this level.
        state: hash of the model.
        measures: value of every measure, by name.
        model: see `Candidate`.
        tabular: the transition table. It is computed on first access, like `table` and `place`.
        table: the flattened transition table for learners.
        place: the level as the only member of a compiled program, for learners that need no table.
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
        """Return the result of `make`, or raise its `TooManyStates` error. Both are cached by key after one call."""
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
    """A factory of levels from states of an engine.

    Args:
        problem: the constraints and measures; its engine is at the target.
        behaviour: the behaviour of the environments; None if the family has none, and thus no tables.

    Attributes:
        rejected: number of models that are not members, by the reason.
        exempted: texts of the constraints that only the target must satisfy.
        origin: the version of the target.
        made: number of tables and programs that were made.
    """

    def __init__(self, problem: Problem, behaviour: Behaviour | None) -> None:
        self.problem, self.engine = problem, problem.engine
        self.rejected: Counter[str] = Counter()
        self.exempted: dict[str, None] = {}
        self.made = 0
        self._behaviour = behaviour
        self._programs: dict[Any, Program] = {}
        problem.valid()  # start incremental matching now: after a version is committed it can no longer start
        self.origin = self.engine.commit()

    @cached_property
    def target(self) -> Level:
        """Return the level of the target, which is the last member of each family.

        Raises:
            InvalidArgument: the initial model violates a constraint or has no value of a measure.
        """
        self.go_to(self.origin)
        target = self._level(self.origin, ())
        if target is None:
            raise InvalidArgument(
                f"the initial model cannot be the target of a family: {next(iter(self.rejected))}"
            )
        return target

    @property
    def behaviour(self) -> Behaviour:
        """Return the behaviour of the environments.

        Raises:
            InvalidArgument: the family has no environment.
        """
        if self._behaviour is None:
            raise InvalidArgument(
                'the family has no environment: write `environment = "name.environment"` in the family file'
            )
        return self._behaviour

    @cached_property
    def keys(self) -> KeyIndex:
        """Return the numbers of the target's objects in the classes that the environment indexes. Levels share them."""
        self.go_to(self.origin)
        return KeyIndex.of(self.engine.model, indexed_classes(self.behaviour, self.engine.model.metamodel))

    @cached_property
    def _tables(self) -> Tables:
        return Tables(self.behaviour, LIMITS["searched states"])

    def here(self, trace: Trace) -> Level | None:
        """Commit the current model and return its level. If it is not a member, count the reason and return None."""
        return self._level(None, trace)

    def go_to(self, version: Version) -> None:
        """Check out a version in the engine, and discard uncommitted changes."""
        self.engine.checkout(version, discard=True)

    def replayed(self, firings: Firings) -> bool:
        """Apply rules at matches to the current model, and return True. If one fails, undo all and return False."""
        try:
            self.engine.replay(firings)
        except (RuleError, EvaluationError):
            return False
        return True

    def exempt(self) -> None:
        """Drop all `require`, `forbid` and `count` constraints that the current model violates from the search problem.

        Only the target, which was checked before, then satisfies them. Their texts are added to `exempted`.
        """
        queries = (one for one in self.problem.constraints if isinstance(one, Require | Forbid | CountWithin))
        violated = [one for one in queries if not one.holds(self.engine)]
        if violated:
            self.exempted.update(dict.fromkeys(map(str, violated)))
            kept = [one for one in self.problem.constraints if one not in violated]
            self.problem = replace(self.problem, constraints=kept)

    def measured(self) -> dict[str, float] | None:
        """Return the measures of the current model. If it is not a member, count the reason and return None."""
        judged = self.problem.judged()
        if isinstance(judged, str):
            self.rejected[judged] += 1
        return None if isinstance(judged, str) else judged

    def tabular_of(self, level: Level) -> Tabular:
        """Compute the transition table of a level. The engine is left at this level.

        Raises:
            EvaluationError, RuleError: a state of the level causes an error.
            TooManyStates: there are more than 50,000 states.
        """
        self.made += 1
        tables, keys = self._tables, self.keys
        self.go_to(level.version)
        return tables.table(self.engine, keys)

    def place_of(self, level: Level) -> InProgram:
        """Return a level as a member of a compiled program. Levels share the program's code if possible.

        Raises:
            NotCompiled: the behaviour has a construct that cannot be compiled.
        """
        self.made += 1
        keys = self.keys
        self.go_to(level.version)
        program = program_over(self._programs, self.engine, self.behaviour, keys)
        program.functions("learn")  # compile before several threads need it
        return InProgram(program, 0)

    def value(self, measures: Mapping[str, float]) -> float:
        """Return the value of the measure on which the diversity is computed, from the measures of a model."""
        return measures[self.problem.diversity_of]

    def diversity(self, family: Sequence[Level]) -> float:
        """Return the diversity of a family."""
        return self.problem.diversity.score([self.value(level.measures) for level in family])

    def _numbered(self) -> bool:
        """Return True if all indexed objects of the current model exist in the target; else count the reasons."""
        here = KeyIndex.of(self.engine.model, [*self.keys.keys]).keys
        new = [name for name, keys in here.items() if not {*keys} <= {*self.keys.keys[name]}]
        self.rejected.update(
            f"it has an observed object of class `{name}` that the target does not have" for name in new
        )
        return not new

    def _level(self, version: Version | None, trace: Trace) -> Level | None:
        measures = self.measured()
        if measures is None or (version is None and not self._numbered()):
            return None
        state = self.engine.model.state_hash()
        return Level(version or self.engine.commit(), trace, state, measures, self)
