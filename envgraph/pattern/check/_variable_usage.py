"""Check that every variable of a body is bound and used sensibly."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace

from envgraph.errors import SHOWN, Diagnostic, Note, Severity, Span, did_you_mean, most_similar
from envgraph.metamodel import EnumType, type_name
from envgraph.pattern._enumerable_variables import Binding, enumerated_by_type, inputs_of, is_data_type
from envgraph.pattern._expression_data import Constant, Variable
from envgraph.pattern._goals import ObjectType, StaticType
from envgraph.pattern._occurrences import BodyVariables, VariableUse, positive_relations, terms_of, variable_names
from envgraph.pattern._query_data import ColumnMark, Comparison, Evaluation, Parameter, Pattern, Relation, Term
from envgraph.pattern._type_inference import BodyTypes, relation_text
from envgraph.pattern._types import type_text
from envgraph.pattern.check._relation_check import RelationPlace


class UsageCheck:
    """The check of the usage of the variables of one body.

    Args:
        pattern: the pattern.
        body_types: the body with its types.
        binding: the variables that the body can enumerate, given the parameters that callers bind.
        tainted: variables about which another error has been reported already.
        where: the phrase that names the body in messages, "" if there is only one.
        unclear: True if an error in the body may be the cause of a variable being unreferenced or used only once.
    """

    def __init__(
        self, pattern: Pattern, body_types: BodyTypes, binding: Binding, tainted: set[str], where: str, unclear: bool
    ) -> None:
        self._pattern = pattern
        self._types = body_types
        self._reading: BodyVariables = body_types.reading
        self._binding = binding
        self._tainted = set(tainted)
        self._location_phrase = where
        self._is_unclear = unclear
        self._parameters: dict[str, Parameter] = {p.name: p for p in reversed(pattern.parameters)}
        self._used_once: list[str] | None = None

    def check_variables(self, *, errors: bool) -> Iterator[Diagnostic]:
        """Report errors and warnings about the variables of the body. A variable with an error gets no warning.

        Args:
            errors: True if other errors exist, which may concern a variable that seems to be used once.
        """
        own = list(self._check_self_evaluation())
        yield from own
        yield from self._check_unreferenced()
        unbound = list(self._check_unbound())
        yield from unbound
        yield from self._check_valueless()
        self._is_unclear = self._is_unclear or errors or bool(own or unbound)
        for name in self._reading.names:
            if name not in self._parameters and name not in self._tainted:
                yield from self._check_local(name)

    def _check_self_evaluation(self) -> Iterator[Diagnostic]:
        """Report, and taint, variables that are computed from themselves, as in `x == eval(.. x ..)`."""
        for constraint in self._reading.body.constraints:
            if not isinstance(constraint, Comparison) or constraint.operator != "==":
                continue
            for term, other in ((constraint.left, constraint.right), (constraint.right, constraint.left)):
                if isinstance(term, Variable) and isinstance(other, Evaluation) and not term.is_anonymous:
                    root = self._reading.representative(term.name)
                    if any(self._reading.representative(name) == root for name in variable_names(other.expression)):
                        self._tainted.update(self._reading.united_names(term.name))
                        message = f"`{term.name}` is computed from itself"
                        yield Diagnostic(
                            "self-evaluation", message, other.span or constraint.span, "use another variable"
                        )

    def _check_unreferenced(self) -> Iterator[Diagnostic]:
        for name, parameter in self._parameters.items():
            if self._reading.occurrences[name] or name in self._tainted:
                continue
            self._tainted.add(name)
            if not self._is_unclear:
                message = unreferenced_message(name, self._location_phrase)
                span = parameter.span or self._pattern.span
                near, notes = self._similar_local(name)
                hint = near or "constrain it in the body, or leave it out of the parameters"
                yield Diagnostic("unreferenced-parameter", message, span, hint, notes=notes, subject=(name,))

    def _similar_local(self, name: str) -> tuple[str | None, tuple[Note, ...]]:
        """Return a hint and a note about a local variable, used once, with a name similar to an unreferenced parameter.

        Taint this variable, so that it gets no other report. Without a similar name return None and ().
        """
        if self._used_once is None:
            self._used_once = [
                n for n in self._reading.names if n not in self._parameters and len(self._reading.occurrences[n]) == 1
            ]
        near = most_similar(name, self._used_once)
        if near is None:
            return None, ()
        self._tainted.add(near)
        return f"write `{name}` there", (Note(f"`{near}` is used only here", self._reading.first_span(near)),)

    def _check_unbound(self) -> Iterator[Diagnostic]:
        circular: list[str] = []
        for name in self._reading.names:
            group = self._reading.united_names(name)
            if self._binding.binds(name) or self._tainted.intersection(group):
                continue
            if self._reading.quantifying_relation(name) is None:
                self._tainted.update(group)
                if self._has_binding_use(group):
                    given = self._input_call(group)
                    if given is None:
                        circular.append(name)
                    else:
                        yield self._only_input_error(name, given)
                else:
                    yield self._not_enumerable_error(name, group)
        circular = self._independently_unbound(circular)
        if circular:
            # Variables that depend on a cycle are unbound too, so all of them are one error.
            names = ", ".join(f"`{name}`" for name in circular)
            message = (
                f"no constraint enumerates the values of {names}{self._location_phrase}: they depend on each other"
            )
            hint = f"bind `{circular[0]}` first, with a class, a path or a `find`"
            yield Diagnostic(
                "not-enumerable", message, self._reading.first_span(circular[0]), hint, subject=tuple(circular)
            )

    def _check_valueless(self) -> Iterator[Diagnostic]:
        """Warn about variables that only their type enumerates, if no attribute of the metamodel has that type."""
        metamodel = self._types.metamodel
        for name, type_ in enumerated_by_type(self._types, self._pattern.parameters):
            if name not in self._tainted and all(one.type != type_ for one in metamodel.attributes):
                message = (
                    f"`{name}` never has a value{self._location_phrase}: nothing binds it, so it ranges "
                    f"over the values of type `{type_name(type_)}`, and no attribute has this type"
                )
                hint = "bind it with a `find` or `==`"
                if name in self._parameters:
                    hint += ", or declare it `in`, so that every caller binds it"
                span = self._reading.first_span(name) or self._pattern.span
                yield Diagnostic("no-values", message, span, hint, Severity.WARNING, subject=(name,))

    def _independently_unbound(self, names: list[str]) -> list[str]:
        """Return the names that would be unbound even if the variables with reported errors were bound."""
        root = self._reading.representative
        circle = {root(name) for name in names}
        known = [
            name
            for name in self._reading.names
            if self._binding.binds(name) or (name in self._tainted and root(name) not in circle)
        ]
        mended = Binding(self._types, self._pattern.parameters, known)
        return [name for name in names if not mended.binds(name)]

    def _input_call(self, group: list[str]) -> Relation | None:
        """Return a positive call with one of the variables as the argument of an `in` parameter, or None."""
        for relation in positive_relations(self._reading.body):
            for position in inputs_of(relation, self._types):
                term = terms_of(relation)[position]
                if isinstance(term, Variable) and term.name in group:
                    return relation
        return None

    def _only_input_error(self, name: str, relation: Relation) -> Diagnostic:
        message = f"{relation_text(relation)} takes `{name}` for an `in` parameter, but nothing else binds it"
        parameter = self._parameters.get(name)
        return Diagnostic(
            "not-enumerable",
            message,
            self._reading.first_span(name),
            self._binding_hint(name, parameter),
            subject=(name,),
        )

    def _has_binding_use(self, group: list[str]) -> bool:
        """Return True if one of the variables has a use that binds it, other than a type constraint of a data type."""
        uses = [o.use for member in group for o in self._reading.occurrences[member]]
        types = [
            relation
            for relation in positive_relations(self._reading.body)
            if is_data_type(relation, self._types.metamodel)
            and any(isinstance(term, Variable) and term.name in group for term in terms_of(relation))
        ]
        return uses.count(VariableUse.POSITIVE) > len(types)

    def _not_enumerable_error(self, name: str, group: list[str]) -> Diagnostic:
        uses = {occurrence.use for member in group for occurrence in self._reading.occurrences[member]}
        parameter = next((self._parameters[member] for member in group if member in self._parameters), None)
        span = self._reading.first_span(name)
        if parameter is None and uses == {VariableUse.NEGATIVE}:
            message = f"`{name}` is used only in negations and aggregates, each of which quantifies it separately"
            hint = "bind it with a positive constraint, or use a different name in each of them"
            return Diagnostic("only-negative", message, span, hint)
        message = f"no positive constraint enumerates the values of `{name}`{self._location_phrase}"
        return Diagnostic(
            "not-enumerable", message, span or self._pattern.span, self._binding_hint(name, parameter), subject=(name,)
        )

    def _binding_hint(self, name: str, parameter: Parameter | None) -> str:
        type_ = self._types.type_of(name)
        meant = self._class_hint(name) or self._literal_hint(name, type_)
        if meant is not None:
            return meant
        if type_ is None or isinstance(type_, ObjectType):
            cls = type_text(type_) if type_ else "Class"
            return f"constrain it with `{cls}({name})`, a path or a `find`"
        if parameter is not None:
            return "bind it with a path, a `find` or `==`, or declare it `in`, so that every caller binds it"
        return "bind it with a path, a `find` or `==`"

    def _literal_hint(self, name: str, type_: StaticType | None) -> str | None:
        """Return a hint to write `Enum::name` if a variable has the name of a literal of a fitting enum, or None."""
        if name in self._parameters and self._parameters[name].type is not None:
            return None
        enums = self._types.metamodel.enum_types if type_ is None else (type_,)
        owners = [enum.name for enum in enums if isinstance(enum, EnumType) and name in enum.literals]
        return f"did you mean `{owners[0]}::{name}`?" if owners else None

    def _class_hint(self, name: str) -> str | None:
        """Return a hint for a local variable that is compared and has the name of a class, or None."""
        if name in self._parameters or name not in self._types.metamodel.classes:
            return None
        for one in self._reading.body.constraints:
            if isinstance(one, Comparison) and Variable(name) in (one.left, one.right):
                other = one.left if one.right == Variable(name) else one.right
                if isinstance(other, Variable):
                    return f"write `{'neg ' * (one.operator == '!=')}{name}({other.name});`"
        return None

    def _check_local(self, name: str) -> Iterator[Diagnostic]:
        places = self._reading.occurrences[name]
        if name.startswith("_"):
            if len(places) > 1:
                message = f"`{name}` is used {len(places)} times, but a name that starts with `_` may be used only once"
                hint = f"call it `{name.lstrip('_') or 'x'}`"
                yield Diagnostic("single-use-repeated", message, places[1].variable.span, hint)
            elif name.lstrip("_") in self._reading.occurrences:
                message = f"`{name}` and `{name.lstrip('_')}` are different variables"
                hint = "remove the `_` if they are the same variable, else rename one of them"
                yield _make_warning("similar-names", message, places[0].variable.span, hint)
            return
        if self._reading.quantifying_relation(name) is not None:
            yield quantified_variable_warning(places[0].variable)
        elif len(places) == 1 and not self._is_unclear:
            others = [other for other in self._reading.names if other != name and not other.startswith("_")]
            near = did_you_mean(name, others) if len(others) <= SHOWN.variables else None
            near = self._class_hint(name) or self._literal_hint(name, self._types.type_of(name)) or near
            if name in self._types.metamodel.classes:
                yield class_warning(places[0].variable, near)
                return
            hint = near or f"start its name with `_` (`_{name}`) if that is meant"
            yield _make_warning("used-once", f"`{name}` is referenced only once", places[0].variable.span, hint)

    def check_inputs(self, place: RelationPlace) -> Iterator[Diagnostic]:
        """Report `_`, `#` and local variables as arguments of `in` parameters, which must be bound."""
        relation = place.relation
        for position in inputs_of(relation, self._types):
            term = terms_of(relation)[position]
            if self._is_unbound_input(term):
                message = f"{relation_text(relation)} needs a value here: the parameter is `in`"
                hint = "write a value, or a variable that another constraint finds"
                yield Diagnostic("unbound-input", message, term.span or relation.span, hint)

    def _is_unbound_input(self, term: Term) -> bool:
        if isinstance(term, Variable):
            if not term.is_anonymous and self._tainted.intersection(self._reading.united_names(term.name)):
                return False
            return term.is_anonymous or self._reading.quantifying_relation(term.name) is not None
        return isinstance(term, ColumnMark)

    def check_comparison(self, comparison: Comparison) -> Iterator[Diagnostic]:
        """Report `#` and `none` as sides of a comparison, and `_` if nothing gives it a value to compare."""
        sides = (comparison.left, comparison.right)
        both = all(isinstance(term, Variable) and term.is_anonymous for term in sides)
        for term in sides[:1] if both else sides:
            span: Span | None = term.span or comparison.span
            if isinstance(term, ColumnMark):
                hint = "write `#` inside an aggregate: `sum Type.feature(_, #)`"
                yield Diagnostic("stray-hash", "`#` marks the column of an aggregate", span, hint)
            elif isinstance(term, Constant) and term.value is None:
                hint = "only a path can be `none`: `check(x.f == none)`"
                yield Diagnostic("none-argument", "`none` is no value", span, hint)
            elif isinstance(term, Variable) and term.is_anonymous and (both or comparison.operator == "!="):
                yield Diagnostic("not-enumerable", "`_` has no value to compare", span, "give the variable a name")

    def check_negation(self, place: RelationPlace) -> Iterator[Diagnostic]:
        """Warn about a negation that shares no variable with the rest of the body."""
        terms = terms_of(place.relation)
        if place.group is None or place.aggregate or not terms:
            return
        if all(
            isinstance(term, Variable)
            and (term.is_anonymous or self._reading.quantifying_relation(term.name) == place.group)
            for term in terms
        ):
            message = f"the body holds only if {relation_text(place.relation)} has no match at all"
            hint = "use a variable of the body as an argument"
            hint += ', or write `@suppress("global-negation")` before the definition if this is meant'
            yield _make_warning("global-negation", message, place.relation.span, hint)


def quantified_variable_warning(variable: Variable) -> Diagnostic:
    """Return the warning that a variable occurs in only one negation or aggregate, and is local to it."""
    message = f"`{variable.name}` is used only here, so it is quantified inside the call"
    hint = f"start its name with `_` (`_{variable.name}`) if that is meant"
    return _make_warning("quantified-variable", message, variable.span, hint)


def class_warning(variable: Variable, hint: str | None = None) -> Diagnostic:
    """Return the warning that a variable that occurs once has the name of a class."""
    message = f"`{variable.name}` is a class, but stands for any value here"
    hint = hint or f"write `{variable.name}(x);` in a pattern for an object `x` of class `{variable.name}`"
    return _make_warning("used-once", message, variable.span, hint)


def misspelling_warnings(variable: Variable, known: Iterable[str]) -> Iterator[Diagnostic]:
    """Yield a warning for a variable that occurs once, if its name is similar to a name in `known`. Else yield nothing.

    Names that differ only in digits do not count as similar.
    """
    stem = _without_digits(variable.name)
    hint = did_you_mean(variable.name, [one for one in known if _without_digits(one) != stem])
    if hint is not None:
        message = f"`{variable.name}` is referenced only once"
        warning = _make_warning("used-once", message, variable.span, hint)
        yield replace(warning, subject=(variable.name,))


def _without_digits(name: str) -> str:
    return re.sub("[0-9]", "", name)


def unreferenced_message(name: str, where: str = "") -> str:
    """Return the message that a parameter is never referenced. `where` names the body; "" means all bodies."""
    return f"parameter `{name}` is never referenced{where}"


def _make_warning(code: str, message: str, span: Span | None, hint: str | None = None) -> Diagnostic:
    return Diagnostic(code, message, span, hint, Severity.WARNING)
