"""The one facade: a model, its registered patterns, rules, units and derived groups."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from copy import deepcopy
from random import Random
from typing import TYPE_CHECKING, Any, Literal, NoReturn, cast

from envgraph.errors import (
    EvaluationError,
    InvalidArgument,
    RuleError,
    Span,
    limit,
)
from envgraph.graph import Model, Node, Savepoint, Version, as_context, ensured
from envgraph.match import Subscription, ViewMatcher
from envgraph.metamodel import Value
from envgraph.pattern import ObjectType
from envgraph.rewrite._match import Application, Firing, Match, Row, Shape
from envgraph.rewrite.engine._questions import bindings
from envgraph.rewrite.engine._recordings import Recordings
from envgraph.rewrite.engine._selection import By, Choose, Where, among, choose_one, select
from envgraph.rewrite.engine._trace import Trace
from envgraph.rewrite.events._events import Agenda, EventRule, Events, update_key
from envgraph.rewrite.events._jobs import Event, Job, bind_job, job_name
from envgraph.rewrite.events._listening import (
    Listener,
    UpdateListener,
    check_functions,
    told_matches,
    told_updates,
)
from envgraph.rewrite.explore._exploration import Exploration
from envgraph.rewrite.explore._explore import Sameness, Search, Strategy, movers
from envgraph.rewrite.run._run import (
    STEP_LIMIT,
    UNSET,
    Environment,
    Run,
    apply_one_of,
    draw_weighted,
    fire_one,
    fire_one_of,
)
from envgraph.rewrite.run._runner import NO_ARGUMENTS, REFUSALS, PythonRule, Randomness, RuleRunner, draw
from envgraph.rewrite.run._units import RunResult, UnitProgram

if TYPE_CHECKING:
    import numpy

Predicate = str | Callable[["Engine"], bool]
_NOTHING: AbstractContextManager[None] = nullcontext()


class Engine(Recordings):
    """A model together with what can be asked of it and done to it.

    Names of patterns, rules, units and groups may be qualified (`package.name`), or simple where only one definition
    has that name.

    >>> from envgraph.metamodel import Attribute, Class, Metamodel, Scalar
    >>> from envgraph.pattern import Constant, LeftSide, Modification, Node, Rule, Set, Variable
    >>> model = Model(Metamodel("lamps", [Class("Lamp", features=(Attribute("lit", Scalar.BOOL),))]))
    >>> lamp = model.create("Lamp")
    >>> light = Modification((Set(Variable("lamp"), "lit", "=", Constant(True)),))
    >>> engine = Engine(model)
    >>> engine.add(Rule("light", left=LeftSide((Node("lamp", "Lamp"),)), right=light))
    >>> engine.apply("light").match.names, lamp.lit
    (('lamp',), True)

    Args:
        model: the model; it may also be changed directly.
        seed: of `rng`.
        matcher: "compiled", which can watch patterns, or "naive": slow, and sure.

    Attributes:
        model: the model.
        library: the registered patterns; the left sides of rules are among them under names like `rule#lhs`.
        matcher: finds the matches.
        step_limit: how many calls and rounds one `run` may take, and how often event rules may fire until they rest.
    """

    def __init__(
        self, model: Model, *, seed: int = 0, matcher: Literal["compiled", "naive"] = "compiled"
    ) -> None:
        super().__init__(model, matcher)
        self.step_limit = limit(STEP_LIMIT)
        self.seed = seed
        self._rng: numpy.random.Generator | None = None
        self._choices: dict[tuple[str, ...], _Choice] = {}
        self._named: dict[str, RuleRunner] = {}
        self._events: Events | None = None

    def copy(self) -> Engine:
        """An independent engine: the same state of the model, the same definitions and watched patterns.

        Its random choices begin anew from `seed`. Versions, listeners, event rules, rules and units made of Python
        functions, and units that call those, stay behind: a function that changes models belongs to the engine that it
        was registered with.
        """
        twin = Engine(
            self.model.copy(),
            seed=self.seed,
            matcher="compiled" if isinstance(self.matcher, ViewMatcher) else "naive",
        )
        twin.add(*self._without_functions())
        for name, function in self.library.functions.items():
            twin.library.functions[name].code = function.code
        twin.step_limit = self.step_limit
        if self.watched:
            twin._views.watch(*(name for name in self.watched if name in twin.library.names()))
        return twin

    __copy__ = copy

    def __deepcopy__(self, _: object) -> Engine:
        return self.copy()

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "an engine cannot be pickled: send its model, and make an engine with the definitions there"
        )

    def __repr__(self) -> str:
        return f"<Engine on {self.model!r}: {len(self.rules)} rules>"

    @property
    def rng(self) -> numpy.random.Generator:
        """The generator behind every random choice: seeded with `seed` when it is first needed, and settable.

        Without NumPy, a `random.Random` of the same seed stands in; its choices are others.
        """
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

    def _forget(self) -> None:
        super()._forget()
        self._choices.clear()
        self._named.clear()

    # --- views

    def listen(
        self,
        name: str,
        changed: Listener,
        restored: Listener | None = None,
        *,
        updated: UpdateListener | None = None,
        key: Iterable[str] | None = None,
    ) -> Subscription:
        """Be told the net changes of the matches of a pattern, which is watched from now on.

        They are told at the end of the outermost transaction (`apply` and `run` are transactions), at a commit, and by
        `settle`; changes that were rolled back are never told.

        Args:
            name: of the pattern or rule.
            changed: called with the matches that have appeared, and those that have disappeared, since it was last
                called.
            restored: called instead with what a checkout has changed; else the others are called.
            updated: called first with the matches that were replaced by one with the same key, each with the one that
                is there now. `changed` is called with the rest, if there is any.
            key: variables, as for `on`.

        Returns:
            For `unlisten`.

        Raises:
            InvalidArgument, TransactionError: as `watch`; `key` without `updated`, and an impossible key.
        """
        shape, pattern = self._asked(name)
        check_functions(changed, *(one for one in (restored, updated) if one is not None))
        if updated is not None:
            places = update_key(self.library.get(pattern), shape, key)
            call = told_updates(self.model, shape, changed, updated, places)
        elif key is None:
            call = told_matches(self.model, shape, changed)
        else:
            raise InvalidArgument("`key` says which matches are `updated`: give a function for these")
        later = None if restored is None else told_matches(self.model, shape, restored)
        return self._views.listen(pattern, call, later)

    def unlisten(self, subscription: Subscription) -> None:
        """Take back a `listen`.

        Raises:
            InvalidArgument: that is nothing that `listen` gave.
        """
        if not isinstance(subscription, Subscription):
            raise InvalidArgument(f"{subscription!r} is nothing that `listen` gave")
        self._views.unlisten(subscription)

    def settle(self) -> None:
        """Tell listeners now what has changed since they were last told, and let event rules fire what is pending.

        Raises:
            EvaluationError: event rules go round; see `step_limit`.
            Exception: what the job of an event rule has raised.
        """
        if isinstance(self.matcher, ViewMatcher):
            self.matcher.deliver()
        if self._events is not None:
            self._events.run()

    # --- events

    def on(
        self,
        pattern: str,
        *,
        appear: Job | None = None,
        disappear: Job | None = None,
        update: Job | None = None,
        priority: int = 0,
        name: str | None = None,
        key: Iterable[str] | None = None,
        existing: bool = True,
    ) -> EventRule:
        """Do something whenever matches of a pattern appear, disappear or are updated; it is watched from now on.

        A job is a function, which takes variables of the match by name, as `Node`s or values, and `engine`, `match`
        and (for an update) `old`, the match before, if it has such parameters; or the name of a rule, group or unit,
        whose variables are bound to those of the match that have the same names.

        Jobs are done when the outermost transaction ends, at a commit, and when asked to `settle`, each in a
        transaction of its own, until nothing is left to do. `_events` tells the order, and when a job is dropped.

        Args:
            pattern: its name.
            appear: done at a new match.
            disappear: done at a match that is gone. Its objects may be gone too: the node of one has only its `id`.
            update: done instead of both where a match is replaced by another one with the same key.
            priority: higher ones are done first.
            name: for messages; else that of the first job.
            key: variables; else those after `forEach` in `@FunctionalDependency`, else those that stand for objects.
            existing: the present matches count as new: `appear` is done for them when the engine next settles.

        Raises:
            InvalidArgument: an unknown name, no job, a job that takes something else, a key that contains all variables
                where there is an `update`; a pattern that cannot be watched.
            TransactionError: as `watch`.
        """
        views = self._views
        shape, qualified = self._asked(pattern)
        given = {"appear": appear, "disappear": disappear, "update": update}
        jobs = [(cast("Event", event), job) for event, job in given.items() if job is not None]
        if not jobs:
            raise InvalidArgument("an event rule does something: give `appear`, `disappear` or `update`")
        bound = {event: bind_job(self, shape, event, job) for event, job in jobs}
        places = (
            update_key(self.library.get(qualified), shape, key)
            if update is not None or key is not None
            else ()
        )
        events = self._events or Events(self, views)
        calls = [self.signature(job).name for _, job in jobs if isinstance(job, str)]
        rule = EventRule(events, name or job_name(jobs[0][1]), shape, bound, priority, places, calls)
        events.add(rule, qualified, existing)
        self._events = events
        return rule

    @property
    def agenda(self) -> Agenda:
        """What event rules are about to do, in that order."""
        return Agenda(self._events)

    def _holders(self, names: Collection[str]) -> Iterator[str]:
        owner = self._owners()
        for rule in () if self._events is None else self._events.rules:
            if any(owner(name) in names for name in rule.calls):
                yield f"event rule `{rule.name}`"
        yield from super()._holders(names)

    def _holding(self) -> AbstractContextManager[None] | None:
        """At the end of the block, not inside it, event rules fire and listeners are told; None if there are none."""
        if self._events is not None:
            return self._events.held()
        matcher = self.matcher
        if isinstance(matcher, ViewMatcher) and matcher.heard:
            return as_context(self._telling(matcher))
        return None

    def _telling(self, matcher: ViewMatcher) -> Generator[Any, Any, None]:
        """Listeners are told at the end: by the model if there was a transaction, but many rules need none.

        The steps of an `ensured` context manager, written out.
        """
        yield
        yield 1
        if (yield 0) is None and not self.model.in_transaction:
            matcher.deliver()
        while True:
            yield 0

    def check_integrity(self) -> None:
        """Assert that model and views hold what a computation from scratch finds; for tests."""
        self.model.check_integrity()
        if isinstance(self.matcher, ViewMatcher):
            self.matcher.check_integrity()

    # --- rewriting

    def apply(
        self,
        rule: str,
        match: Match | None = None,
        /,
        *,
        choose: Choose = "random",
        where: Where | None = None,
        by: By | None = None,
        bound: Mapping[str, object] | None = None,
        **values: object,
    ) -> Application | None:
        """Apply a rule at a match, or at one that is chosen among those that agree with the arguments.

        Where the model refuses the rule at the match that was drawn, another one is drawn of the rest; "first" and `by`
        go on to the next. Of a group (a derivation), a rule is drawn by weight among those that match, and likewise
        another one if it is refused at all of them.

        Args:
            rule: its name.
            match: a match of the rule, or None.
            choose: "random", drawn uniformly; "first", the first of `matches`; or a function that is given a list of
                matches, and returns one, or None for none.
            where: the matches to choose among: those for which a pattern of this name has a match, with its parameters
                bound to the variables of the same names; or for which an expression or a function of the match is true.
            by: an expression over the variables of the match, or a function of it: the match with the largest value is
                taken, the first of several.
            bound, **values: values of variables of the match, as in `matches`.

        Returns:
            What was done; None if there is no match.

        Raises:
            InvalidArgument: an unknown rule or variable, a match of something else, or a choice that is none.
            RuleError: the match is none any more, or the rule is refused there; else it is refused at every match. The
                model is as before.
        """
        arguments = bindings(bound, values)
        if choose != "random" or where is not None or by is not None:
            if match is not None or (by is not None and choose != "random"):
                raise InvalidArgument("one of `match`, `choose` and `by` says where the rule is applied")
            with self._holding() or _NOTHING:
                return self._apply_chosen(rule, choose, where, by, arguments)
        holding = self._holding()
        if holding is None:
            return self._apply(rule, match, arguments)
        with holding:
            return self._apply(rule, match, arguments)

    def apply_all(
        self,
        rule: str,
        /,
        *,
        where: Where | None = None,
        by: By | None = None,
        top: int | None = None,
        bound: Mapping[str, object] | None = None,
        **values: object,
    ) -> list[Application]:
        """Apply a rule at each of the matches of now that still is one when its turn comes and is not refused.

        Args:
            rule: its name.
            where: only at these matches; see `apply`.
            by: the largest value first, ties as the matches come; see `apply`.
            top: only at so many of the first; with `by`.
            bound, **values: values of variables of the match, as in `matches`.

        Returns:
            What was done, in order.

        Raises:
            InvalidArgument: an unknown rule or variable, or an impossible selection.
            RuleError: the matches of a `forall` are in conflict. The model is as before.
        """
        with self._holding() or _NOTHING:
            runner = self.prepare(rule)
            rows = runner.rows_known(self.ids(runner.shape, bindings(bound, values)))
            rows = select(self, runner, rows, where, by, top)
            self._notice()
            done: list[Application] = []
            with self.model.transaction():
                for row in rows:
                    if runner.still_holds(row):
                        try:
                            done.append(runner.application(row, runner.fire(row)))
                        except RuleError as error:
                            if error.reason not in REFUSALS:
                                raise
            self._record([application.firing for application in done])
            return done

    def _apply_chosen(
        self,
        rule: str,
        choose: Choose,
        where: Where | None,
        by: By | None,
        arguments: Mapping[str, object],
    ) -> Application | None:
        runner = self.prepare(rule)
        known = self.ids(runner.shape, arguments)
        rows: Sequence[Row] | None = None
        if choose == "first" and by is None:
            row = next(among(self, runner, runner.seek_known(known), where), None)
        else:
            rows = select(self, runner, runner.rows_known(known), where, by, None)
            row = choose_one(self, runner, rows, choose if by is None else "first", self._pick)
        if row is None:
            return None
        self._notice()
        try:
            result = runner.fire(row)
        except RuleError as error:
            if callable(choose):
                raise
            if rows is None:
                rows = select(self, runner, runner.rows_known(known), where, by, None)
            drawn = choose == "random" and by is None
            row, result = self._fire_elsewhere(runner, rows, row, error, drawn)
        self._record([Firing(runner.name, row)])
        return runner.application(row, result)

    def _pick(self, count: int) -> int:
        return draw(self.rng, count)

    def _fire_elsewhere(
        self, runner: RuleRunner, rows: Sequence[Row], row: Row, error: RuleError, drawn: bool = True
    ) -> tuple[Row, Sequence[Any]]:
        """A rule was refused at one of the rows: apply it at another one, drawn, or the next of them.

        Raises:
            RuleError: it is refused at all of them.
        """
        number = rows.index(row)
        try:
            if drawn:
                return runner.fire_another(rows, number, error, self._pick)
            return runner.fire_next(list(rows[number + 1 :]), error)
        except RuleError as last:
            if len(rows) == 1 or last.reason not in REFUSALS:
                raise
            raise last.everywhere(f"each of the {len(rows)} matches") from None

    def _apply(self, rule: str, match: Match | None, arguments: Mapping[str, object]) -> Application | None:
        runner = self._named.get(rule)
        if runner is None:
            qualified = self._directory.resolve(rule)
            if qualified in self._groups:
                return self._apply_group(qualified, match, arguments)
            runner = self._named[rule] = self.prepare(rule)
        if self._recorders:
            self._notice()
        if match is not None:
            if arguments:
                raise InvalidArgument("give a match or arguments, not both")
            row = self._row_of(runner, match)
            result = runner.apply_checked(row)
        else:
            known = self.ids(runner.shape, arguments) if arguments else NO_ARGUMENTS
            found = runner.pick_known(self.rng, known)
            if found is None:
                return None
            try:
                row, result = found, runner.fire(found)
            except RuleError as error:
                row, result = self._fire_elsewhere(runner, runner.rows_known(known), found, error)
        if self._recorders:
            self._record([Firing(runner.name, row)])
        return runner.application(row, result)

    def _apply_group(
        self, group: str, match: Match | None, arguments: Mapping[str, object]
    ) -> Application | None:
        if arguments:
            raise InvalidArgument(f"`{group}` is a group: its rules have no arguments in common")
        if match is not None:
            if match.definition not in self._groups[group]:
                raise InvalidArgument(f"{match!r} is no match of a rule of `{group}`")
            return self.apply(match.definition, match)
        self._notice()
        run = self._new_run()
        found = fire_one_of(run, [self._rules[member] for member in self._groups[group]])
        if found is None:
            if run.refusal is not None:
                raise run.refusal.everywhere(f"each match of a rule of `{group}`")
            return None
        runner, row, result = found
        self._record([Firing(runner.name, row)])
        return runner.application(row, result)

    def _row_of(self, runner: RuleRunner, match: Match) -> Row:
        if match.model is not self.model:
            raise InvalidArgument(f"{match!r} is a match in another model")
        own = {runner.name}
        if isinstance(runner, PythonRule):
            own.add(runner.pattern)
        if match.definition not in own:
            raise InvalidArgument(f"{match!r} is no match of `{runner.name}`")
        return match.row

    def run(self, unit: str, /, *, bound: Mapping[str, object] | None = None, **values: object) -> RunResult:
        """Run a unit; a rule or a group counts as a unit that calls it.

        Args:
            unit: its name.
            bound, **values: values of its parameters, as in `matches`.

        Returns:
            What was done; it is true if the run succeeded. A unit that fails keeps what it did before, unless it is
            `atomic`. In `outputs` are the values of its `out` parameters, of a rule also the objects that it created.

        Raises:
            InvalidArgument: an unknown name or argument, or a missing one.
            RuleError: the matches of a `forall` are in conflict. The model is as before.
            EvaluationError: the step limit was reached, or a value could not be computed. The model is as before.
        """
        qualified, arguments = self._directory.resolve(unit), bindings(bound, values)
        if self._events is None:
            with self._holding() or _NOTHING:
                return self._run_result(qualified, arguments)
        with self._listing(Trace()) as everything, self._holding() or _NOTHING:
            result = self._run_result(qualified, arguments)
        result.events = tuple(everything[result.applications :])
        return result

    def _run_result(self, name: str, arguments: Mapping[str, object]) -> RunResult:
        self._notice()
        run, outcome, outputs = self._run(name, arguments)
        if self._recorders:
            self._record(run.firings, run.gaps)
        failure = run.failure if outcome is None else None
        return RunResult(name, run.trace, failure, run.refusal, outputs, run.limit - run.steps)

    def _run(
        self,
        name: str,
        arguments: Mapping[str, object],
        rng: Randomness | None = None,
        *,
        strict: bool = False,
    ) -> tuple[Run, bool | None, Mapping[str, Node | Value]]:
        """A run, whether it failed (None) or else changed anything, and its outputs.

        Args:
            strict: a refusal by the model that nothing goes on from is raised, and everything is taken back.
        """
        run = self._new_run(rng)
        loops = self.matcher.loops if isinstance(self.matcher, ViewMatcher) else None
        depth = 0 if loops is None else loops.depth
        with self.model.transaction():
            try:
                outcome, outputs = self._start(run, name, arguments)
            except BaseException as error:
                if loops is not None:
                    loops.back_to(depth)
                run.abandon()
                if isinstance(error, RecursionError):
                    raise EvaluationError(f"`{name}` nests too deeply") from None
                raise
            if strict and outcome is None and run.refusal is not None:
                raise run.refusal
        return run, outcome, outputs

    def _failed_step(self, unit: str, values: Mapping[str, object]) -> tuple[str, Span | None] | None:
        run, outcome, _ = self._run(unit, values)
        text, span = run.failure
        told = text if run.refusal is None else f"{text}: {run.refusal.message}"
        return (told, span) if outcome is None else None

    def _new_run(self, rng: Randomness | None = None) -> Run:
        return Run(self.model, self.rng if rng is None else rng, self.step_limit, self.step_limit)

    def _start(
        self, run: Run, name: str, arguments: Mapping[str, object]
    ) -> tuple[bool | None, Mapping[str, Node | Value]]:
        if name in self._rules:
            return self._start_rule(run, self._rules[name], arguments)
        if name in self._groups:
            if arguments:
                raise InvalidArgument(f"`{name}` is a group: its rules have no arguments in common")
            run.failure = f"no rule of `{name}` could be applied", None
            return apply_one_of(run, [self._rules[member] for member in self._groups[name]]), {}
        program = self._units[name]
        environment = self._environment(program, arguments)
        outcome = program.run(run, environment)
        return outcome, {} if outcome is None else self._outputs(program, environment)

    def _start_rule(
        self, run: Run, rule: RuleRunner, arguments: Mapping[str, object]
    ) -> tuple[bool | None, Mapping[str, Node | Value]]:
        run.count()
        run.failure = f"`{rule.name}` has no {'such ' if arguments else ''}match", None
        found = fire_one(run, rule, rule.rows_known(self.ids(rule.shape, arguments)))
        if found is None:
            if run.refusal is not None:
                run.failure = f"`{rule.name}` was refused at each match", None
            return None, {}
        run.put(rule)
        run.put(found[0])
        application = rule.application(*found)
        return True, {**application.created, **application.outputs}

    def _outputs(self, program: UnitProgram, environment: Environment) -> dict[str, Node | Value]:
        found: dict[str, Node | Value] = {}
        for parameter in program.signature.parameters:
            value = environment.get(parameter.name, UNSET)
            if parameter.output and value is not UNSET:
                is_object = isinstance(parameter.type, ObjectType)
                found[parameter.name] = Node(self.model, cast("int", value)) if is_object else value
        return found

    def _environment(self, program: UnitProgram, arguments: Mapping[str, object]) -> dict[str, Value]:
        taken = program.signature.parameters
        if not taken and not arguments:
            return {}
        types = tuple(parameter.type for parameter in taken)
        assert all(type_ is not None for type_ in types), "parameters of units have types"
        shape = Shape(program.name, tuple(p.name for p in taken), cast("Any", types))
        environment = self.ids(shape, arguments)
        missing = [p.name for p in taken if p.required and p.name not in environment]
        if missing:
            names = ", ".join(f"`{name}`" for name in missing)
            raise InvalidArgument(f"unit `{program.name}` needs values for {names}")
        return environment

    # --- choosing, recording, replaying

    def choose(self, names: Iterable[str], rng: Randomness | None = None) -> tuple[str, Row] | None:
        """Draw a rule by weight among those with a match, then one of its matches uniformly; nothing is applied.

        Args:
            names: of rules, groups and units. A unit takes part with its weight, always, and an empty row.
            rng: instead of `rng` of the engine.

        Returns:
            Name of the rule and the match, for `fire`; None if no rule has a match.
        """
        key = tuple(names)
        if key not in self._choices:
            members = [member for name in key for member in self.group(name)]
            self._choices[key] = _Choice(
                [self._rules.get(member) or self._units[member] for member in dict.fromkeys(members)]
            )
        return self._choices[key].draw(self.rng if rng is None else rng)

    def fire(self, name: str, row: Row = ()) -> tuple[Firing, ...]:
        """Do what `choose` chose, unchecked: apply a rule at a row, or run a unit.

        Returns:
            What was applied, for `replay`; empty if a unit found nothing to do. What event rules applied at the end is
            part of it, unless this is inside a transaction: then they wait for its end.

        Raises:
            RuleError: it cannot be applied; the model is as before.
        """
        if self._events is None:
            with self._holding() or _NOTHING:
                return self._fire(name, row)
        with self._listing(Trace()) as everything, self._holding() or _NOTHING:
            self._fire(name, row)
        return tuple(everything)

    def _fire(self, name: str, row: Row) -> tuple[Firing, ...]:
        self._notice()
        runner = self._rules.get(name)
        if runner is not None:
            trace: tuple[Firing, ...] = (runner.apply_row(row),)
            gaps: Sequence[int] = ()
        else:
            run = self._run(self._directory.resolve(name), {}, strict=True)[0]
            trace, gaps = tuple(run.firings), run.gaps
        if self._recorders:
            self._record(trace, gaps)
        return trace

    def replay(self, trace: Iterable[tuple[str, Sequence[Value]]]) -> None:
        """Apply rules at recorded matches, in order: from an equal state it leads to an equal state, ids included.

        Event rules do not fire: what they applied is part of the trace. The states that a `Trace` knows have to come
        again; for any other state give a list of its applications.

        Raises:
            InvalidArgument: an unknown rule, or a row of another length.
            RuleError: a row is no match (reason "stale-match"), or a rule cannot be applied. Nothing is applied then.
            TraceError: the run began, or an application led, to another state when it was recorded; or any of the
                above, if the trace was read from a text. Nothing is applied then.
        """
        self._notice()
        done: list[Firing] = []
        known = trace if isinstance(trace, Trace) else None
        muted = _NOTHING if self._events is None else self._events.muted()
        with muted, self.model.transaction():
            if known is not None:
                known.check(0, self.model.state_hash())
            for name, values in trace:
                runner, row = self.prepare(name), tuple(values)
                if len(row) != len(runner.shape.names):
                    raise InvalidArgument(
                        f"a match of `{name}` has {len(runner.shape.names)} values, not {len(row)}"
                    )
                try:
                    runner.apply_checked(row)
                except (RuleError, EvaluationError) as error:
                    if known is not None and known.spans:
                        raise known.refused(len(done) + 1, error) from error
                    raise
                done.append(Firing(runner.name, row))
                if known is not None:
                    known.check(len(done), self.model.state_hash())
        self._record(done)

    # --- exploring

    def explore(
        self,
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
        """The states that rules, groups and units can reach from the present one, and how.

        From each state every rule is applied at every match; a unit runs in every way in which its random choices may
        turn out. Weights and priorities of rules do not count, and event rules do not fire. Two states are one if
        they have the same objects with the same values and links. Afterwards the engine is in the state in which it
        was, also after an exception or Ctrl-C. The result is a function of the state and the arguments.

        Args:
            rules: names.
            limit: how many states there may be; with more, the exploration ends, and says so.
            depth: how many moves a state may be away: deeper ones are not looked for. With strategy "breadth".
            strategy: "breadth": states with few moves first, so that paths are the shortest; or "depth".
            up_to: "isomorphism": states that differ by ids alone are one. Rules that create objects need it, where
                they come back to what was there before.
            goal: where to stop: the name of a pattern or rule, which has a match then, or a function of the engine.
                Functions only look at the model.
            predicates: names, or names of your choice for such goals; asked of every state.
            keep: hold a version of every state, for `checkout`. Uncommitted changes are committed first.

        Raises:
            InvalidArgument: an unknown name, a unit or rule that needs values, a limit below 1, an impossible depth.
            TransactionError: versions are to be kept, inside a transaction.
            RuleError, EvaluationError: a rule or unit is wrong; not if the model only refuses an application.
        """
        if isinstance(predicates, str):
            predicates = (predicates,)
        if not isinstance(predicates, Iterable):
            raise InvalidArgument(f"predicates are given by their names, not as {predicates!r}")
        asked = predicates if isinstance(predicates, Mapping) else {name: name for name in predicates}
        search = Search(
            self.model,
            movers(self, [rules] if isinstance(rules, str) else rules, self._explored),
            {name: self._test(predicate) for name, predicate in asked.items()},
            None if goal is None else self._test(goal),
            limit,
            depth,
            strategy,
            up_to,
            keep,
        )
        with self._aside():
            return search.run()

    def _explored(self, name: str, arguments: Mapping[str, object], rng: Randomness) -> list[Firing]:
        return self._run(name, arguments, rng, strict=True)[0].firings

    def _test(self, predicate: Predicate) -> Callable[[], bool]:
        if callable(predicate):
            return lambda: bool(predicate(self))
        if not isinstance(predicate, str):
            raise InvalidArgument(f"a predicate is the name of a pattern or a function, not {predicate!r}")
        _, pattern, free = self._question(predicate, {})
        return lambda: self.matcher.exists(pattern, free)

    @ensured
    def lent(self, rng: Randomness) -> Iterator[Trace]:
        """Inside the block random choices are made by another generator, and what is applied is only noted here."""
        recorders, own, trace = self._recorders, self._rng, Trace(start=self.model.state_hash())
        self._recorders, self._rng = [trace], cast("numpy.random.Generator", rng)
        try:
            yield trace
        finally:
            self._recorders, self._rng = recorders, own

    @ensured
    def _aside(self) -> Iterator[None]:
        """Nothing notices the block, which leaves the model as it was: listeners, event rules, recordings, `rng`."""
        recorders, rng = self._recorders, self._rng
        views = self.matcher.unheard() if isinstance(self.matcher, ViewMatcher) else _NOTHING
        events = _NOTHING if self._events is None else self._events.asleep()
        with views, events:
            self._recorders, self._rng = [], deepcopy(rng)
            try:
                yield
            finally:
                self._recorders, self._rng = recorders, rng

    # --- transactions and versions

    def transaction(self) -> AbstractContextManager[Savepoint]:
        """Everything inside happens, or, if an exception leaves the block, nothing of it. Transactions nest."""
        plain = not self._recorders and self._holding() is None
        return self.model.transaction() if plain else self._transaction()

    @ensured
    def _transaction(self) -> Iterator[Savepoint]:
        lengths = [(recorder, len(recorder)) for recorder in self._recorders]
        with self._holding() or _NOTHING:
            try:
                with self.model.transaction() as savepoint:
                    yield savepoint
            except BaseException:
                for recorder, length in lengths:
                    recorder.cut(length)
                raise

    def commit(self) -> Version:
        """Name the present state of the model, after event rules have done what is pending.

        Raises:
            TransactionError: inside a transaction.
        """
        if self._events is not None:
            self._events.run()
        return self.model.commit()

    def checkout(self, version: Version, *, discard: bool = False) -> None:
        """Put the model into a committed state, exactly as it was then.

        Raises:
            InvalidArgument: that is no version.
            TransactionError: inside a transaction, a version of another model, or uncommitted changes that are not
                to be discarded.
        """
        self.model.checkout(version, discard=discard)


class _Choice:
    """A weighted random choice among rules; see `Engine.choose`."""

    def __init__(self, members: Sequence[RuleRunner | UnitProgram]) -> None:
        self.members = members

    def draw(self, rng: Randomness) -> tuple[str, Row] | None:
        live = [m for m in self.members if isinstance(m, UnitProgram) or m.exists()]
        if not live:
            return None
        chosen = live[draw_weighted(rng, [member.weight for member in live])]
        if isinstance(chosen, UnitProgram):
            return chosen.name, ()
        row = chosen.pick(rng)
        assert row is not None, "the rule has a match"
        return chosen.name, row
