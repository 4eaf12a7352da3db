"""Convert the conditions of a behaviour to helper patterns.

`on find p(truck, water, _)` needs the matches of its named variables, with its parameters bound and `_` projected
away. This is a pattern with the parameters and the named variables, whose body is the call. With helper patterns,
closures, negations and nested terms in a clause have the same meaning as in a query, errors included.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from envgraph.behaviour._behaviour import OnFind
from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Attribute, type_name
from envgraph.pattern import (
    Aggregate,
    Body,
    Comparison,
    Constraint,
    Negation,
    Parameter,
    PathConstraint,
    Pattern,
    PatternCall,
    TypeConstraint,
    Variable,
    terms_of,
    variables_in,
    variables_of_terms,
)

PACKAGE = "#environment"


@dataclass(frozen=True, slots=True)
class HelperPattern:
    """A helper pattern made of a condition: its first parameters are `bound` by the behaviour, the others by a match.

    Attributes:
        free: names of the variables that a match binds; for a count, the name of the variable that holds the count.
    """

    pattern: Pattern
    bound: tuple[str, ...]
    free: tuple[str, ...]


def condition_helper(name: str, condition: PatternCall | Negation, scope: Mapping[str, str]) -> HelperPattern:
    """Return a helper pattern for the matches of a condition; for a negation it has no free variables.

    Args:
        name: name of the helper pattern; it contains `#`, so that no text or hint can contain it.
        condition: the condition of an `on` clause or an observation.
        scope: the bound names, with the names of their types.
    """
    relation = condition.relation if isinstance(condition, Negation) else condition
    used = tuple(dict.fromkeys(v.name for v in variables_of_terms(terms_of(relation)) if v.name in scope))
    free: dict[str, Span | None] = {}
    if not isinstance(condition, Negation):
        for term in terms_of(relation):
            if isinstance(term, Variable) and is_bound_by_match(term, scope):
                free.setdefault(term.name, term.span)
    parameters = [Parameter(bound, scope[bound]) for bound in used]
    parameters += [Parameter(name, span=span) for name, span in free.items()]
    return HelperPattern(_make_helper(name, parameters, (condition,), condition.span), used, tuple(free))


def count_helper(name: str, call: PatternCall, scope: Mapping[str, str]) -> HelperPattern:
    """Return a helper pattern for the number of matches of a call, over all values of its unbound variables."""
    used = tuple(dict.fromkeys(v.name for v in variables_of_terms(call.arguments) if v.name in scope))
    taken = {v.name for v in variables_of_terms(call.arguments)}
    total = next(word for word in ("total", *(f"total{n}" for n in range(len(taken) + 1))) if word not in taken)
    parameters = [Parameter(bound, scope[bound]) for bound in used]
    parameters.append(Parameter(total, "int", span=call.span))
    counted = Comparison("==", Variable(total, call.span), Aggregate("count", call, call.span), call.span)
    return HelperPattern(_make_helper(name, parameters, (counted,), call.span), used, (total,))


def key_helper(name: str, cls: str, key: Sequence[Attribute]) -> HelperPattern:
    """Return a helper pattern for the objects of a class that have given values of their key attributes."""
    owner = Variable("object")
    parameters = [Parameter(f"key{place}", type_name(each.type)) for place, each in enumerate(key)]
    values = zip(key, parameters, strict=True)
    body = [PathConstraint(each.owner, (each.name,), owner, Variable(given.name)) for each, given in values]
    bound, free = tuple(one.name for one in parameters), Parameter(owner.name, cls)
    made = _make_helper(name, [*parameters, free], (TypeConstraint(cls, owner), *body), None)
    return HelperPattern(made, bound, (owner.name,))


def variable_occurrences(condition: PatternCall | Negation) -> list[Variable]:
    """Return all occurrences of variables in a condition."""
    relation = condition.relation if isinstance(condition, Negation) else condition
    return list(variables_of_terms(terms_of(relation)))


def mentioned_names(condition: PatternCall | Negation) -> set[str]:
    """Return the names of the variables in a condition."""
    return {variable.name for variable in variable_occurrences(condition)}


def names_after_condition(effect: OnFind) -> set[str]:
    """Return the names of the variables in the reward, weight and branches of a clause."""
    found = [one for one in (effect.reward, effect.weight) if one is not None]
    for branch in effect.apply:
        found.extend(branch.call.arguments)
        if not isinstance(branch.probability, int | float):
            found.append(branch.probability)
    return {variable.name for expression in found for variable in variables_in(expression)}


def is_bound_by_match(variable: Variable, scope: Mapping[str, object]) -> bool:
    """Return True if a match binds a variable of a call: it is not in scope, and its name does not begin with `_`."""
    return not variable.name.startswith("_") and variable.name not in scope


def _make_helper(
    name: str, parameters: Iterable[Parameter], body: tuple[Constraint, ...], span: Span | None
) -> Pattern:
    return Pattern(
        name,
        tuple(parameters),
        (Body(body, span=span),),
        package=PACKAGE,
        strategy="search",
        span=span,
    )
