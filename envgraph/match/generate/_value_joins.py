"""Find comparisons after a loop over objects that an index of these objects by value can evaluate."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

from envgraph.code import dataclass
from envgraph.errors import exact_key
from envgraph.match.plan._search_plan import PlanStep, StepKind
from envgraph.match.plan._shared_searches import variables_used_by
from envgraph.metamodel import Scalar
from envgraph.pattern import (
    AggregateAtom,
    AttributeAtom,
    Binary,
    ConditionAtom,
    Constant,
    Expression,
    FunctionCall,
    InstanceAtom,
    StaticType,
    UnequalAtom,
    ValuationAtom,
    Variable,
    children,
    variables_in,
    visible_variables,
)


@dataclass(frozen=True, slots=True)
class ComparisonSide:
    """A side of a comparison: an expression, and the variables that its names stand for."""

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
        own_sides: the expressions over the object: first those compared with `==`, last the one with bounds, or `none`.
        known_sides: the values that they are compared with, in the same order; the last ones are the bounds.
        operators: the operator of each bound, with the value of the object on the left.
        steps: the steps after the loop that are needed to compute `own_sides`.
        tests: the comparisons, if all of them are tests of attributes of the object; else empty.
        is_local: True if `own_sides` depends only on attributes and class of the object.
        is_whole_rest: True if no loops and no other tests follow, so that the index can count the matches.
    """

    own_sides: tuple[ComparisonSide, ...]
    known_sides: tuple[ComparisonSide, ...]
    operators: tuple[str, ...]
    steps: tuple[PlanStep, ...]
    tests: tuple[PlanStep, ...]
    is_local: bool
    is_whole_rest: bool

    def is_usable(self, is_view: bool) -> bool:
        """Return True if an index may evaluate this join: in a view (`is_view`) only if `is_local` and without
        `tests`.
        """
        return not is_view or (self.is_local and not self.tests)


def value_join(
    loop: PlanStep,
    following: Sequence[PlanStep],
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
    if loop.kind is not StepKind.LOOP or not isinstance(loop.goal, InstanceAtom):
        return None
    own, outer = set(loop.binds), set(known)
    equal, bounds, steps, tests = list[_Compared](), list[_Compared](), list[PlanStep](), list[PlanStep]()
    whole = True
    for step in following:
        names, goal, compared = set(variables_used_by(step)), step.goal, None
        if step.kind is StepKind.LOOP and (equal or bounds or names & outer or not names & own):
            whole = False
            break
        if names & own and names & outer:
            compared = _comparison_of(step, own.union(constants), known.union(constants), types)
        if compared and compared[0] == "==" and compared[1] not in [each[1] for each in equal]:
            equal.append(compared)
            if isinstance(goal, AttributeAtom) and goal.object in loop.binds:
                tests.append(step)
            if not isinstance(goal, ConditionAtom):
                steps.append(replace(step, kind=StepKind.BIND, binds=compared[1].variables))
        elif (
            compared and compared[0] != "==" and all(exact_key(compared[1]) == exact_key(side) for _, side, _ in bounds)
        ):
            bounds.append(compared)
        elif names & outer or (isinstance(goal, ConditionAtom | ValuationAtom) and not _is_indexable(goal.expression)):
            outer.update(step.binds)
            whole = False
        else:
            steps.append(step)
            own.update(step.binds)
    if not (equal or bounds):
        return None
    is_equality_only = len(tests) == len(equal) and not bounds
    return ValueJoin(
        (*(side for _, side, _ in equal), bounds[0][1] if bounds else ComparisonSide(Constant(None), ())),
        tuple(side for _, _, side in (*equal, *bounds)),
        tuple(operator for operator, _, _ in bounds),
        tuple(steps),
        tuple(tests) if is_equality_only else (),
        all(_is_local_step(loop, step) for step in steps),
        whole and not is_equality_only and all(step.kind is not StepKind.LOOP for step in steps),
    )


_Compared = tuple[str, ComparisonSide, ComparisonSide]
"""An operator, the side of the loop's object, and the side known before the loop."""
_FLIPPED: Final = {"==": "==", "<": ">", "<=": ">=", ">": "<", ">=": "<="}


def _comparison_of(
    step: PlanStep, own: Collection[int], known: Collection[int], types: Sequence[StaticType]
) -> _Compared | None:
    """Return the comparison in a test step between values of the loop's object and known values; else None."""
    goal = step.goal
    match goal:
        case _ if step.kind is not StepKind.TEST:
            return None
        case AttributeAtom(_, _, value) | ValuationAtom(_, _, value) | AggregateAtom(_, _, _, value):
            side = ComparisonSide(Variable("value"), (("value", value),))
            if value in known and [v for v in visible_variables(goal) if v == value or v not in own] == [value]:
                return "==", side, side
        case ConditionAtom(Binary(operator) as whole, reads) if operator in _FLIPPED and _is_indexable(whole):
            one, other = (_side(side, dict(reads)) for side in (whole.left, whole.right))
            for left, right, sign in ((one, other, operator), (other, one, _FLIPPED[operator])):
                if all(v in own for v in left.variables) and all(v in known for v in right.variables):
                    exact = all(types[v] is Scalar.INT for v in (*left.variables, *right.variables))
                    return _move_constant(sign, left, right) if exact else (sign, left, right)
    return None


def _move_constant(operator: str, own: ComparisonSide, known: ComparisonSide) -> _Compared:
    """Return `x < y - 3` for `x + 3 < y`, so that several bounds share one side. Return others unchanged."""
    match own.expression:
        case Binary("+" | "-" as sign, Variable() as value, Constant() as constant):
            if _is_int_arithmetic(known.expression) and _is_int_arithmetic(constant):
                other = Binary("-" if sign == "+" else "+", known.expression, constant)
                return operator, ComparisonSide(value, own.reads), ComparisonSide(other, known.reads)
    return operator, own, known


def _is_int_arithmetic(expression: Expression) -> bool:
    """Return True if an expression of ints uses only `+`, `-` and `*`, and so cannot fail."""
    if isinstance(expression, Binary):
        return expression.operator in ("+", "-", "*") and all(map(_is_int_arithmetic, children(expression)))
    return isinstance(expression, Variable) or (isinstance(expression, Constant) and type(expression.value) is int)


def _side(expression: Expression, numbers: Mapping[str, int]) -> ComparisonSide:
    """Return a side of a comparison for an expression. `numbers` maps its names to variables."""
    names = dict.fromkeys(variable.name for variable in variables_in(expression))
    return ComparisonSide(expression, tuple((name, numbers[name]) for name in names))


def _is_local_step(loop: PlanStep, step: PlanStep) -> bool:
    """Return True if a step reads only the class and attributes of the loop's object, or values computed from them."""
    if isinstance(step.goal, AttributeAtom):
        return step.goal.object in loop.binds
    computed = isinstance(step.goal, ConditionAtom | InstanceAtom | UnequalAtom | ValuationAtom)
    return computed and step.kind in (StepKind.TEST, StepKind.BIND)


def _is_indexable(expression: Expression) -> bool:
    """Return True if an expression calls no user function and contains no `none`, which equals itself in an index."""
    if isinstance(expression, FunctionCall) and expression.declaration is not None:
        return False
    if isinstance(expression, Constant) and expression.value is None:
        return False
    return all(map(_is_indexable, children(expression)))
