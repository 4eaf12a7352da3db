"""Convert the conditions and windows of a behaviour to helper patterns.

`on find p(truck, water, _)` needs the matches of its named variables, with its parameters bound and `_` projected
away. This is a pattern with the parameters and the named variables, whose body is the call. With helper patterns,
closures, negations and nested terms in a clause have the same meaning as in a query, errors included.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from itertools import product
from math import prod

from envgraph.behaviour._behaviour import DrawGraph, DrawGrid, ObserveAround, ObserveFind, OnFind, Token
from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Attribute, EnumType, Metamodel, Scalar, type_name
from envgraph.pattern import (
    Aggregate,
    Binary,
    Body,
    Check,
    Comparison,
    Constant,
    Constraint,
    EnumLiteral,
    Evaluation,
    Expression,
    FunctionCall,
    Negation,
    Parameter,
    PathConstraint,
    Pattern,
    PatternCall,
    Term,
    TypeConstraint,
    Variable,
    base_of,
    terms_of,
    variables_in,
    variables_of_terms,
)

PACKAGE = "#environment"

_Constraints = tuple[Constraint, ...]


@dataclass(frozen=True, slots=True)
class HelperPattern:
    """A helper pattern made of a condition: its first parameters are `bound` by the behaviour, the others by a match.

    Attributes:
        free: names of the variables that a match binds; for an aggregate, the name of the variable that holds it.
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
    bound = {one.name: scope[one.name] for one in variable_occurrences(condition) if one.name in scope}
    free: dict[str, Parameter] = {}
    for term in () if isinstance(condition, Negation) else terms_of(condition):
        if isinstance(term, Variable) and is_bound_by_match(term, scope):
            free.setdefault(term.name, Parameter(term.name, span=term.span))
    return _make_helper(name, bound, free.values(), [(condition,)], condition.span)


def find_helper(name: str, observation: ObserveFind, scope: Mapping[str, str]) -> HelperPattern:
    """Return a helper pattern for observed matches, or for their aggregate over all values of unbound variables."""
    call = observation.call
    if observation.up_to is None:
        return condition_helper(name, call, scope)
    taken = dict.fromkeys(v.name for v in variables_of_terms(call.arguments))
    total = next(word for word in ("total", *(f"total{n}" for n in range(len(taken) + 1))) if word not in taken)
    counted = Comparison("==", Variable(total, call.span), Aggregate(observation.aggregate, call, call.span), call.span)
    bound = {name: scope[name] for name in taken if name in scope}
    return _make_helper(name, bound, [Parameter(total, span=call.span)], [(counted,)], call.span)


def key_helper(name: str, cls: str, key: Sequence[Attribute]) -> HelperPattern:
    """Return a helper pattern for the objects of a class that have given values of their key attributes."""
    owner = Variable("object")
    bound = {f"key{place}": type_name(each.type) for place, each in enumerate(key)}
    values = zip(key, map(Variable, bound), strict=True)
    body = [PathConstraint(each.owner, (each.name,), owner, value) for each, value in values]
    return _make_helper(name, bound, [Parameter(owner.name, cls)], [(TypeConstraint(cls, owner), *body)], None)


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
    name: str, bound: Mapping[str, str], free: Iterable[Parameter], bodies: Iterable[_Constraints], span: Span | None
) -> HelperPattern:
    parameters = (*(Parameter(one, cls) for one, cls in bound.items()), *free)
    made = tuple(Body(body, span=span) for body in bodies)
    pattern = Pattern(name, parameters, made, package=PACKAGE, strategy="search", span=span)
    return HelperPattern(pattern, tuple(bound), tuple(one.name for one in parameters[len(bound) :]))


_NODE = Variable("#node")
"""The object that a window shows. Its look is constraints on its class and its attributes."""


