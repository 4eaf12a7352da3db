"""Applications of rules and units: at a given match, at all matches, at a chosen or random match, or by replay."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from typing import Any

from envgraph.errors import EvaluationError, InvalidArgument, RuleError
from envgraph.metamodel import Value
from envgraph.rewrite._matches import Application, Firing, Match, Row
from envgraph.rewrite.engine._application_trace import Trace
from envgraph.rewrite.engine._catalog import Catalog, merge_bindings
from envgraph.rewrite.engine._engine_history import EngineHistory
from envgraph.rewrite.engine._match_selection import By, Choose, Where, choose_row, filter_rows, select_rows
from envgraph.rewrite.engine._notification import NO_CONTEXT, EngineEvents
from envgraph.rewrite.engine._unit_runs import EngineRuns
from envgraph.rewrite.run._rule_choice import RuleChoice
from envgraph.rewrite.run._rule_runner import (
    NO_ARGUMENTS,
    REFUSALS,
    PythonRule,
    Randomness,
    RuleRunner,
    draw_index,
    drawn_others,
)
from envgraph.rewrite.run._unit_programs import UnitProgram
from envgraph.rewrite.run._unit_runtime import fire_one_of


class Rewriting:
    """The part of an engine that applies rules, records the applications, and lets event rules fire afterwards."""

    def __init__(self, catalog: Catalog, events: EngineEvents, history: EngineHistory, runs: EngineRuns) -> None:
        self._catalog = catalog
        self._model = catalog.model
        self._events = events
        self._history = history
        self._runs = runs
        self._choices: dict[tuple[str, ...], list[RuleRunner | UnitProgram]] = {}
        self._runners_by_name: dict[str, RuleRunner] = {}
        catalog.caches += [self._choices, self._runners_by_name]

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
        """Apply a rule at a given match, or at a match chosen among those that agree with the arguments.

        If the rule is refused at a randomly chosen match, it is tried at other random matches; with "first" and `by`,
        at the next matches. For a group (a derivation), a rule is drawn by weight among those with a match. If this
        rule is refused at all its matches, another rule is drawn.

        Args:
            rule: name of the rule.
            match: a match of the rule, or None.
            choose: "random" draws a match uniformly; "first" takes the first of `matches`; or a function that takes a
                list of matches and returns one of them, or None for none.
            where: restricts the matches: the name of a pattern that must have a match, with its parameters bound to the
                variables of the same names; or an expression over the variables, or a function of the match, that
                must be true.
            by: an expression over the variables of the match, or a function of the match: the match with the largest
                value is taken; of several, the first.
            bound: values of variables of the match; objects as `Node`s or ids.
            **values: the same, for variables whose names are possible as keywords.

        Returns:
            The application, or None if there is no match.

        Raises:
            InvalidArgument: a rule or variable is unknown, a match is of another rule, or `choose` is invalid.
            RuleError: the match does not hold any more or the rule is refused there. If no match was given, the rule is
                refused at every match. The model is unchanged.
        """
        arguments = values if bound is None else merge_bindings(bound, values)
        if choose != "random" or where is not None or by is not None:
            if match is not None or (by is not None and choose != "random"):
                raise InvalidArgument("pass only one of `match`, `choose` and `by`")
            with self._events.delayed() or NO_CONTEXT:
                return self._apply_chosen(rule, choose, where, by, arguments)
        holding = self._events.delayed()
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
        """Apply a rule at each of its current matches, except matches that no longer hold or at which it is refused.

        Args:
            rule: name of the rule.
            where: restricts the matches; see `apply`.
            by: orders the matches by this value, largest first; equal values keep their order; see `apply`.
            top: maximal number of matches; only with `by`.
            bound: values of variables of the match; objects as `Node`s or ids.
            **values: the same, for variables whose names are possible as keywords.

        Returns:
            The applications, in order.

        Raises:
            InvalidArgument: a rule or variable is unknown, or the selection is invalid.
            RuleError: the matches of a `forall` contradict each other. The model is unchanged.
        """
        with self._events.delayed() or NO_CONTEXT:
            runner = self._catalog.prepare(rule)
            rows = runner.rows_unchecked(self._catalog.check_bindings(runner.shape, merge_bindings(bound, values)))
            rows = select_rows(self._catalog, runner, rows, where, by, top)
            self._history.check_state()
            done: list[Application] = []
            with self._model.transaction():
                for row in rows:
                    if runner.still_holds(row):
                        try:
                            done.append(runner.application(row, runner.fire(row)))
                        except RuleError as error:
                            if error.reason not in REFUSALS:
                                raise
            self._history.record([application.firing for application in done])
            return done

    def _apply_chosen(
        self,
        rule: str,
        choose: Choose,
        where: Where | None,
        by: By | None,
        arguments: Mapping[str, object],
    ) -> Application | None:
        runner = self._catalog.prepare(rule)
        known = self._catalog.check_bindings(runner.shape, arguments)
        rows: Sequence[Row] | None = None
        if choose == "first" and by is None:
            row = next(filter_rows(self._catalog, runner, runner.lazy_rows_unchecked(known), where), None)
        else:
            rows = select_rows(self._catalog, runner, runner.rows_unchecked(known), where, by, None)
            row = choose_row(self._catalog, runner, rows, choose if by is None else "first", self._draw_index)
        if row is None:
            return None
        self._history.check_state()
        try:
            result = runner.fire(row)
        except RuleError as error:
            if callable(choose):
                raise
            if rows is None:
                rows = select_rows(self._catalog, runner, runner.rows_unchecked(known), where, by, None)
            drawn = choose == "random" and by is None
            row, result = self._fire_elsewhere(runner, rows, row, error, drawn)
        self._history.record([Firing(runner.name, row)])
        return runner.application(row, result)

    def _draw_index(self, count: int) -> int:
        return draw_index(self._runs.rng, count)

    def _fire_elsewhere(
        self, runner: RuleRunner, rows: Sequence[Row], row: Row, error: RuleError, is_random: bool = True
    ) -> tuple[Row, Sequence[Any]]:
        """Apply a rule, which `error` refused at `row`, at another row: a random one if `is_random`, else a later one.

        Raises:
            RuleError: the rule is refused at all these rows.
        """
        number = rows.index(row)
        try:
            if is_random:
                return runner.fire_next(drawn_others(rows, number, self._draw_index), error)
            return runner.fire_next(list(rows[number + 1 :]), error)
        except RuleError as last:
            if len(rows) == 1 or last.reason not in REFUSALS:
                raise
            raise last.refused_everywhere(f"each of the {len(rows)} matches") from None

    def _apply(self, rule: str, match: Match | None, arguments: Mapping[str, object]) -> Application | None:
        runner = self._runners_by_name.get(rule)
        if runner is None:
            qualified = self._catalog.resolve(rule)
            if qualified in self._catalog.members:
                return self._apply_group(qualified, match, arguments)
            runner = self._runners_by_name[rule] = self._catalog.prepare(rule)
        if self._history.recorders:
            self._history.check_state()
        if match is not None:
            if arguments:
                raise InvalidArgument("pass either a match or arguments, not both")
            row = self._check_match(runner, match)
            result = runner.apply_checked(row)
        else:
            known = self._catalog.check_bindings(runner.shape, arguments) if arguments else NO_ARGUMENTS
            if known:
                rows = runner.rows_unchecked(known)
                found = rows[self._draw_index(len(rows))] if rows else None
            else:
                found = runner.pick(self._runs.rng)
            if found is None:
                return None
            try:
                row, result = found, runner.fire(found)
            except RuleError as error:
                row, result = self._fire_elsewhere(runner, runner.rows_unchecked(known), found, error)
        if self._history.recorders:
            self._history.record([Firing(runner.name, row)])
        return runner.application(row, result)

    def _apply_group(self, group: str, match: Match | None, arguments: Mapping[str, object]) -> Application | None:
        if arguments:
            raise InvalidArgument(f"`{group}` is a group, which takes no arguments")
        if match is not None:
            if match.definition not in self._catalog.members[group]:
                raise InvalidArgument(f"{match!r} is no match of a rule of `{group}`")
            return self.apply(match.definition, match)
        self._history.check_state()
        run = self._runs.new_run()
        found = fire_one_of(run, [self._catalog.runners[member] for member in self._catalog.members[group]])
        if found is None:
            if run.refusal is not None:
                raise run.refusal.refused_everywhere(f"each match of a rule of `{group}`")
            return None
        runner, row, result = found
        self._history.record([Firing(runner.name, row)])
        return runner.application(row, result)

    def _check_match(self, runner: RuleRunner, match: Match) -> Row:
        if match.model is not self._model:
            raise InvalidArgument(f"{match!r} is a match in another model")
        own = {runner.name}
        if isinstance(runner, PythonRule):
            own.add(runner.pattern)
        if match.definition not in own:
            raise InvalidArgument(f"{match!r} is no match of `{runner.name}`")
        return match.row

    def choose(self, names: Iterable[str], rng: Randomness | None = None) -> tuple[str, Row] | None:
        """Draw a rule by weight among those with a match, then one of its matches uniformly. Nothing is applied.

        Args:
            names: names of rules, groups and units. A unit always takes part with its weight, and has an empty row.
            rng: random generator; by default that of the engine.

        Returns:
            Name of the rule and row of the match, for `fire`; None if no rule has a match.
        """
        return self.choice(names).draw(self._runs.rng if rng is None else rng)

    def choice(self, names: Iterable[str], watched: Container[str] = ()) -> RuleChoice:
        """Return the options of `choose` in the current state, for drawing several times with a rollback in between.

        Args:
            names: as for `choose`.
            watched: watched patterns, whose matches need not be stored.
        """
        key = tuple(names)
        if key not in self._choices:
            members = dict.fromkeys(member for name in key for member in self._catalog.group(name))
            runners, programs = self._catalog.runners, self._catalog.programs
            self._choices[key] = [runners.get(member) or programs[member] for member in members]
        return RuleChoice(self._choices[key], watched)

    def fire(self, name: str, row: Row = ()) -> tuple[Firing, ...]:
        """Apply a rule at a row, or run a unit, as drawn by `choose`. The row is not checked.

        Returns:
            The applications, for `replay`; empty if a unit applied nothing. Applications of event rules are included,
            unless a transaction is open: then event rules fire at its end.

        Raises:
            RuleError: the rule cannot be applied; the model is unchanged.
        """
        if not self._events.has_event_rules:
            with self._events.delayed() or NO_CONTEXT:
                return self._fire(name, row)
        with self._history.recording_to(Trace()) as everything, self._events.delayed() or NO_CONTEXT:
            self._fire(name, row)
        return tuple(everything)

    def _fire(self, name: str, row: Row) -> tuple[Firing, ...]:
        self._history.check_state()
        runner = self._catalog.runners.get(name)
        if runner is not None:
            trace: tuple[Firing, ...] = (runner.apply_row(row),)
            gaps: Sequence[int] = ()
        else:
            run = self._runs.execute(self._catalog.resolve(name), {}, strict=True)[0]
            trace, gaps = tuple(run.firings), run.gaps
        if self._history.recorders:
            self._history.record(trace, gaps)
        return trace

    def replay(self, trace: Iterable[tuple[str, Sequence[Value]]]) -> None:
        """Apply rules at recorded matches, in order. From an equal state this leads to an equal state, including ids.

        Event rules do not fire, as their applications are part of the trace. If a `Trace` is given, the states must
        equal the recorded ones. To replay from another state, give a list of applications.

        Raises:
            InvalidArgument: a rule is unknown, or a row has another length.
            RuleError: a row is no match (reason "stale-match"), or a rule cannot be applied. Nothing is applied then.
            TraceError: a state differs from the recorded one. If the trace was parsed from text, also in the cases
                above. Nothing is applied then.
        """
        self._history.check_state()
        done: list[Firing] = []
        known = trace if isinstance(trace, Trace) else None
        with self._events.muted(), self._model.transaction():
            if known is not None:
                known.check_replayed_state(0, self._model.state_hash())
            for name, values in trace:
                runner, row = self._catalog.prepare(name), tuple(values)
                if len(row) != len(runner.shape.names):
                    raise InvalidArgument(f"a match of `{name}` has {len(runner.shape.names)} values, not {len(row)}")
                try:
                    runner.apply_checked(row)
                except (RuleError, EvaluationError) as error:
                    if known is not None and known.spans:
                        raise known.refused_error(len(done) + 1, error) from error
                    raise
                done.append(Firing(runner.name, row))
                if known is not None:
                    known.check_replayed_state(len(done), self._model.state_hash())
        self._history.record(done)
