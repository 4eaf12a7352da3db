"""Members of families as versions of one model, with the data that objectives need."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Any, TypeVar, cast

from envgraph.code import dataclass
from envgraph.env import Behaviour, KeyIndex, Tabular, TooManyStates, indexed_classes
from envgraph.env.compiled import CompiledProgram, TableBuilder, compile_for_model
from envgraph.errors import LIMITS, EvaluationError, InvalidArgument, RuleError
from envgraph.graph import Model, Version
from envgraph.rewrite import Row
from envgraph.search._run_store import Trace
from envgraph.search.problem._problem import Forbid, MatchCountWithin, Problem, Require
from envgraph.solve.learning import InProgram, TransitionTable, flatten_tabular

T = TypeVar("T")

RuleMatches = Sequence[tuple[str, Row]]


@dataclass(frozen=True, slots=True, eq=False)
class ModelLevel:
    """A member of a family, which is a version of the engine's model; a `Candidate`.

    Attributes:
        version: the version of the model.
        trace: the rule applications that lead from the target to this level.
        state: hash of the model.
        measures: value of every measure, by name.
        model: see `Candidate`.
        tabular: the transition table. It is computed on first access, like `table` and `program_place`.
        table: the flattened transition table for learners.
        program_place: the level as the only member of a compiled program, for learners that need no table.
    """

    version: Version
    trace: Trace
    state: int
    measures: Mapping[str, float]
    _levels: LevelFactory = field(repr=False)
    _cached: dict[object, Any] = field(default_factory=dict, repr=False)

    @property
    def model(self) -> Model:
        self._levels.check_out(self.version)
        return self._levels.engine.model

    @property
    def tabular(self) -> Tabular:
        return self.once("tabular", lambda: self._levels.table_of_level(self))

    @property
    def table(self) -> TransitionTable:
        return self.once("table", lambda: flatten_tabular(self.tabular))

    @property
    def program_place(self) -> InProgram:
        return self.once("place", lambda: self._levels.program_place_of(self))

    def once(self, key: object, make: Callable[[], T]) -> T:
        """Return the result of `make`, or raise its `TooManyStates` error. Both are cached by key after one call."""
        if key not in self._cached:
            try:
                self._cached[key] = make()
            except TooManyStates as error:
                self._cached[key] = error
        found = self._cached[key]
        if isinstance(found, TooManyStates):
            raise found
        return cast(T, found)


class LevelFactory:
    """A factory of levels from states of an engine.

    Args:
        problem: the constraints and measures; its engine is at the target.
        behaviour: the behaviour of the environments; None if the family has none, and thus no tables.

    Attributes:
        rejection_counts: number of models that are not members, by the reason.
        dropped_constraints: texts of the constraints that only the target must satisfy.
        origin: the version of the target.
        tables_made: number of tables and programs that were made.
    """

    def __init__(self, problem: Problem, behaviour: Behaviour | None) -> None:
        self.problem, self.engine = problem, problem.engine
        self.rejection_counts: Counter[str] = Counter()
        self.dropped_constraints: dict[str, None] = {}
        self.tables_made = 0
        self._behaviour = behaviour
        self._programs: dict[Any, CompiledProgram] = {}
        problem.is_valid()  # start incremental matching now: after a version is committed it can no longer start
        self.origin = self.engine.commit()

    @cached_property
    def target(self) -> ModelLevel:
        """Return the level of the target, which is the last member of each family.

        Raises:
            InvalidArgument: the initial model violates a constraint or has no value of a measure.
        """
        self.check_out(self.origin)
        target = self.commit_if_member((), self.origin)
        if target is None:
            raise InvalidArgument(
                f"the initial model cannot be the target of a family: {next(iter(self.rejection_counts))}"
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
        self.check_out(self.origin)
        return KeyIndex.of_model(self.engine.model, indexed_classes(self.behaviour, self.engine.model.metamodel))

    @cached_property
    def _tables(self) -> TableBuilder:
        return TableBuilder(self.behaviour, LIMITS["searched states"])

    def commit_if_member(self, trace: Trace, version: Version | None = None) -> ModelLevel | None:
        """Return the current model as a level. If it is not a member, count the reason and return None.

        Commit the model, unless it is the target, which is given as a `version`.
        """
        measures = self.measure_or_count()
        if measures is None or (version is None and not self._has_known_objects()):
            return None
        state = self.engine.model.state_hash()
        return ModelLevel(version or self.engine.commit(), trace, state, measures, self)

    def check_out(self, version: Version) -> None:
        """Check out a version in the engine, and discard uncommitted changes."""
        self.engine.checkout(version, discard=True)

    def try_apply_all(self, applications: RuleMatches) -> bool:
        """Apply rules at matches to the current model, and return True. If one fails, undo all and return False."""
        try:
            self.engine.replay(applications)
        except (RuleError, EvaluationError):
            return False
        return True

    def drop_violated_constraints(self) -> None:
        """Drop all `require`, `forbid` and `count` constraints that the current model violates from the search problem.

        Only the target, which was checked before, then satisfies them. Their texts are added to `dropped_constraints`.
        """
        queries = (one for one in self.problem.constraints if isinstance(one, Require | Forbid | MatchCountWithin))
        violated = [one for one in queries if not one.holds(self.engine)]
        if violated:
            self.dropped_constraints.update(dict.fromkeys(map(str, violated)))
            kept = [one for one in self.problem.constraints if one not in violated]
            self.problem = replace(self.problem, constraints=kept)

    def measure_or_count(self) -> dict[str, float] | None:
        """Return the measures of the current model. If it is not a member, count the reason and return None."""
        judged = self.problem.measures_or_rejection()
        if isinstance(judged, str):
            self.rejection_counts[judged] += 1
        return None if isinstance(judged, str) else judged

    def table_of_level(self, level: ModelLevel) -> Tabular:
        """Compute the transition table of a level. The engine is left at this level.

        Raises:
            EvaluationError, RuleError: a state of the level causes an error.
            TooManyStates: there are more than 50,000 states.
        """
        self.tables_made += 1
        tables, keys = self._tables, self.keys
        self.check_out(level.version)
        return tables.build(self.engine, keys)

    def program_place_of(self, level: ModelLevel) -> InProgram:
        """Return a level as a member of a compiled program. Levels share the program's code if possible.

        Raises:
            NotCompiled: the behaviour has a construct that cannot be compiled.
        """
        self.tables_made += 1
        keys = self.keys
        self.check_out(level.version)
        program = compile_for_model(self._programs, self.engine, self.behaviour, keys)
        program.functions_for("learn")  # compile before several threads need it
        return InProgram(program, 0)

    def diversity_value(self, measures: Mapping[str, float]) -> float:
        """Return the value of the measure on which the diversity is computed, from the measures of a model."""
        return measures[self.problem.diversity_measure_name]

    def family_diversity(self, family: Sequence[ModelLevel]) -> float:
        """Return the diversity of a family."""
        return self.problem.diversity.score([self.diversity_value(level.measures) for level in family])

    def _has_known_objects(self) -> bool:
        """Return True if all indexed objects of the current model exist in the target; else count the reasons."""
        here = KeyIndex.of_model(self.engine.model, [*self.keys.keys]).keys
        new = [name for name, keys in here.items() if not {*keys} <= {*self.keys.keys[name]}]
        self.rejection_counts.update(
            f"it has an observed object of class `{name}` that the target does not have" for name in new
        )
        return not new