class ObservedWindow:
    """The components of `observe around`: for each cell, row by row, a number of the cell and one of the object on it.

    0 is no cell, or no object. With a condition 1 is a cell that is not seen. Then come the looks in the order of
    `draw`. Of several numbers at one place the largest is observed.

    Args:
        clause, draw: the clause, and the drawing, which is a grid.
        types: the classes of the names in the scope of the clause.
        metamodel: the classes.

    Attributes:
        grid, classes: the drawing, and the classes of cells and of objects with tokens.
        centre: the last token that draws the object in the middle; None if there is none.
        cells: the names in the condition that have no value: they stand for the cell.
        helpers: functions that make the helper patterns; see `_helper`.
        sizes: the number of values of each component.
        words: the values in words, of components of cells and of objects.
    """

    def __init__(
        self, clause: ObserveAround, draw: DrawGraph | DrawGrid | None, types: Mapping[str, str], metamodel: Metamodel
    ) -> None:
        assert isinstance(draw, DrawGrid), "the behaviour was checked"
        self._clause, self.grid, self._types, self.centre = clause, draw, types, None
        calls = [clause.visible] if clause.visible is not None else []
        name, cells = clause.centre.name, Token("", Variable(""), draw.cls)
        drawn = [(one, one.cls or types.get(one.variable, "")) for one in (cells, *draw.tokens) if one.letter is None]
        tokens = [(token, cls) for token, cls in drawn if cls in metamodel.classes]
        self.classes = [cls for _, cls in tokens]
        for token, cls in tokens:
            if metamodel.is_a(types[name], cls) if token.cls else token.variable == name:
                self.centre = token
        names = [one for call in calls for one in variable_occurrences(call)]
        self.cells = [*dict.fromkeys(one.name for one in names if is_bound_by_match(one, types))]
        self.helpers = [partial(self._helper, 0, cells, {(): 1}, []) for _ in calls]
        self.sizes, self.words = list[int](), list[list[str]]()
        for kind, group in enumerate((tokens[:1], tokens[1:])):
            first = 1 if kind else 1 + len(calls)
            looks = dict.fromkeys(look for _, cls in group for look in _looks(cls, metamodel))
            numbers = {look: number for number, look in enumerate(looks, first)}
            self.sizes.append(first + len(numbers))
            self.words.append(["none", *["out of sight"] * (first - 1), *map(_look_in_words, looks)])
            for token, cls in group:
                shown = {look: numbers[look] for look in _looks(cls, metamodel)}
                self.helpers.append(partial(self._helper, kind, token, shown, calls))
        self.sizes *= clause.width * clause.height

    def seen(self, rows: Iterable[tuple[int, int, int]]) -> dict[int, tuple[int, int]]:
        """Return the row and column of each object in matches of the helper patterns, except unseen cells."""
        shown = (row for row in rows if row[0] % 2 or row[1] > 1 or self._clause.visible is None)
        return {node: divmod(place // 2, self._clause.width) for place, _, node in shown}

    def _helper(
        self, kind: int, token: Token, numbers: Mapping[_Constraints, int], calls: Sequence[PatternCall], name: str
    ) -> HelperPattern:
        """Return a helper pattern whose matches are a place, a number, and an object that is drawn by a token.

        A place is the position of a component.
        """
        clause, grid, cell = self._clause, self.grid, Variable([*self.cells, "#cell"][0])
        middle, place, number = Variable("#middle"), Variable("#place"), Variable("#number")
        assert self.centre is not None, "the behaviour was checked"
        body = [_drawn_at(self.centre, clause.centre, middle), _drawn_at(token, _NODE, cell)]
        at: Expression = Constant(clause.width * clause.height // 2 * 2 + kind)
        for axis, size, step in ((grid.column, clause.width, 2), (grid.row, clause.height, 2 * clause.width)):
            position, origin = Variable(f"#{axis}"), Variable(f"#from {axis}")
            body += [PathConstraint(grid.cls, (axis,), *ends) for ends in ((middle, origin), (cell, position))]
            distance = Binary("-", position, origin)
            body.append(Check(Binary("<=", FunctionCall("abs", (distance,)), Constant(size // 2))))
            at = Binary("+", at, Binary("*", distance, Constant(step)))
        body += [Comparison("==", place, Evaluation(at)), *calls]
        used = {clause.centre.name, *(one for call in calls for one in mentioned_names(call))}
        if token.cls is None:
            used.add(token.variable)
            body.append(Comparison("==", _NODE, Variable(token.variable)))
        bodies = [(*body, *look, Comparison("==", number, Constant(value))) for look, value in numbers.items()]
        bound = {one: cls for one, cls in self._types.items() if one in used}
        free = [Parameter(one.name) for one in (place, number, _NODE)]
        return _make_helper(name, bound, free, bodies, clause.span)


def _looks(cls: str, metamodel: Metamodel) -> list[_Constraints]:
    """Return the looks of the objects of a class: each concrete class with each combination of values of attributes.

    The attributes are the bools and enums with `@glyph` or `@colour`, as long as there are at most 64 combinations.
    """
    found: list[_Constraints] = []
    for concrete in metamodel.concrete_classes(cls):
        values: list[list[Constraint]] = []
        for one in metamodel.features(concrete).values():
            if isinstance(one, Attribute) and any(mark.name in ("glyph", "colour") for mark in one.annotations):
                literals = one.type.literals if isinstance(one.type, EnumType) else ()
                terms: list[Term] = [EnumLiteral(None, literal) for literal in literals]
                terms += [Constant(False), Constant(True)] if one.type is Scalar.BOOL else []
                if 0 < prod(map(len, values)) * len(terms) <= 64:
                    values.append([PathConstraint(concrete, (one.name,), _NODE, term) for term in terms])
        found += [(TypeConstraint(concrete, _NODE, exact=True), *each) for each in product(*values)]
    return found


def _look_in_words(look: _Constraints) -> str:
    """Return the class and the values of a look, such as `Door, open true`."""
    words = [one.type for one in look if isinstance(one, TypeConstraint)]
    paths = [one for one in look if isinstance(one, PathConstraint)]
    values = [one.target.literal if isinstance(one.target, EnumLiteral) else str(one.target) for one in paths]
    return ", ".join([*words, *(f"{one.features[0]} {value}" for one, value in zip(paths, values, strict=True))])


def _drawn_at(token: Token, start: Variable, end: Variable) -> Constraint:
    """Return the constraint that the path of a token leads from an object to a cell."""
    features = base_of(token.path)[1]
    return PathConstraint("", features, start, end) if features else Comparison("==", start, end)
