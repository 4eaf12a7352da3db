"""What can be asked of an engine: matches, plans, reasons, and which patterns are watched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from itertools import islice
from typing import Literal, cast
from weakref import ref

from envgraph.errors import InvalidArgument, Span, TypeMismatch
from envgraph.graph import Model, Node
from envgraph.match import FREE, Explanation, Failure, Matcher, NaiveMatcher, ViewMatcher, WhyNot
from envgraph.metamodel import Scalar, Value, accepts, type_name
from envgraph.pattern import Library, ObjectType, Pattern
from envgraph.rewrite._match import Match, Matches, Row, Shape
from envgraph.rewrite._names import Directory, Signature
from envgraph.rewrite.run._runner import GraphRule, RuleRunner
from envgraph.rewrite.run._units import UnitProgram


class Questions:
    """A model, patterns and rules, and a matcher that answers.

    Args:
        model: the model.
        matcher: "compiled", which can watch patterns, or "naive".
    """

    def __init__(self, model: Model, matcher: Literal["compiled", "naive"]) -> None:
        self.model = model
        self.library = Library(model.metamodel)
        if matcher not in ("compiled", "naive"):
            raise InvalidArgument(f'matcher is "compiled" or "naive", not {matcher!r}')
        self.matcher: Matcher = (ViewMatcher if matcher == "compiled" else NaiveMatcher)(model, self.library)
        if isinstance(self.matcher, ViewMatcher):
            self.matcher.user = ref(self)
        self._directory = Directory()
        self._rules: dict[str, RuleRunner] = {}
        self._units: dict[str, UnitProgram] = {}
        self._groups: dict[str, tuple[str, ...]] = {}
        self._questions: dict[str, tuple[Shape, str]] = {}

    # --- names

    def _pattern(self, name: str) -> Pattern:
        found = self.library.resolve(name)
        if found is None or "#" in found.name:
            self._directory_with_patterns().resolve(name, "pattern")
            raise InvalidArgument(f"`{name}` is not a pattern")
        return found

    def _shape(self, pattern: Pattern) -> Shape:
        names = tuple(parameter.name for parameter in pattern.parameters)
        return Shape(pattern.qualified_name, names, self.library.parameter_types(pattern.qualified_name))

    def _directory_with_patterns(self) -> Directory:
        """Everything that has matches, for names that mean nothing."""
        directory = Directory(self._directory.signatures.values())
        for pattern in self.library.patterns:
            if "#" not in pattern.name:
                directory.add(Signature(pattern.qualified_name, "rule", pattern.package))
        return directory

    # --- matches

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
                reference ...). The rule is tried at each of them, and taken back; nobody notices, but the function of
                a Python rule is called.
            bound: values of variables; objects as `Node`s or ids.
            **values: the same, where the name of the variable is none of Python's.

        Raises:
            InvalidArgument: an unknown name or variable, or one with two values; `applicable` of a pattern.
            TypeMismatch: a value of the wrong type.
            RuleError, EvaluationError: the rule fails where it is tried, and it is no refusal.
        """
        shape, pattern, arguments = self._question(name, bindings(bound, values))
        rows = self.matcher.rows(pattern, arguments)
        if applicable:
            rows = self._applicable(name, shape, rows, len(rows))
        return Matches(Match(self.model, shape, row) for row in rows)

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
        shape, pattern, arguments = self._question(name, bindings(bound, values))
        if applicable:
            row = next(iter(self._applicable(name, shape, self.matcher.rows(pattern, arguments), 1)), None)
        else:
            row = self.matcher.first(pattern, arguments)
        return None if row is None else Match(self.model, shape, row)

    def exists(
        self,
        name: str,
        /,
        *,
        applicable: bool = False,
        bound: Mapping[str, object] | None = None,
        **values: object,
    ) -> bool:
        """Whether there is one of `matches`."""
        if applicable:
            return self.first(name, applicable=True, bound=bound, **values) is not None
        _, pattern, arguments = self._question(name, bindings(bound, values))
        return self.matcher.exists(pattern, arguments)

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
        if applicable:
            return len(self.matches(name, applicable=True, bound=bound, **values))
        _, pattern, arguments = self._question(name, bindings(bound, values))
        return self.matcher.count(pattern, arguments)

    def _applicable(self, name: str, shape: Shape, rows: Sequence[Row], most: int) -> list[Row]:
        """The first matches at which a rule is not refused."""
        runner = self._rules.get(shape.definition)
        if runner is None:
            raise InvalidArgument(f"`{name}` is a pattern: only rules are applied")
        with self._aside():
            return list(islice(filter(runner.is_applicable, list(rows)), most))

    def explain(
        self, name: str, /, *variables: str, bound: Mapping[str, object] | None = None, **values: object
    ) -> Explanation:
        """How matches are found, or, for a watched pattern, how they are kept current.

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
        shape, pattern = self._asked(name)
        if not isinstance(self.matcher, ViewMatcher):
            raise InvalidArgument("the naive matcher tries everything, and has no plans")
        known = self._positions(shape, bindings(bound, values))
        if variables and known:
            raise InvalidArgument("give names of variables, or values for them, not both")
        positions = tuple(sorted(known)) or tuple(sorted(shape.position(variable) for variable in variables))
        return Explanation(
            self.matcher.explain(pattern, positions, [known[position] for position in sorted(known)])
        )

    def why_not(self, name: str, /, *, bound: Mapping[str, object] | None = None, **values: object) -> WhyNot:
        """Why a pattern or rule has no match for some values: the partial match that comes furthest, and what it fails.

        A rule that has a match is tried there, and taken back: `refusal` of the result says why it cannot be applied.
        A unit is run, and taken back: the step that fails is told. Of a group, each rule is asked about.

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
        qualified = self._directory_with_patterns().resolve(name, "pattern or rule")
        if qualified in self._units:
            return self._why_failed(qualified, given)
        if qualified in self._groups:
            rules = [self.why_not(rule, bound=given) for rule in self._groups[qualified]]
            applicable = next((one for one in rules if one.match is not None and one.refusal is None), None)
            failures = tuple(Failure(0, {}, "", inner=one) for one in rules)
            return applicable or WhyNot(qualified, {}, None, failures, show=self.model.describe, kind="group")
        shape, pattern = self._asked(name)
        if not isinstance(self.matcher, ViewMatcher):
            raise InvalidArgument("the naive matcher tries everything, and has no plans")
        known = self._positions(shape, given)
        found = self.matcher.why_not(pattern, known)
        runner, refusal = self._rules.get(shape.definition), None
        if found.match is not None and isinstance(runner, GraphRule):
            with self._aside():
                refusal = runner.refusal_at(tuple(found.match[name] for name in shape.names))
        kind: Literal["rule", "pattern"] = "pattern" if runner is None else "rule"
        return replace(found, pattern=shape.definition, show=self.model.describe, refusal=refusal, kind=kind)

    def _why_failed(self, unit: str, values: Mapping[str, object]) -> WhyNot:
        """Run a unit, and take it back."""
        given = {
            name: value.id if isinstance(value, Node) else cast("Value", value)
            for name, value in values.items()
        }
        objects = tuple(name for name, value in values.items() if isinstance(value, Node))
        with self._aside():
            savepoint = self.model.savepoint()
            try:
                failed = self._failed_step(unit, values)
            finally:
                self.model.rollback(savepoint)
        failures = () if failed is None else (Failure(0, {}, failed[0], span=failed[1]),)
        match: Mapping[str, Value] | None = {} if failed is None else None
        return WhyNot(unit, given, match, failures, objects, self.model.describe, kind="unit")

    def _failed_step(self, unit: str, values: Mapping[str, object]) -> tuple[str, Span | None] | None:
        """Run a unit: what fails, and where that is written; None if it succeeds."""
        raise NotImplementedError

    def _aside(self) -> AbstractContextManager[None]:
        """The block leaves the model as it was, and nothing may notice it."""
        return nullcontext()

    def _positions(self, shape: Shape, values: Mapping[str, object]) -> dict[int, Value]:
        ids = self.ids(shape, values)
        return {shape.position(variable): ids[variable] for variable in ids}

    def analyze(self) -> None:
        """Measure the model: plans that are made from now on go by the sizes that it has now.

        Watched patterns are planned by measured sizes anyway. Others go by what the metamodel suggests until
        this is called, so that the order of their matches does not depend on when they were first asked for.
        """
        if isinstance(self.matcher, ViewMatcher):
            self.matcher.analyze()

    # --- views

    @property
    def watched(self) -> tuple[str, ...]:
        """Qualified names of the patterns that are kept current."""
        return self._views.watched if isinstance(self.matcher, ViewMatcher) else ()

    @property
    def _views(self) -> ViewMatcher:
        if not isinstance(self.matcher, ViewMatcher):
            raise InvalidArgument("the naive matcher keeps nothing current: it cannot watch")
        return self.matcher

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
        self._views.watch(*(self._asked(name)[1] for name in names))

    def unwatch(self, *names: str) -> None:
        """Look for the matches of these patterns when they are asked for again.

        Raises:
            InvalidArgument: an unknown name, or somebody listens to it.
        """
        self._views.unwatch(*(self._asked(name)[1] for name in names))

    # --- from names to patterns

    def _question(self, name: str, bound: Mapping[str, object]) -> tuple[Shape, str, tuple[object, ...]]:
        shape, pattern = self._asked(name)
        ids = self.ids(shape, bound)
        missing = [shape.names[p] for p in self.library.inputs(pattern) if shape.names[p] not in ids]
        if missing:
            names = ", ".join(f"`{name}`" for name in missing)
            raise InvalidArgument(f"`{shape.definition}` needs values for {names}: nothing enumerates them")
        return shape, pattern, tuple(ids.get(variable, FREE) for variable in shape.names)

    def _asked(self, name: str) -> tuple[Shape, str]:
        """Shape and pattern of what has matches."""
        if not isinstance(name, str):
            raise InvalidArgument(f"a pattern or rule is given by its name, not as {name!r}")
        if name not in self._questions:
            self._questions[name] = self._find_question(name)
        return self._questions[name]

    def parameters_of(self, name: str) -> tuple[str, tuple[str, ...]]:
        """Qualified name and parameters of a pattern."""
        shape, qualified = self._asked(name)
        return qualified, shape.names

    def _find_question(self, name: str) -> tuple[Shape, str]:
        qualified = self._directory_with_patterns().resolve(name, "pattern or rule")
        if qualified in self._rules:
            runner = self._rules[qualified]
            return runner.shape, runner.pattern
        if qualified in self._groups or qualified in self._units:
            kind = self._directory.signatures[qualified].kind
            rules = ", ".join(f"`{member}`" for member in self._groups.get(qualified, ()))
            hint = f"; ask for one of its rules: {rules}" if rules else ""
            raise InvalidArgument(f"`{name}` is a {kind}, which has no matches of its own{hint}")
        pattern = self.library.get(qualified)
        return self._shape(pattern), qualified

    def ids(self, shape: Shape, bound: Mapping[str, object]) -> dict[str, Value]:
        """Values for variables, checked, objects as ids.

        Raises:
            InvalidArgument: an unknown variable, a node of another model, or an object that there is not.
            TypeMismatch: a value of the wrong type.
        """
        found: dict[str, Value] = {}
        for name, value in bound.items():
            if name not in shape.names:
                self._check_output(shape, name)
            position = shape.position(name)
            found[name] = self._id(shape, position, value)
        return found

    def _check_output(self, shape: Shape, name: str) -> None:
        """What a rule creates can be an `out` parameter without being a variable of its matches."""
        signature = self._directory.signatures.get(shape.definition)
        if signature is not None and any(one.output and one.name == name for one in signature.parameters):
            raise InvalidArgument(
                f"`{name}` is an `out` parameter of `{shape.definition}`, which creates it: "
                "it takes no value, and is in the `outputs` of the application"
            )

    def _id(self, shape: Shape, position: int, value: object) -> Value:
        type_ = shape.types[position]
        if isinstance(type_, ObjectType):
            if isinstance(value, Node) and value.model is not self.model:
                raise InvalidArgument(f"{value!r} is an object of another model")
            if isinstance(value, Node) or type(value) is int:
                node = value.id if isinstance(value, Node) else value
                if not self.model.alive(node):
                    raise InvalidArgument(
                        f"`{shape.names[position]}` of `{shape.definition}` is object {node}, which there is not: "
                        "it was never created, was deleted, or was undone"
                    )
                return node
            wanted = f"a `{type_.cls}`"
        elif accepts(type_, value):
            return float(value) if type_ is Scalar.FLOAT else cast("Value", value)  # type: ignore[arg-type]
        else:
            wanted = f"`{type_name(type_)}`"
        raise TypeMismatch(f"`{shape.names[position]}` of `{shape.definition}` takes {wanted}, not {value!r}")


def bindings(bound: Mapping[str, object] | None, values: dict[str, object]) -> Mapping[str, object]:
    """The values of variables from both ways in which people say them: a mapping, and keywords.

    Raises:
        InvalidArgument: `bound` is no mapping from names, or a variable is in both.
    """
    if bound is None:
        return values
    if not isinstance(bound, Mapping) or not all(isinstance(name, str) for name in bound):
        raise InvalidArgument(
            f"`bound` is a mapping from variables to their values, not {bound!r}; "
            "a variable of that name is given as `bound={'bound': ..}`"
        )
    twice = next((name for name in bound if name in values), None)
    if twice is not None:
        raise InvalidArgument(f"`{twice}` is given twice: in `bound`, and by itself")
    return {**bound, **values}
