"""Comparisons with values that are known, for which a loop over objects looks them up."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

from envgraph.code import dataclass
from envgraph.errors import spelling
from envgraph.match.plan._plan import Kind, Step
from envgraph.match.plan._sharing import mentioned
from envgraph.metamodel import Scalar
from envgraph.pattern import (
    AggregateAtom,
    AttributeAtom,
    Binary,
    Condition,
    Constant,
    Expression,
    FunctionCall,
    InstanceAtom,
    StaticType,
    UnequalAtom,
    Valuation,
    Variable,
    children,
    variables,
    variables_in,
)


@dataclass(frozen=True, slots=True)
class Side:
    """Holds one side of a comparison: an expression, and the variables that its names stand for."""

    expression: Expression
    reads: tuple[tuple[str, int], ...]

    @property
    def variables(self) -> tuple[int, ...]:
        """The variables that it reads."""
        return tuple(variable for _, variable in self.reads)


@dataclass(frozen=True, slots=True)
class ValueJoin:
    """Comparisons of values of an object, over which is looped, with values that are known before.

    Attributes:
        own: what is computed of the object: what has to be equal, and last what has bounds, or `none`.
        known: what it is compared with, in the same order; as many bounds at the end as there are operators.
        operators: of the bounds, with the value of the object on the left.
        steps: what has to be met to compute it, of what follows the loop.
        tests: the comparisons, if they are nothing but tests of attributes of the object.
        alone: whether `own` depends on nothing but the attributes and the class of the object.
        whole: whether nothing else follows, so that they are counted by `own`.
    """

    own: tuple[Side, ...]
    known: tuple[Side, ...]
    operators: tuple[str, ...]
    steps: tuple[Step, ...]
    tests: tuple[Step, ...]
    alone: bool
    whole: bool

    def usable(self, watched: bool) -> bool:
        """Return whether there is an index for it: views have those of values that are computed of one object."""
        return not watched or (self.alone and not self.tests)


def value_join(
    loop: Step,
    following: Sequence[Step],
    known: frozenset[int],
    constants: Collection[int],
    types: Sequence[StaticType],
) -> ValueJoin | None:
    """Return the comparisons that tell a loop to be over fewer objects; None if there are none.

    An expression that fails has no value, and no comparison with it holds. Functions of the user are left out: they
    are called as often as without an index.

    Args:
        loop, following: a step, and those after it.
        known, constants: variables with a value before it, those with a fixed value apart.
        types: of all variables.
    """
    if loop.kind is not Kind.LOOP or not isinstance(loop.goal, InstanceAtom):
        return None
    own, outer = set(loop.binds), set(known)
    equal, bounds, steps, tests = list[_Compared](), list[_Compared](), list[Step](), list[Step]()
    whole = True
    for step in following:
        names, goal, compared = set(mentioned(step)), step.goal, None
        if step.kind is Kind.LOOP and (equal or bounds or names & outer or not names & own):
            whole = False
            break
        if names & own and names & outer:
            compared = _compared(step, own.union(constants), known.union(constants), types)
        if compared and compared[0] == "==" and compared[1] not in [each[1] for each in equal]:
            equal.append(compared)
            if isinstance(goal, AttributeAtom) and goal.object in loop.binds:
                tests.append(step)
            if not isinstance(goal, Condition):
                steps.append(replace(step, kind=Kind.BIND, binds=compared[1].variables))
        elif (
            compared
            and compared[0] != "=="
            and all(spelling(compared[1]) == spelling(side) for _, side, _ in bounds)
        ):
            bounds.append(compared)
        elif names & outer or (isinstance(goal, Condition | Valuation) and not _pure(goal.expression)):
            outer.update(step.binds)
            whole = False
        else:
            steps.append(step)
            own.update(step.binds)
    if not (equal or bounds):
        return None
    plain = len(tests) == len(equal) and not bounds
    return ValueJoin(
        (*(side for _, side, _ in equal), bounds[0][1] if bounds else Side(Constant(None), ())),
        tuple(side for _, _, side in (*equal, *bounds)),
        tuple(operator for operator, _, _ in bounds),
        tuple(steps),
        tuple(tests) if plain else (),
        all(_alone(loop, step) for step in steps),
        whole and not plain and all(step.kind is not Kind.LOOP for step in steps),
    )


_Compared = tuple[str, Side, Side]
"""An operator, the side of a loop, and the side that is known before."""
_FLIPPED: Final = {"==": "==", "<": ">", "<=": ">=", ">": "<", ">=": "<="}


def _compared(
    step: Step, own: Collection[int], known: Collection[int], types: Sequence[StaticType]
) -> _Compared | None:
    """Return what a test compares, if one side is the loop's, and the other is known before it."""
    goal = step.goal
    match goal:
        case _ if step.kind is not Kind.TEST:
            return None
        case AttributeAtom(_, _, value) | Valuation(_, _, value) | AggregateAtom(_, _, _, value):
            side = Side(Variable("value"), (("value", value),))
            if value in known and all(v in own for v in variables(goal) if v != value):
                return "==", side, side
        case Condition(Binary(operator) as whole, reads) if operator in _FLIPPED and _pure(whole):
            one, other = (_side(side, dict(reads)) for side in (whole.left, whole.right))
            for left, right, sign in ((one, other, operator), (other, one, _FLIPPED[operator])):
                if all(v in own for v in left.variables) and all(v in known for v in right.variables):
                    exact = all(types[v] is Scalar.INT for v in (*left.variables, *right.variables))
                    return _shifted(sign, left, right) if exact else (sign, left, right)
    return None


def _shifted(operator: str, own: Side, known: Side) -> _Compared:
    """Return the same comparison of ints, `x < y - 3` for `x + 3 < y`, so that several bounds are of one value."""
    match own.expression:
        case Binary("+" | "-" as sign, Variable() as value, Constant() as constant):
            if _whole(known.expression) and _whole(constant):
                other = Binary("-" if sign == "+" else "+", known.expression, constant)
                return operator, Side(value, own.reads), Side(other, known.reads)
    return operator, own, known


def _whole(expression: Expression) -> bool:
    """Return whether an expression of ints is calculated with ints alone, and cannot fail."""
    if isinstance(expression, Binary):
        return expression.operator in ("+", "-", "*") and all(map(_whole, children(expression)))
    return isinstance(expression, Variable) or (
        isinstance(expression, Constant) and type(expression.value) is int
    )


def _side(expression: Expression, numbers: Mapping[str, int]) -> Side:
    names = dict.fromkeys(variable.name for variable in variables_in(expression))
    return Side(expression, tuple((name, numbers[name]) for name in names))


def _alone(loop: Step, step: Step) -> bool:
    """Return whether a step reads nothing but attributes and the class of the object of a loop."""
    if isinstance(step.goal, AttributeAtom):
        return step.goal.object in loop.binds
    computed = isinstance(step.goal, Condition | InstanceAtom | UnequalAtom | Valuation)
    return computed and step.kind in (Kind.TEST, Kind.BIND)


def _pure(expression: Expression) -> bool:
    """Return whether an expression calls no function of the user, and has no `none` in it, which equals itself."""
    if isinstance(expression, FunctionCall) and expression.declaration is not None:
        return False
    if isinstance(expression, Constant) and expression.value is None:
        return False
    return all(map(_pure, children(expression)))
