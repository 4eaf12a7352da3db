"""Queries of an engine: matches, plans, reasons for missing matches, and watched patterns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import islice, repeat
from typing import Final, Literal, cast

from envgraph.errors import InvalidArgument
from envgraph.graph import Node
from envgraph.match import FREE, BodyFailure, Explanation, ViewMatcher, WhyNot
from envgraph.metamodel import Value
from envgraph.rewrite._matches import Match, Matches, Row, Shape
from envgraph.rewrite.engine._catalog import Catalog, merge_bindings
from envgraph.rewrite.engine._unit_runs import EngineRuns
from envgraph.rewrite.run._rule_runner import GraphRule

_NO_VALUES: Final[Mapping[str, object]] = {}


class Queries:
    """The queries of an engine about the matches of its definitions; trial applications are undone."""

    def __init__(self, catalog: Catalog, runs: EngineRuns) -> None:
        self._catalog = catalog
        self._model = catalog.model
        self._matcher = catalog.matcher
        self._runs = runs

    def matches(
        self,
        name: str,
        /,
        *,
        applicable: bool = False,
        bound: Mapping[str, object] | None = None,
        **values: object,
    ) -> Matches:
        """Return all matches of a pattern, or of the LHS of a rule, that agree with the bound variables.

        The order depends only on the version of the model.

        Args:
            name: name of the pattern or rule.
            applicable: if True, return only matches at which the rule is not refused (by a dangling edge, a full
                reference, ..). The rule is applied at each match and undone; listeners are not notified, but the
                function of a Python rule is called.
            bound: values of variables; objects as `Node`s or ids.
            **values: the same, for variables whose names are possible as keywords.

        Raises:
            InvalidArgument: a name or variable is unknown, a variable has two values, or `applicable` is given for a
                pattern.
            TypeMismatch: a value has the wrong type.
            RuleError, EvaluationError: a trial application fails for another reason than a refusal.
        """
        shape, pattern, arguments = self.resolve_query(name, bound, values)
        rows = self._matcher.rows(pattern, arguments)
        if applicable is not False:
            rows = self._applicable_rows(name, applicable, shape, rows, len(rows))
        return Matches(Match(self._model, shape, row) for row in rows)

    def first(
        self,
        name: str,
        /,
        *,
        applicable: bool = False,
        bound: Mapping[str, object] | None = None,
        **values: object,
    ) -> Match | None:
        """Return the first match of `matches`, or None."""
        shape, pattern, arguments = self.resolve_query(name, bound, values)
        if applicable is not False:
            rows = self._matcher.rows(pattern, arguments)
            row = next(iter(self._applicable_rows(name, applicable, shape, rows, 1)), None)
        else:
            row = self._matcher.first(pattern, arguments)
        return None if row is None else Match(self._model, shape, row)

    def exists(
        self,
        name: str,
        /,
        *,
        applicable: bool = False,
        bound: Mapping[str, object] | None = None,
        **values: object,
    ) -> bool:
        """Return True if `matches` would return at least one match."""
        if applicable is not False:
            return self.first(name, applicable=applicable, bound=bound, **values) is not None
        _, pattern, arguments = self.resolve_query(name, bound, values)
        return self._matcher.exists(pattern, arguments)

    def count(
        self,
        name: str,
        /,
        *,
        applicable: bool = False,
        bound: Mapping[str, object] | None = None,
        **values: object,
    ) -> int:
        """Return the number of matches that `matches` would return."""
        if applicable is not False:
            return len(self.matches(name, applicable=applicable, bound=bound, **values))
        _, pattern, arguments = self.resolve_query(name, bound, values)
        return self._matcher.count(pattern, arguments)

    def _applicable_rows(self, name: str, asked: object, shape: Shape, rows: Sequence[Row], max_rows: int) -> list[Row]:
        """Return the first `max_rows` rows at which a rule is not refused, by applications that are undone.

        Raise an `InvalidArgument` if `asked`, the value of `applicable`, is not True, or if `name` is no rule.
        """
        if asked is not True:
            message = f"`applicable` must be True or False, not {asked!r}"
            raise InvalidArgument(f"{message}; to bind a variable of that name, write `bound={{'applicable': ..}}`")
        runner = self._catalog.runners.get(shape.definition)
        if runner is None:
            raise InvalidArgument(f"`{name}` is a pattern, but `applicable` needs a rule")
        with self._runs.unnoticed():
            return list(islice(filter(runner.is_applicable, list(rows)), max_rows))

    def explain(
        self, name: str, /, *variables: str, bound: Mapping[str, object] | None = None, **values: object
    ) -> Explanation:
        """Return an explanation of how matches are found, or, for a watched pattern, how its view is updated.

        The plan has estimated numbers of rows. Without bound variables, or with values for them, the plan is also
        executed and has actual numbers. The generated source follows.

        Args:
            name: name of the pattern or rule.
            *variables: names of the bound variables.
            bound: values of variables; objects as `Node`s or ids.
            **values: the same, for variables whose names are possible as keywords.

        Raises:
            InvalidArgument: a name or variable is unknown, both names and values are given, or the matcher has no
                plans.
            TypeMismatch: a value has the wrong type.
        """
        shape, pattern, needed = self._catalog.query_target(name)
        if not isinstance(self._matcher, ViewMatcher):
            raise InvalidArgument("the naive matcher has no plans; create the engine with a `ViewMatcher`")
        known = self._positions(shape, merge_bindings(bound, values))
        if variables and known:
            raise InvalidArgument("pass either names of variables or values for them, not both")
        positions = tuple(sorted(known)) or tuple(sorted(shape.position(variable) for variable in variables))
        _check_needed(shape, [one for one in needed if shape.position(one) not in positions])
        text = self._matcher.explain(pattern, positions, [known[position] for position in sorted(known)])
        if pattern.endswith("#lhs"):
            text = "rule " + text.removeprefix("pattern ").replace(pattern, shape.definition, 1)
        return Explanation(text)

    def why_not(self, name: str, /, *, bound: Mapping[str, object] | None = None, **values: object) -> WhyNot:
        """Explain why a pattern or rule has no match: the largest partial match, and the condition that it fails.

        A rule that has a match is applied there and undone: `refusal` of the result says why it cannot be applied. A
        unit is run and undone: the result names the step that fails. For a group, each rule is explained.

        Args:
            name: name of the pattern, rule, unit or group.
            bound: values of variables or, for a unit, of parameters; objects as `Node`s or ids.
            **values: the same, for names that are possible as keywords.

        Returns:
            An explanation that `print` shows as text; if there is a match, it contains this match.

        Raises:
            InvalidArgument: a name or variable is unknown, an object was deleted, or the matcher has no plans.
            TypeMismatch: a value has the wrong type.
        """
        given = merge_bindings(bound, values)
        qualified = self._catalog.directory_with_patterns().resolve(name, "pattern or rule")
        if qualified in self._catalog.programs:
            return self._why_failed(qualified, given)
        if qualified in self._catalog.members:
            rules = [self.why_not(rule, bound=given) for rule in self._catalog.members[qualified]]
            applicable = next((one for one in rules if one.match is not None and one.refusal is None), None)
            failures = tuple(BodyFailure(0, {}, "", inner=one) for one in rules)
            return applicable or WhyNot(qualified, {}, None, failures, show=self._model.graph.describe, kind="group")
        shape, pattern, _ = self._catalog.query_target(name)
        if not isinstance(self._matcher, ViewMatcher):
            raise InvalidArgument("the naive matcher has no plans; create the engine with a `ViewMatcher`")
        known = self._positions(shape, given)
        found = self._matcher.why_not(pattern, known)
        runner, refusal = self._catalog.runners.get(shape.definition), None
        if found.match is not None and isinstance(runner, GraphRule):
            with self._runs.unnoticed():
                refusal = runner.refusal_at(tuple(found.match[name] for name in shape.names))
        kind: Literal["rule", "pattern"] = "pattern" if runner is None else "rule"
        return replace(found, pattern=shape.definition, show=self._model.graph.describe, refusal=refusal, kind=kind)

    def _why_failed(self, unit: str, values: Mapping[str, object]) -> WhyNot:
        """Run a unit, undo it, and return an explanation with the step that failed."""
        given = {name: value.id if isinstance(value, Node) else cast("Value", value) for name, value in values.items()}
        objects = tuple(name for name, value in values.items() if isinstance(value, Node))
        with self._runs.unnoticed():
            savepoint = self._model.graph.history.savepoint()
            try:
                failed = self._runs.failed_step(unit, values)
            finally:
                self._model.graph.history.rollback(savepoint)
        failures = () if failed is None else (BodyFailure(0, {}, failed[0], span=failed[1]),)
        match: Mapping[str, Value] | None = {} if failed is None else None
        return WhyNot(unit, given, match, failures, objects, self._model.graph.describe, kind="unit")

    def _positions(self, shape: Shape, values: Mapping[str, object]) -> dict[int, Value]:
        ids = self._catalog.check_bindings(shape, values)
        return {shape.position(variable): ids[variable] for variable in ids}

    def analyze(self) -> None:
        """Measure the model, so that later plans use its current numbers of objects and links.

        Plans of watched patterns always use measured numbers. Other plans use numbers that the metamodel suggests
        until this is called, so that the order of matches does not depend on the time of the first query.
        """
        if isinstance(self._matcher, ViewMatcher):
            self._matcher.analyze()

    @property
    def watched(self) -> tuple[str, ...]:
        """Return the qualified names of the watched patterns; () if the matcher cannot watch."""
        return self._catalog.view_matcher.watched if isinstance(self._matcher, ViewMatcher) else ()

    def watch(self, *names: str) -> None:
        """Keep the matches of patterns, and of LHSs of rules, up to date from now on.

        Queries then only read them, and every change of the model also updates them. Watch all patterns in one call
        and before the first commit, because each call recompiles the functions of all views. Only one engine of a
        model can watch.

        Raises:
            InvalidArgument: a name is unknown, a pattern is a `search` pattern or needs values for parameters, or
                another engine of the model watches.
            TransactionError: inside a transaction, or while a version of the model is in use.
        """
        self._catalog.view_matcher.watch(*(self._catalog.query_target(name).pattern for name in names))

    def unwatch(self, *names: str) -> None:
        """Stop updating the matches of patterns; queries search for them again.

        Raises:
            InvalidArgument: a name is unknown, or has a listener.
        """
        self._catalog.view_matcher.unwatch(*(self._catalog.query_target(name).pattern for name in names))

    def resolve_query(
        self, name: str, bound: Mapping[str, object] | None = None, values: Mapping[str, object] = _NO_VALUES
    ) -> tuple[Shape, str, tuple[object, ...]]:
        """Return the shape of the matches, the qualified name of the pattern, and an argument for each parameter.

        Arguments are ids, values, or `FREE` for parameters without a value.

        Raises:
            InvalidArgument, TypeMismatch: as `matches`.
        """
        shape, pattern, needed = self._catalog.query_target(name)
        given = values if bound is None else merge_bindings(bound, values)
        if not given and not needed:
            return shape, pattern, (FREE,) * len(shape.names)
        ids = self._catalog.check_bindings(shape, given)
        _check_needed(shape, [variable for variable in needed if variable not in ids])
        return shape, pattern, tuple(map(ids.get, shape.names, repeat(FREE)))


def _check_needed(shape: Shape, missing: Sequence[str]) -> None:
    """Raise InvalidArgument if variables that need values have none."""
    if missing:
        names = ", ".join(f"`{variable}`" for variable in missing)
        raise InvalidArgument(f"`{shape.definition}` needs values for {names}: matching cannot enumerate them")
