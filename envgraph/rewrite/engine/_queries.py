"""Queries to an engine: matches, plans, reasons, and which patterns are watched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import islice, repeat
from typing import Final, Literal, cast

from envgraph.errors import InvalidArgument
from envgraph.graph import Node
from envgraph.match import FREE, Explanation, Failure, ViewMatcher, WhyNot
from envgraph.metamodel import Value
from envgraph.rewrite._match import Match, Matches, Row, Shape
from envgraph.rewrite.engine._catalog import Catalog, bindings
from envgraph.rewrite.engine._runs import Runs
from envgraph.rewrite.run._runner import GraphRule

_NONE: Final[Mapping[str, object]] = {}


class Queries:
    """Asks a matcher about the definitions of a catalog; what is only tried, `runs` undoes."""

    def __init__(self, catalog: Catalog, runs: Runs) -> None:
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
        """All matches of a pattern, or of the left side of a rule, that agree with the bound variables.

        The order is a function of the model's version.

        Args:
            name: of the pattern or rule.
            applicable: only those matches of a rule at which the model does not refuse it (a dangling link, a full
                reference ...). The rule is tried at each of them, and undone; nobody notices, but the function of
                a Python rule is called.
            bound: values of variables; objects as `Node`s or ids.
            **values: the same, where the name of the variable is none of Python's.

        Raises:
            InvalidArgument: an unknown name or variable, or one with two values; `applicable` of a pattern.
            TypeMismatch: a value of the wrong type.
            RuleError, EvaluationError: the rule fails where it is tried, and it is no refusal.
        """
        shape, pattern, arguments = self.question(name, bound, values)
        rows = self._matcher.rows(pattern, arguments)
        if applicable is not False:
            rows = self._applicable(name, applicable, shape, rows, len(rows))
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
        """The first of `matches`, or None."""
        shape, pattern, arguments = self.question(name, bound, values)
        if applicable is not False:
            rows = self._matcher.rows(pattern, arguments)
            row = next(iter(self._applicable(name, applicable, shape, rows, 1)), None)
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
        """Return whether there is one of `matches`."""
        if applicable is not False:
            return self.first(name, applicable=applicable, bound=bound, **values) is not None
        _, pattern, arguments = self.question(name, bound, values)
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
        """The number of `matches`."""
        if applicable is not False:
            return len(self.matches(name, applicable=applicable, bound=bound, **values))
        _, pattern, arguments = self.question(name, bound, values)
        return self._matcher.count(pattern, arguments)

    def _applicable(
        self, name: str, asked: object, shape: Shape, rows: Sequence[Row], most: int
    ) -> list[Row]:
        """The first matches at which a rule is not refused; `asked` is what `applicable` was given."""
        if asked is not True:
            message = f"`applicable` is True or False, not {asked!r}"
            raise InvalidArgument(
                f"{message}; a variable of that name is given as `bound={{'applicable': ..}}`"
            )
        runner = self._catalog.runners.get(shape.definition)
        if runner is None:
            raise InvalidArgument(f"`{name}` is a pattern: only rules are applied")
        with self._runs.aside():
            return list(islice(filter(runner.is_applicable, list(rows)), most))

    def explain(
        self, name: str, /, *variables: str, bound: Mapping[str, object] | None = None, **values: object
    ) -> Explanation:
        """Return how matches are found, or, for a watched pattern, how they are kept current.

        The plan has estimated rows; for no bound variables, and for given values, it is run, and has actual rows too.
        Then comes the generated source.

        Args:
            name: of the pattern or rule.
            *variables: those that have a value.
            bound, **values: variables with their values, as in `matches`.

        Raises:
            InvalidArgument: an unknown name or variable, variables with and without values, or a matcher that has no
                plans.
            TypeMismatch: a value of the wrong type.
        """
        shape, pattern, _ = self._catalog.asked(name)
        if not isinstance(self._matcher, ViewMatcher):
            raise InvalidArgument("the naive matcher tries everything, and has no plans")
        known = self._positions(shape, bindings(bound, values))
        if variables and known:
            raise InvalidArgument("give names of variables, or values for them, not both")
        positions = tuple(sorted(known)) or tuple(sorted(shape.position(variable) for variable in variables))
        return Explanation(
            self._matcher.explain(pattern, positions, [known[position] for position in sorted(known)])
        )

    def why_not(self, name: str, /, *, bound: Mapping[str, object] | None = None, **values: object) -> WhyNot:
        """Why a pattern or rule has no match for some values: the partial match that comes furthest, and what it fails.

        A rule that has a match is tried there, and undone: `refusal` of the result says why it cannot be applied.
        A unit is run, and undone: the step that fails is reported. Of a group, each rule is asked about.

        Args:
            name: of the pattern, rule, unit or group.
            bound, **values: values of variables, as in `matches`; of parameters, as in `run`.

        Returns:
            What `print` shows as text; or the match that there is.

        Raises:
            InvalidArgument: an unknown name or variable, an object that is gone, or a matcher that has no plans.
            TypeMismatch: a value of the wrong type.
        """
        given = bindings(bound, values)
        qualified = self._catalog.everything().resolve(name, "pattern or rule")
        if qualified in self._catalog.programs:
            return self._why_failed(qualified, given)
        if qualified in self._catalog.members:
            rules = [self.why_not(rule, bound=given) for rule in self._catalog.members[qualified]]
            applicable = next((one for one in rules if one.match is not None and one.refusal is None), None)
            failures = tuple(Failure(0, {}, "", inner=one) for one in rules)
            return applicable or WhyNot(
                qualified, {}, None, failures, show=self._model.graph.describe, kind="group"
            )
        shape, pattern, _ = self._catalog.asked(name)
        if not isinstance(self._matcher, ViewMatcher):
            raise InvalidArgument("the naive matcher tries everything, and has no plans")
        known = self._positions(shape, given)
        found = self._matcher.why_not(pattern, known)
        runner, refusal = self._catalog.runners.get(shape.definition), None
        if found.match is not None and isinstance(runner, GraphRule):
            with self._runs.aside():
                refusal = runner.refusal_at(tuple(found.match[name] for name in shape.names))
        kind: Literal["rule", "pattern"] = "pattern" if runner is None else "rule"
        return replace(
            found, pattern=shape.definition, show=self._model.graph.describe, refusal=refusal, kind=kind
        )

    def _why_failed(self, unit: str, values: Mapping[str, object]) -> WhyNot:
        """Run a unit, and undo it."""
        given = {
            name: value.id if isinstance(value, Node) else cast("Value", value)
            for name, value in values.items()
        }
        objects = tuple(name for name, value in values.items() if isinstance(value, Node))
        with self._runs.aside():
            savepoint = self._model.graph.history.savepoint()
            try:
                failed = self._runs.failed_step(unit, values)
            finally:
                self._model.graph.history.rollback(savepoint)
        failures = () if failed is None else (Failure(0, {}, failed[0], span=failed[1]),)
        match: Mapping[str, Value] | None = {} if failed is None else None
        return WhyNot(unit, given, match, failures, objects, self._model.graph.describe, kind="unit")

    def _positions(self, shape: Shape, values: Mapping[str, object]) -> dict[int, Value]:
        ids = self._catalog.ids(shape, values)
        return {shape.position(variable): ids[variable] for variable in ids}

    def analyze(self) -> None:
        """Measure the model: plans that are made from now on go by the sizes that it has now.

        Watched patterns are planned by measured sizes anyway. Others go by what the metamodel suggests until
        this is called, so that the order of their matches does not depend on when they were first asked for.
        """
        if isinstance(self._matcher, ViewMatcher):
            self._matcher.analyze()

    @property
    def watched(self) -> tuple[str, ...]:
        """Qualified names of the patterns that are kept current."""
        return self._catalog.views.watched if isinstance(self._matcher, ViewMatcher) else ()

    def watch(self, *names: str) -> None:
        """Keep the matches of patterns, and of the left sides of rules, current from now on.

        Asking for them then costs nothing but reading, and every change of the model costs what it changes in them.
        Watch before the first commit, and all together: each call makes the functions of all views anew. Of several
        engines on one model, one can watch.

        Raises:
            InvalidArgument: an unknown name, a `search` pattern, one that needs values for parameters, or another
                engine of the model watches something.
            TransactionError: inside a transaction, or while somebody holds a version.
        """
        self._catalog.views.watch(*(self._catalog.asked(name).pattern for name in names))

    def unwatch(self, *names: str) -> None:
        """Look for the matches of these patterns when they are asked for again.

        Raises:
            InvalidArgument: an unknown name, or somebody listens to it.
        """
        self._catalog.views.unwatch(*(self._catalog.asked(name).pattern for name in names))

    def question(
        self, name: str, bound: Mapping[str, object] | None = None, values: Mapping[str, object] = _NONE
    ) -> tuple[Shape, str, tuple[object, ...]]:
        """The matches that are meant, the pattern that the matcher knows, and its arguments.

        Raises:
            InvalidArgument, TypeMismatch: as `matches`.
        """
        shape, pattern, needed = self._catalog.asked(name)
        given = values if bound is None else bindings(bound, values)
        if not given and not needed:
            return shape, pattern, (FREE,) * len(shape.names)
        ids = self._catalog.ids(shape, given)
        missing = ", ".join([f"`{variable}`" for variable in needed if variable not in ids])
        if missing:
            raise InvalidArgument(f"`{shape.definition}` needs values for {missing}: nothing enumerates them")
        return shape, pattern, tuple(map(ids.get, shape.names, repeat(FREE)))
