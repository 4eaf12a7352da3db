"""Find comparisons after a loop over objects that an index of these objects by value can evaluate."""

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
    """One side of a comparison: an expression, and the variables that its names stand for."""

    expression: Expression
    reads: tuple[tuple[str, int], ...]

    @property
    def variables(self) -> tuple[int, ...]:
        """Return the variables that the expression reads."""
        return tuple(variable for _, variable in self.reads)


@dataclass(frozen=True, slots=True)
class ValueJoin:
    """A join by value: an index replaces comparisons of a loop's object with values known before the loop.

    Attributes:
        own: the expressions over the object: first those compared with `==`, last the one with bounds, or `none`.
        known: the values that they are compared with, in the same order; the last ones are the bounds.
        operators: the operator of each bound, with the value of the object on the left.
        steps: the steps after the loop that are needed to compute `own`.
        tests: the comparisons, if all of them are tests of attributes of the object; else empty.
        alone: True if `own` depends only on attributes and class of the object.
        whole: True if no loops and no other tests follow, so that the index can count the matches.
    """

    own: tuple[Side, ...]
    known: tuple[Side, ...]
    operators: tuple[str, ...]
    steps: tuple[Step, ...]
    tests: tuple[Step, ...]
    alone: bool
    whole: bool

    def usable(self, watched: bool) -> bool:
        """Return True if an index may evaluate this join: in a view (`watched`) only if `alone` and without `tests`."""
        return not watched or (self.alone and not self.tests)


def value_join(
    loop: Step,
    following: Sequence[Step],
    known: frozenset[int],
    constants: Collection[int],
    types: Sequence[StaticType],
) -> ValueJoin | None:
    """Return the comparisons that restrict the objects of a loop over a class by value; None if there are none.

    An expression that fails has no value, and comparisons with it are false. Calls of user functions are not indexed:
    they are made as often as without an index.

    Args:
        loop, following: a loop step, and the steps after it.
        known, constants: the variables with values before the loop; those with a fixed value.
        types: the types of all variables.
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
"""An operator, the side of the loop's object, and the side known before the loop."""
_FLIPPED: Final = {"==": "==", "<": ">", "<=": ">=", ">": "<", ">=": "<="}


def _compared(
    step: Step, own: Collection[int], known: Collection[int], types: Sequence[StaticType]
) -> _Compared | None:
    """Return the comparison in a test step between values of the loop's object and known values; else None."""
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
    """Return `x < y - 3` for `x + 3 < y`, so that several bounds share one side. Return others unchanged."""
    match own.expression:
        case Binary("+" | "-" as sign, Variable() as value, Constant() as constant):
            if _whole(known.expression) and _whole(constant):
                other = Binary("-" if sign == "+" else "+", known.expression, constant)
                return operator, Side(value, own.reads), Side(other, known.reads)
    return operator, own, known


def _whole(expression: Expression) -> bool:
    """Return True if an expression of ints uses only `+`, `-` and `*`, and so cannot fail."""
    if isinstance(expression, Binary):
        return expression.operator in ("+", "-", "*") and all(map(_whole, children(expression)))
    return isinstance(expression, Variable) or (
        isinstance(expression, Constant) and type(expression.value) is int
    )


def _side(expression: Expression, numbers: Mapping[str, int]) -> Side:
    """Return a side of a comparison for an expression. `numbers` maps its names to variables."""
    names = dict.fromkeys(variable.name for variable in variables_in(expression))
    return Side(expression, tuple((name, numbers[name]) for name in names))


def _alone(loop: Step, step: Step) -> bool:
    """Return True if a step reads only the class and attributes of the loop's object, or values computed from them."""
    if isinstance(step.goal, AttributeAtom):
        return step.goal.object in loop.binds
    computed = isinstance(step.goal, Condition | InstanceAtom | UnequalAtom | Valuation)
    return computed and step.kind in (Kind.TEST, Kind.BIND)


def _pure(expression: Expression) -> bool:
    """Return True if an expression calls no user function and contains no `none`, which equals itself in an index."""
    if isinstance(expression, FunctionCall) and expression.declaration is not None:
        return False
    if isinstance(expression, Constant) and expression.value is None:
        return False
    return all(map(_pure, children(expression)))
