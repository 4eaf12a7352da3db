"""What an engine has been given: patterns, rules, units and derived groups, as data or as Python functions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from math import isfinite
from typing import TYPE_CHECKING, Literal, TypeVar, cast, overload

from envgraph.errors import Diagnostic, InvalidArgument, ResolutionError, Severity, has_errors
from envgraph.graph import Model
from envgraph.match import ViewMatcher
from envgraph.pattern import (
    Applicable,
    Call,
    Derivation,
    FunctionDeclaration,
    If,
    Library,
    Pattern,
    Rule,
    Step,
    Unit,
)
from envgraph.rewrite._match import Shape
from envgraph.rewrite._names import Directory, Signature, Taken
from envgraph.rewrite.check._unit_check import applicable, inner_steps
from envgraph.rewrite.check._well_formed import mistake_in
from envgraph.rewrite.derive._derive import derived_rules
from envgraph.rewrite.engine._described import described, describes
from envgraph.rewrite.engine._functions import PythonUnit, unit_signature_of
from envgraph.rewrite.engine._losses import Loss, losses
from envgraph.rewrite.engine._questions import Questions
from envgraph.rewrite.engine._register import Registration
from envgraph.rewrite.engine._registered import register_function
from envgraph.rewrite.events._jobs import job_name
from envgraph.rewrite.run._notices import Notices
from envgraph.rewrite.run._runner import GraphRule, PythonRule, RuleRunner, graph_rule
from envgraph.rewrite.run._units import unit_program

if TYPE_CHECKING:
    from envgraph.rewrite.engine._engine import Engine

Definition = Pattern | Rule | Unit | Derivation | FunctionDeclaration
Function = TypeVar("Function", bound=Callable[..., object])


class Definitions(Questions):
    """A model, and what is defined over it; `Engine` adds what can be done with that."""

    def __init__(self, model: Model, matcher: Literal["compiled", "naive"]) -> None:
        super().__init__(model, matcher)
        self._definitions: dict[str, Rule | Unit | Derivation] = {}
        self._notices = Notices()

    def check(self, *definitions: Definition) -> list[Diagnostic]:
        """All errors and warnings that `add` would find; nothing is added."""
        return self._registration(definitions).problems

    def add(self, *definitions: Definition) -> None:
        """Register patterns, rules, units, derivations and declarations of functions, which may refer to each other.

        Raises:
            ResolutionError: at least one has an error; all errors together. Nothing is added.
            InvalidArgument: something that is no definition, or a definition with a part of the wrong type.
        """
        self._install(self._sound(self._registration(definitions)), definitions)

    def _sound(self, registration: Registration) -> Registration:
        """What was checked, without errors.

        Raises:
            ResolutionError: it has some.
        """
        if has_errors(registration.problems):
            raise ResolutionError([p for p in registration.problems if p.severity is Severity.ERROR])
        return registration

    def _install(self, registration: Registration, definitions: Sequence[Definition]) -> None:
        """Register definitions that were checked."""
        self.library.functions = registration.functions
        self.library.add(*registration.all_patterns)
        self._directory = registration.directory
        self._forget()
        for plan in registration.plans:
            self._rules[plan.name] = graph_rule(
                plan, self.model, self.library, self.matcher, self._notices.existing_link
            )
        for definition in definitions:
            if not isinstance(definition, Pattern | FunctionDeclaration):
                self._definitions[definition.qualified_name] = definition
        self._groups.update(registration.groups)
        for checked in registration.units:
            name = checked.unit.qualified_name
            self._units[name] = unit_program(
                checked,
                self._directory.signatures[name],
                self._rules,
                self._units,
                self.group,
                self.model,
                self.matcher,
            )
        if isinstance(self.matcher, ViewMatcher):
            self.matcher.watch_later(*_incremental(definitions))

    def _forget(self) -> None:
        """Names may mean something else now."""
        self._questions.clear()

    def _unrecorded(self) -> AbstractContextManager[None]:
        """What a Python rule applies is part of its own application."""
        return nullcontext()

    def _registration(
        self,
        definitions: Sequence[Definition],
        library: Library | None = None,
        directory: Directory | None = None,
    ) -> Registration:
        """Definitions checked against those that there are, or against others."""
        self._check_given(definitions)
        return Registration(definitions, library or self.library, directory or self._directory)

    def _check_given(self, definitions: Sequence[Definition]) -> None:
        """Refuse what is no definition.

        Raises:
            InvalidArgument: it is none, or has a part of the wrong type.
        """
        strange: list[object] = [one for one in definitions if not isinstance(one, Definition)]
        if strange:
            hint = ": `envgraph.lang.from_text` reads definitions" if isinstance(strange[0], str) else ""
            raise InvalidArgument(f"a pattern, rule, unit or derivation is added, not {strange[0]!r}{hint}")
        for one in definitions:
            mistake = None if one.span is not None else mistake_in(one)
            if mistake is not None:
                raise InvalidArgument(f"{mistake}; `envgraph.Rule` and its like take texts, too")

    def rule(
        self, when: str | Pattern, *, name: str | None = None, weight: float = 1.0, priority: int = 0
    ) -> Callable[[Function], Function]:
        """Register a Python function as a rule that applies at the matches of a pattern.

        The function takes variables of the match by name, as `Node`s or values, and the engine if it has a parameter
        `engine`; it edits the model through the nodes. If it raises, what it did is taken back.

        Args:
            when: name of a registered pattern, or a pattern, which is registered too.
            name: name of the rule; else that of the function.
            weight, priority: as `@weight` and `@priority`.

        Raises:
            InvalidArgument: an unknown pattern, a name that is taken, a parameter that is no variable of the pattern.
            ResolutionError: the pattern has errors.
        """
        if isinstance(when, Pattern) and when not in self.library.patterns:
            self.add(when)
        pattern = self._pattern(when.qualified_name if isinstance(when, Pattern) else when)

        def register(function: Function) -> Function:
            own = self._free_name(function, name, weight)
            shape = Shape(own, self._shape(pattern).names, self._shape(pattern).types)
            runner = PythonRule(
                function,
                shape,
                pattern.qualified_name,
                self.model,
                self.library,
                self.matcher,
                engine=self,
                aside=self._unrecorded,
                weight=float(weight),
                priority=priority,
            )
            parameters = tuple(
                Taken(variable, type_, required=variable in runner.inputs)
                for variable, type_ in zip(shape.names, shape.types, strict=True)
            )
            self._directory.add(Signature(own, "rule", "", parameters, weight, priority, parameters))
            self._rules[own] = runner
            self._forget()
            return function

        return register

    @overload
    def unit(self, function: Function, /) -> Function: ...
    @overload
    def unit(
        self, /, *, name: str | None = None, weight: float = 1.0, priority: int = 0
    ) -> Callable[[Function], Function]: ...
    def unit(
        self,
        function: Function | None = None,
        /,
        *,
        name: str | None = None,
        weight: float = 1.0,
        priority: int = 0,
    ) -> Function | Callable[[Function], Function]:
        """Register a Python function as a unit: a decorator, with or without brackets.

        The annotations of its parameters are their types: names of classes and enums, or `int`, `float`, `bool`, `str`.

        A function with a parameter `steps` *describes* a unit. It is called now, once, with `Steps` and a variable for
        each parameter; what it says becomes a `Unit`, which is added like any other: see `definition` and `to_text`.

        Any other function *is* the unit. It is called whenever the unit runs, with `Node`s and values, and with the
        engine if it has a parameter `engine`. What it applies by name is part of the run and of recordings; a recording
        refuses what it edits by itself. It fails by returning False. It also fails by an application that is
        refused; then what it did is taken back, as after any exception.

        Args:
            function: the function.
            name: name of the unit; else that of the function.
            weight, priority: as `@weight` and `@priority`.

        Raises:
            InvalidArgument: a name that is taken, a parameter without a type, or one that a unit cannot have.
            ResolutionError: what a function describes has errors.
        """

        def register(given: Function) -> Function:
            own = self._free_name(given, name, weight)
            if describes(given):
                self.add(described(given, own, float(weight), priority))
                return given
            engine = cast("Engine", self)
            signature = unit_signature_of(given, own, engine, float(weight), priority)
            self._directory.add(signature)
            self._units[own] = PythonUnit(given, signature, engine)
            self._forget()
            return given

        return register if function is None else register(function)

    @overload
    def function(self, function: Function, /) -> Function: ...
    @overload
    def function(
        self,
        name: str,
        /,
        *,
        parameters: Mapping[str, str | type] | None = None,
        result: str | type | None = None,
    ) -> Callable[[Function], Function]: ...
    @overload
    def function(
        self,
        name: str,
        function: Function,
        /,
        parameters: Mapping[str, str | type] | None = None,
        result: str | type | None = None,
    ) -> Function: ...
    def function(
        self,
        name: str | Function,
        function: Function | None = None,
        /,
        parameters: Mapping[str, str | type] | None = None,
        result: str | type | None = None,
    ) -> Function | Callable[[Function], Function]:
        """Register a Python function that expressions can call by its name: a decorator, or a call.

        It has to be pure: what it returns depends on its arguments alone, and it changes nothing. It is called once for
        each candidate that comes as far as the call, whenever that is searched for or a view is brought up to date;
        nothing is remembered. If it raises, or returns something that is no value of its type, that is a
        `FunctionError` at the place of the call.

        Args:
            name: what expressions call it; else the name of the function.
            function: takes the arguments in their order, and returns the result.
            parameters: names and types, `{"x": int, "way": "Way"}`: data types and enums.
            result: type of the result. Where types are left out, they are those of a `function` declaration of that
                name that the engine has, else the annotations.

        Raises:
            InvalidArgument: a function that has its code already; types that are missing.
            ResolutionError: an unknown type, a class, other types than those of the declaration, or the name of a
                function of the language.

        >>> from envgraph.metamodel import Attribute, Class, Metamodel, Scalar
        >>> engine = Definitions(Model(Metamodel("m", [Class("P", features=(Attribute("x", Scalar.INT),))])), "naive")
        >>> @engine.function
        ... def is_prime(n: int) -> bool:
        ...     return n > 1 and all(n % d for d in range(2, n))
        >>> engine.functions
        ('is_prime',)
        """

        def register(given: Function) -> Function:
            register_function(self.library, given, own, parameters, result)
            self._forget()
            return given

        own = name if isinstance(name, str) else None
        if isinstance(name, str) and function is None:
            return register
        return register(cast("Function", name if function is None else function))

    @property
    def functions(self) -> tuple[str, ...]:
        """Names of the functions that expressions can call, besides those of the language."""
        return tuple(self.library.functions)

    def _free_name(self, function: Callable[..., object], name: str | None, weight: float) -> str:
        """What a function is registered as.

        Raises:
            InvalidArgument: it is no function, the name is taken, or the weight is none.
        """
        if not callable(function):
            raise InvalidArgument(f"a function is registered, not {function!r}")
        if not (weight > 0 and isfinite(weight)):
            raise InvalidArgument(f"a weight is a number above 0, not {weight}")
        own = name or job_name(function)
        if own in self._directory.signatures or own in self.library.names():
            raise InvalidArgument(f"`{own}` is defined already")
        return own

    @property
    def notices(self) -> tuple[Diagnostic, ...]:
        """What applications have come upon that may not be meant, each once, in order.

        A link that a rule creates although it is there ("existing-link"). They also go to the logger "envgraph".
        """
        return self._notices.all

    @property
    def rules(self) -> tuple[str, ...]:
        """Qualified names of all rules, members of groups included, in the order they were added."""
        return tuple(self._rules)

    @property
    def units(self) -> tuple[str, ...]:
        """Qualified names of the units."""
        return tuple(self._units)

    @property
    def groups(self) -> tuple[str, ...]:
        """Qualified names of the derivations."""
        return tuple(self._groups)

    @property
    def patterns(self) -> tuple[str, ...]:
        """Qualified names of the registered patterns, without those that rules are made into."""
        return tuple(name for name in self.library.names() if "#" not in name)

    @property
    def definitions(self) -> tuple[Definition, ...]:
        """The declared functions, patterns, rules, units and derivations as they were added."""
        functions = [function.declaration for function in self.library.functions.values()]
        patterns = [pattern for pattern in self.library.patterns if "#" not in pattern.name]
        return (*functions, *patterns, *self._definitions.values())

    def definition(self, name: str) -> Definition:
        """A pattern, rule, unit or derivation as it was added, for `to_text`; of a derived rule, what it is.

        Raises:
            InvalidArgument: an unknown name, or a Python function, of which there is no data.
        """
        qualified = self._directory_with_patterns().resolve(name, "pattern, rule, unit or group")
        if qualified in self._definitions:
            return self._definitions[qualified]
        group = next((group for group, members in self._groups.items() if qualified in members), None)
        if group is not None:
            derivation = cast("Derivation", self._definitions[group])
            rules = derived_rules(derivation, self.model.metamodel)
            return next(rule for rule in rules if rule.qualified_name == qualified)
        if qualified in self._rules or qualified in self._units:
            raise InvalidArgument(f"`{name}` is a Python function, of which there is no data")
        return self.library.get(qualified)

    def group(self, name: str) -> tuple[str, ...]:
        """Qualified names of the rules of a derivation; of the rule itself, for a rule; of the unit, for a unit."""
        qualified = self._directory.resolve(name)
        return self._groups.get(qualified, (qualified,))

    def signature(self, name: str) -> Signature:
        """What a rule, unit or group is called with."""
        return self._directory.signatures[self._directory.resolve(name)]

    def prepare(self, rule: str) -> RuleRunner:
        """The fast, unchecked interface of a rule, for loops that apply it often.

        Raises:
            InvalidArgument: an unknown rule.
        """
        qualified = self._directory.resolve(rule, "rule")
        if qualified not in self._rules:
            kind = self._directory.signatures[qualified].kind
            raise InvalidArgument(f"`{rule}` is a {kind}, not a rule")
        return self._rules[qualified]

    def losses(self, name: str, cls: str | None, known: Mapping[str, bool]) -> tuple[Loss, ...]:
        """The actions by which a rule, or what a unit calls, may take an object away; not those of Python functions.

        Args:
            name: of the rule or unit.
            cls: class of the object, None if it is not known; it is lost, too, when it is no longer of the class.
            known: parameters that are the object (True), or surely another one (False). What a unit hands on to what
                it calls is not followed: of that, classes alone tell.

        Raises:
            InvalidArgument: an unknown name.
        """
        called = {self._directory.resolve(name): dict(known)}
        waiting = list(called)
        found: dict[Loss, None] = {}
        for one in waiting:
            fresh: Iterable[str] = self._groups.get(one, ())
            if isinstance(definition := self._definitions.get(one), Unit):
                fresh = sorted(self._called(definition))
            rule = self._rules.get(one)
            if isinstance(rule, GraphRule):
                found |= dict.fromkeys(losses(rule.plan, self.model.metamodel, cls, called[one]))
            waiting += [each for each in fresh if each not in called]
            called |= {each: {} for each in fresh if each not in called}
        return tuple(found)

    def _without_functions(self) -> list[Definition]:
        """The definitions that can be added to another engine: none that calls a Python function."""
        functions = {name for name, rule in self._rules.items() if isinstance(rule, PythonRule)}
        functions |= {name for name, unit in self._units.items() if isinstance(unit, PythonUnit)}
        found = list(self.definitions)
        while functions:
            calling = [one for one in found if isinstance(one, Unit) and self._called(one) & functions]
            functions = {unit.qualified_name for unit in calling}
            found = [one for one in found if one not in calling]
        return found

    def _called(self, unit: Unit) -> set[str]:
        """Qualified names of what a unit calls."""
        steps: list[Step] = [unit.body]
        for step in steps:
            steps += inner_steps(step)
        asked = [applicable(step.condition) for step in steps if isinstance(step, If)]
        names = [one.name for one in (*steps, *asked) if isinstance(one, Call | Applicable)]
        return {found for name in names for found in self._directory.candidates(name, unit.package)}


def _incremental(definitions: Iterable[Definition]) -> list[str]:
    """The patterns that ask to be kept current."""
    return [
        each.qualified_name
        for each in definitions
        if isinstance(each, Pattern) and each.strategy == "incremental"
    ]
