"""Runs of units, and of rules and groups as units, with the random generator of an engine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import deepcopy
from random import Random
from typing import TYPE_CHECKING, Any, cast

from envgraph.errors import EvaluationError, InvalidArgument, Span, scaled_limit
from envgraph.graph import Node, guarded_contextmanager
from envgraph.match import ViewMatcher
from envgraph.metamodel import Value
from envgraph.pattern import ObjectType
from envgraph.rewrite._matches import Shape
from envgraph.rewrite.engine._application_trace import Trace
from envgraph.rewrite.engine._catalog import Catalog, merge_bindings
from envgraph.rewrite.engine._engine_history import EngineHistory
from envgraph.rewrite.engine._notification import NO_CONTEXT, EngineEvents
from envgraph.rewrite.run._rule_runner import Randomness, RuleRunner
from envgraph.rewrite.run._unit_programs import RunResult, UnitProgram
from envgraph.rewrite.run._unit_runtime import UNSET, Environment, UnitRun, apply_one_of, fire_one

if TYPE_CHECKING:
    import numpy


class EngineRuns:
    """The part of an engine that runs units, records their applications, and lets event rules fire afterwards.

    Attributes:
        seed: seed of `rng`.
        step_limit: maximal number of calls and loop rounds in one `run`, and of event rule firings in one settling.
    """

    def __init__(self, catalog: Catalog, events: EngineEvents, history: EngineHistory, seed: int) -> None:
        self.seed = seed
        self.step_limit = scaled_limit("steps of a run")
        self._catalog = catalog
        self._model = catalog.model
        self._events = events
        self._history = history
        self._rng: numpy.random.Generator | None = None

    @property
    def rng(self) -> numpy.random.Generator:
        """Return the random generator of all random choices; see `Engine.rng`."""
        if self._rng is None:
            try:
                from numpy.random import default_rng
            except ImportError:
                self._rng = cast("numpy.random.Generator", Random(self.seed))
            else:
                self._rng = default_rng(self.seed)
        return self._rng

    @rng.setter
    def rng(self, generator: numpy.random.Generator) -> None:
        self._rng = generator

    def run(self, unit: str, /, *, bound: Mapping[str, object] | None = None, **values: object) -> RunResult:
        """Run a unit. A rule or group is run like a unit that calls it.

        Args:
            unit: name of the unit.
            bound: values of its parameters; objects as `Node`s or ids.
            **values: the same, for parameters whose names are possible as keywords.

        Returns:
            The result, which is true if the run succeeded. The changes of a failed unit remain, unless it is
            `atomic`. `outputs` contains the values of the `out` parameters; for a rule also the objects that it
            created.

        Raises:
            InvalidArgument: a name or argument is unknown, or an argument is missing.
            RuleError: the matches of a `forall` contradict each other. The model is unchanged.
            EvaluationError: the step limit was reached, or a value cannot be computed. The model is unchanged.
        """
        qualified, arguments = self._catalog.resolve(unit), merge_bindings(bound, values)
        if not self._events.has_event_rules:
            with self._events.delayed() or NO_CONTEXT:
                return self._run_result(qualified, arguments)
        with self._history.recording_to(Trace()) as everything, self._events.delayed() or NO_CONTEXT:
            result = self._run_result(qualified, arguments)
        result.events = tuple(everything[result.applications :])
        return result

    def _run_result(self, name: str, arguments: Mapping[str, object]) -> RunResult:
        self._history.check_state()
        run, outcome, outputs = self.execute(name, arguments)
        if self._history.recorders:
            self._history.record(run.firings, run.gaps)
        failure = run.failure if outcome is None else None
        return RunResult(name, run.trace, failure, run.refusal, outputs, run.limit - run.steps)

    def execute(
        self,
        name: str,
        arguments: Mapping[str, object],
        rng: Randomness | None = None,
        *,
        strict: bool = False,
    ) -> tuple[UnitRun, bool | None, Mapping[str, Node | Value]]:
        """Run a unit, rule or group without recording it; return the run, its outcome and its outputs.

        The outcome is None if the run failed, else True if it changed anything. If `strict`, a refusal that makes the
        run fail is raised, and everything is undone.
        """
        run = self.new_run(rng)
        loops = self._catalog.matcher.loops if isinstance(self._catalog.matcher, ViewMatcher) else None
        depth = 0 if loops is None else loops.depth
        with self._model.transaction():
            try:
                outcome, outputs = self._start(run, name, arguments)
            except BaseException as error:
                if loops is not None:
                    loops.leave_loops_above(depth)
                run.undo_all()
                if isinstance(error, RecursionError):
                    raise EvaluationError(f"the steps of `{name}` are nested too deeply") from None
                raise
            if strict and outcome is None and run.refusal is not None:
                raise run.refusal
        return run, outcome, outputs

    def failed_step(self, unit: str, values: Mapping[str, object]) -> tuple[str, Span | None] | None:
        """Run a unit, and return the text and span of the step that failed; None if it succeeds. Changes remain."""
        run, outcome, _ = self.execute(unit, values)
        text, span = run.failure
        reported = text if run.refusal is None else f"{text}: {run.refusal.message}"
        return (reported, span) if outcome is None else None

    def new_run(self, rng: Randomness | None = None) -> UnitRun:
        """Return a new run with no steps taken."""
        return UnitRun(self._model, self.rng if rng is None else rng, self.step_limit, self.step_limit)

    def _start(
        self, run: UnitRun, name: str, arguments: Mapping[str, object]
    ) -> tuple[bool | None, Mapping[str, Node | Value]]:
        if name in self._catalog.runners:
            return self._start_rule(run, self._catalog.runners[name], arguments)
        if name in self._catalog.members:
            if arguments:
                raise InvalidArgument(f"`{name}` is a group, which takes no arguments")
            run.failure = f"no rule of `{name}` could be applied", None
            return apply_one_of(run, [self._catalog.runners[member] for member in self._catalog.members[name]]), {}
        program = self._catalog.programs[name]
        environment = self._parameter_values(program, arguments)
        outcome = program.run(run, environment)
        return outcome, {} if outcome is None else self._outputs(program, environment)

    def _start_rule(
        self, run: UnitRun, rule: RuleRunner, arguments: Mapping[str, object]
    ) -> tuple[bool | None, Mapping[str, Node | Value]]:
        run.count_step()
        run.failure = f"`{rule.name}` has no {'such ' if arguments else ''}match", None
        found = fire_one(run, rule, rule.rows_unchecked(self._catalog.check_bindings(rule.shape, arguments)))
        if found is None:
            if run.refusal is not None:
                run.failure = f"`{rule.name}` was refused at each match", None
            return None, {}
        run.record(rule)
        run.record(found[0])
        application = rule.application(*found)
        return True, {**application.created, **application.outputs}

    def _outputs(self, program: UnitProgram, environment: Environment) -> dict[str, Node | Value]:
        found: dict[str, Node | Value] = {}
        for parameter in program.signature.parameters:
            value = environment.get(parameter.name, UNSET)
            if parameter.is_output and value is not UNSET:
                is_object = isinstance(parameter.type, ObjectType)
                found[parameter.name] = Node(self._model, cast("int", value)) if is_object else value
        return found

    def _parameter_values(self, program: UnitProgram, arguments: Mapping[str, object]) -> dict[str, Value]:
        taken = program.signature.parameters
        if not taken and not arguments:
            return {}
        types = tuple(parameter.type for parameter in taken)
        assert all(type_ is not None for type_ in types), "parameters of units have types"
        shape = Shape(program.name, tuple(p.name for p in taken), cast("Any", types))
        environment = self._catalog.check_bindings(shape, arguments)
        missing = [p.name for p in taken if p.is_required and p.name not in environment]
        if missing:
            names = ", ".join(f"`{name}`" for name in missing)
            raise InvalidArgument(f"unit `{program.name}` needs values for {names}")
        return environment

    @guarded_contextmanager
    def with_other_randomness(self, rng: Randomness) -> Iterator[Trace]:
        """Use another random generator in the block, and record its applications only in the yielded, new trace."""
        recorders, own, trace = self._history.recorders, self._rng, Trace(start=self._model.state_hash())
        self._history.recorders, self._rng = [trace], cast("numpy.random.Generator", rng)
        try:
            yield trace
        finally:
            self._history.recorders, self._rng = recorders, own

    @guarded_contextmanager
    def unnoticed(self) -> Iterator[None]:
        """Hide the block, which must restore the model, from listeners, event rules and recordings; restore `rng`."""
        recorders, rng = self._history.recorders, self._rng
        with self._events.asleep():
            self._history.recorders, self._rng = [], deepcopy(rng)
            try:
                yield
            finally:
                self._history.recorders, self._rng = recorders, rng
