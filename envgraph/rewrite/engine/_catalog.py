"""The catalog of an engine: the patterns, rules, units and groups that are defined, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from math import isfinite
from typing import Any, NamedTuple, cast

from envgraph.errors import InvalidArgument, TypeMismatch
from envgraph.graph import Model, Node
from envgraph.match import Matcher, ViewMatcher
from envgraph.metamodel import Scalar, Value, accepts, reachable_nodes, type_name
from envgraph.pattern import Applicable, Derivation, IfStep, Library, ObjectType, Pattern, Rule, Unit, UnitCall
from envgraph.rewrite._matches import Shape
from envgraph.rewrite._rule_plan import RulePlan
from envgraph.rewrite._signatures import Signature, SignatureTable
from envgraph.rewrite.check._unit_check import all_steps, as_applicability_test
from envgraph.rewrite.engine._dpo_dangling import Loss, PossibleRefusal, losses, possible_refusals
from envgraph.rewrite.engine._python_units import PythonUnit
from envgraph.rewrite.engine._registration import Definition
from envgraph.rewrite.events._jobs import job_name
from envgraph.rewrite.run._notices import Notices
from envgraph.rewrite.run._rule_runner import GraphRule, PythonRule, RuleRunner
from envgraph.rewrite.run._unit_programs import UnitProgram


class QueryTarget(NamedTuple):
    """A definition that has matches, resolved from its name.

    Attributes:
        shape: shape of the matches.
        pattern: qualified name of the pattern to match.
        inputs: variables that must be bound by the caller, because matching cannot enumerate their values.
    """

    shape: Shape
    pattern: str
    inputs: tuple[str, ...]


class Catalog:
    """The patterns, rules, units and groups that are defined over one model, by name.

    Attributes:
        model: the model.
        library: the registered patterns.
        matcher: finds the matches.
        directory: the signatures of everything that can be called.
        runners: rules by their qualified names, including members of groups.
        programs: units by their qualified names.
        members: qualified names of the rules of each group.
        added_definitions: rules, units and derivations as they were added, by qualified name.
        notices: warnings that applications have reported.
        compiled_explorations: a cache of programs for each exploration with many transitions, by its rules and tests.
        caches: caches by name; they are cleared when a definition is added or removed.
    """

    def __init__(self, model: Model, library: Library, matcher: Matcher) -> None:
        self.model = model
        self.library = library
        self.matcher = matcher
        self.directory = SignatureTable()
        self.runners: dict[str, RuleRunner] = {}
        self.programs: dict[str, UnitProgram] = {}
        self.members: dict[str, tuple[str, ...]] = {}
        self.added_definitions: dict[str, Rule | Unit | Derivation] = {}
        self.notices = Notices()
        self.compiled_explorations: dict[Any, dict[Any, Any]] = {}
        self._query_targets: dict[str, QueryTarget] = {}
        self.caches: list[dict[Any, Any]] = [self._query_targets, self.compiled_explorations]

    def clear_caches(self) -> None:
        """Clear all caches that depend on names. Call this after a definition was added, removed or replaced."""
        for memo in self.caches:
            memo.clear()

    @property
    def view_matcher(self) -> ViewMatcher:
        """Return the matcher if it can watch patterns.

        Raises:
            InvalidArgument: the matcher cannot watch.
        """
        if not isinstance(self.matcher, ViewMatcher):
            raise InvalidArgument("the naive matcher cannot watch patterns; create the engine with a `ViewMatcher`")
        return self.matcher

    # --- definitions

    def check_free_name(self, function: Callable[..., object], name: str | None, weight: float) -> str:
        """Return `name`, or by default the name of the function, after checks that the function can be registered.

        Raises:
            InvalidArgument: the function is not callable, the name is in use, or the weight is not a finite number
                above 0.
        """
        if not callable(function):
            raise InvalidArgument(f"expected a function to register, not {function!r}")
        if not (weight > 0 and isfinite(weight)):
            raise InvalidArgument(f"the weight is {weight}, but must be a finite number above 0")
        own = name or job_name(function)
        if own in self.directory.signatures or own in self.library.names():
            raise InvalidArgument(f"`{own}` is defined already: pass another name as `name`")
        return own

    @property
    def definitions(self) -> tuple[Definition, ...]:
        """Return the declared functions, patterns, rules, units and derivations as they were added."""
        functions = [function.declaration for function in self.library.functions.values()]
        patterns = [pattern for pattern in self.library.patterns if "#" not in pattern.name]
        return (*functions, *patterns, *self.added_definitions.values())

    def definition(self, name: str) -> Definition:
        """Return a pattern, rule, unit or derivation as it was added; for a derived rule, the generated rule.

        Raises:
            InvalidArgument: the name is unknown, or a Python function that has no definition as data.
        """
        qualified = self.directory_with_patterns().resolve(name, "pattern, rule, unit or group")
        if qualified in self.added_definitions:
            return self.added_definitions[qualified]
        group = next((group for group, members in self.members.items() if qualified in members), None)
        if group is not None:
            from envgraph.rewrite.derive._derive import derived_rules

            derivation = cast("Derivation", self.added_definitions[group])
            rules = derived_rules(derivation, self.model.metamodel)
            return next(rule for rule in rules if rule.qualified_name == qualified)
        if qualified in self.runners or qualified in self.programs:
            raise InvalidArgument(f"`{name}` is a Python function, which has no definition as data")
        return self.library.get(qualified)

    def group(self, name: str) -> tuple[str, ...]:
        """Return the qualified names of the rules of a derivation; for a rule or unit, its own qualified name."""
        qualified = self.resolve(name)
        return self.members.get(qualified, (qualified,))

    def signature(self, name: str) -> Signature:
        """Return the signature of a rule, unit or group."""
        return self.directory.signatures[self.resolve(name)]

    def resolve(self, name: str, what: str = "rule, unit or group") -> str:
        """Return the qualified name of a rule, unit or group.

        Raises:
            InvalidArgument: the name is unknown or ambiguous, or the name of a pattern.
        """
        try:
            return self.directory.resolve(name, what)
        except InvalidArgument:
            if not isinstance(name, str) or self.directory.candidates(name) or not self.library.resolve(name):
                raise
            raise InvalidArgument(
                f"`{name}` is a pattern, not a {what}", "call `matches`, or type `envgraph match`, to find its matches"
            ) from None

    def prepare(self, rule: str) -> RuleRunner:
        """Return the runner of a rule: a fast, unchecked interface for loops that apply a rule often.

        Raises:
            InvalidArgument: no rule has this name.
        """
        qualified = self.resolve(rule, "rule")
        if qualified not in self.runners:
            kind = self.directory.signatures[qualified].kind
            raise InvalidArgument(f"`{rule}` is a {kind}, not a rule")
        return self.runners[qualified]

    def losses(self, name: str, cls: str | None, known: Mapping[str, bool]) -> tuple[Loss, ...]:
        """Return the actions of a rule, or of rules that a unit calls, that may delete, merge or retype an object.

        Actions of Python functions are not included.

        Args:
            name: name of the rule or unit.
            cls: class of the object, or None if unknown. An object is also lost if it stops being an instance of this
                class.
            known: parameters that are the object (True) or certainly another one (False). Arguments that a unit
                passes to its callees are not followed: for the callees only classes are compared.

        Raises:
            InvalidArgument: the name is unknown.
        """
        found: dict[Loss, None] = {}
        for plan in self._plans(name):
            given = known if plan.name == self.resolve(name) else {}
            found |= dict.fromkeys(losses(plan, self.model.metamodel, cls, given))
        return tuple(found)

    def possible_refusals(self, name: str) -> tuple[PossibleRefusal, ...]:
        """Return the changes for which the model may refuse a rule, or rules that a unit calls, as `losses` does."""
        return tuple(one for plan in self._plans(name) for one in possible_refusals(plan, self.library))

    def created_classes(self, name: str) -> list[str]:
        """Return the classes of the objects that a rule creates, or that rules create which a unit calls."""
        return [create.cls for plan in self._plans(name) for block in plan.blocks for create in block.creates]

    def _plans(self, name: str) -> list[RulePlan]:
        """Return the plan of a rule, or those of the rules that a unit calls; none of Python functions."""
        runners = map(self.runners.get, self._reachable_names(name))
        return [one.plan for one in runners if isinstance(one, GraphRule)]

    def _reachable_names(self, name: str) -> list[str]:
        """Return the qualified names of a rule, unit or group and of everything that it calls, even indirectly."""

        def used(one: str) -> Iterable[str]:
            definition = self.added_definitions.get(one)
            called = sorted(self.called_names(definition)) if isinstance(definition, Unit) else ()
            return called or self.members.get(one, ())

        return reachable_nodes([self.resolve(name)], used)

    # --- from names to patterns

    def pattern(self, name: str) -> Pattern:
        """Return the pattern with this name.

        Raises:
            InvalidArgument: no pattern has this name.
        """
        found = self.library.resolve(name)
        if found is None or "#" in found.name:
            self.directory_with_patterns().resolve(name, "pattern")
            raise InvalidArgument(f"`{name}` is not a pattern")
        return found

    def shape_of(self, pattern: Pattern) -> Shape:
        """Return the shape of the matches of a pattern."""
        names = tuple(parameter.name for parameter in pattern.parameters)
        return Shape(pattern.qualified_name, names, self.library.parameter_types(pattern.qualified_name))

    def directory_with_patterns(self) -> SignatureTable:
        """Return a new directory of all rules, units and groups that contains patterns too, with the kind "rule"."""
        directory = SignatureTable(self.directory.signatures.values())
        for pattern in self.library.patterns:
            if "#" not in pattern.name:
                directory.add_or_replace(Signature(pattern.qualified_name, "rule", pattern.package))
        return directory

    def query_target(self, name: str) -> QueryTarget:
        """Return the pattern or rule with this name in the form that queries need; the result is cached.

        Raises:
            InvalidArgument: the name is unknown, or the definition has no matches.
        """
        if not isinstance(name, str):
            raise InvalidArgument(f"expected the name of a pattern or rule, not {name!r}")
        if name not in self._query_targets:
            shape, pattern = self._find_pattern(name)
            needed = tuple(shape.names[position] for position in self.library.inputs(pattern))
            self._query_targets[name] = QueryTarget(shape, pattern, needed)
        return self._query_targets[name]

    def pattern_parameters(self, name: str) -> tuple[str, tuple[str, ...]]:
        """Return the qualified name and the parameters of a pattern; for a rule those of its LHS."""
        asked = self.query_target(name)
        return asked.pattern, asked.shape.names

    def _find_pattern(self, name: str) -> tuple[Shape, str]:
        qualified = self.directory_with_patterns().resolve(name, "pattern or rule")
        if qualified in self.runners:
            runner = self.runners[qualified]
            return runner.shape, runner.pattern
        if qualified in self.members or qualified in self.programs:
            kind = self.directory.signatures[qualified].kind
            rules = ", ".join(f"`{member}`" for member in self.members.get(qualified, ()))
            hint = f"; ask for one of its rules: {rules}" if rules else ""
            raise InvalidArgument(f"`{name}` is a {kind}, which has no matches of its own{hint}")
        pattern = self.library.get(qualified)
        return self.shape_of(pattern), qualified

    # --- uses of definitions

    def owner_function(self) -> Callable[[str], str]:
        """Return a function that maps a generated pattern or rule to its definition, and other names to themselves."""
        groups = {member: group for group, members in self.members.items() for member in members}

        def owner(name: str) -> str:
            base = name.partition("#")[0]
            return groups.get(base, base)

        return owner

    def used_definitions(self) -> dict[str, set[str]]:
        """Return the names of the definitions that each definition uses, without itself."""
        owner = self.owner_function()
        found: dict[str, set[str]] = {}
        for name in self.library.names():
            found.setdefault(owner(name), set()).update(map(owner, self.library.callees(name)))
        for name, rule in self.runners.items():
            if isinstance(rule, PythonRule):
                found.setdefault(name, set()).add(owner(rule.pattern))
        for name, definition in self.added_definitions.items():
            if isinstance(definition, Unit):
                found.setdefault(name, set()).update(map(owner, self.called_names(definition)))
        return {name: used - {name} for name, used in found.items()}

    def portable_definitions(self) -> list[Definition]:
        """Return the definitions that another engine can add: those that never call a Python rule or unit."""
        functions = {name for name, rule in self.runners.items() if isinstance(rule, PythonRule)}
        functions |= {name for name, unit in self.programs.items() if isinstance(unit, PythonUnit)}
        found = list(self.definitions)
        while functions:
            calling = [one for one in found if isinstance(one, Unit) and self.called_names(one) & functions]
            functions = {unit.qualified_name for unit in calling}
            found = [one for one in found if one not in calling]
        return found

    def called_names(self, unit: Unit) -> set[str]:
        """Return the qualified names of the rules, units and groups that a unit calls itself or tests in an `if`."""
        steps = all_steps(unit)
        asked = [as_applicability_test(step.condition) for step in steps if isinstance(step, IfStep)]
        names = [one.name for one in (*steps, *asked) if isinstance(one, UnitCall | Applicable)]
        return {found for name in names for found in self.directory.candidates(name, unit.package)}

    # --- from values to ids

    def check_bindings(self, shape: Shape, bound: Mapping[str, object]) -> dict[str, Value]:
        """Check values for variables and return them, with ids in place of objects.

        Raises:
            InvalidArgument: a variable is unknown, or an object belongs to another model or does not exist.
            TypeMismatch: a value has the wrong type.
        """
        found: dict[str, Value] = {}
        for name, value in bound.items():
            if name not in shape.names:
                self._check_output(shape, name)
            position = shape.position(name)
            found[name] = self._check_binding(shape, position, value)
        return found

    def _check_output(self, shape: Shape, name: str) -> None:
        """Raise `InvalidArgument` if a name is an `out` parameter of a created object, so not a match variable."""
        signature = self.directory.signatures.get(shape.definition)
        if signature is not None and any(one.is_output and one.name == name for one in signature.parameters):
            raise InvalidArgument(
                f"`{name}` is an `out` parameter of `{shape.definition}`, which creates it: "
                "it takes no value, and is in the `outputs` of the application"
            )

    def _check_binding(self, shape: Shape, position: int, value: object) -> Value:
        type_ = shape.types[position]
        if isinstance(type_, ObjectType):
            if isinstance(value, Node) and value.model is not self.model:
                raise InvalidArgument(f"{value!r} is an object of another model")
            if isinstance(value, Node) or type(value) is int:
                node = value.id if isinstance(value, Node) else value
                if not self.model.graph.alive(node):
                    raise InvalidArgument(
                        f"`{shape.names[position]}` of `{shape.definition}` is object {node}, which does not exist",
                        "check that it was created, and was not deleted or rolled back",
                    )
                return node
            wanted = f"a `{type_.cls}`"
        elif accepts(type_, value):
            return float(value) if type_ is Scalar.FLOAT else cast("Value", value)  # type: ignore[arg-type]
        else:
            wanted = f"`{type_name(type_)}`"
        raise TypeMismatch(f"`{shape.names[position]}` of `{shape.definition}` takes {wanted}, not {value!r}")


def merge_bindings(bound: Mapping[str, object] | None, values: Mapping[str, object]) -> Mapping[str, object]:
    """Return the values of variables, merged from a mapping and from keyword arguments.

    Raises:
        InvalidArgument: `bound` is no mapping from names, or contains a variable that is also a keyword.
    """
    if bound is None:
        return values
    if not isinstance(bound, Mapping) or not all(isinstance(name, str) for name in bound):
        raise InvalidArgument(
            f"`bound` must be a mapping from variables to their values, not {bound!r}; "
            "to bind a variable of that name, write `bound={'bound': ..}`"
        )
    twice = next((name for name in bound if name in values), None)
    if twice is not None:
        raise InvalidArgument(f"`{twice}` is given twice: in `bound`, and as a keyword argument")
    return {**bound, **values}
