"""Lower one body of a pattern to goals over numbered variables (slots)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from envgraph.errors import Span
from envgraph.metamodel import Attribute, AttributeType, Feature, Metamodel, Scalar
from envgraph.pattern._binding import bound_by_type
from envgraph.pattern._bodies import base_of, children, none_test, terms_of, with_children
from envgraph.pattern._inference import BodyTypes
from envgraph.pattern._lowered import (
    Absence,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    Condition,
    Goal,
    InstanceAtom,
    LinkAtom,
    ObjectType,
    RelationAtom,
    StaticType,
    UnequalAtom,
    Valuation,
    arguments,
)
from envgraph.pattern._paths import ResolvedPath, derived, resolve_path
from envgraph.pattern._queries import (
    Aggregate,
    Check,
    Closure,
    Comparison,
    Constraint,
    Evaluation,
    Hash,
    Negation,
    Parameter,
    PathConstraint,
    PatternCall,
    Relation,
    Term,
    TypeConstraint,
)
from envgraph.pattern._terms import (
    Binary,
    Constant,
    EnumLiteral,
    Expression,
    Navigation,
    Variable,
)
from envgraph.pattern._types import coerced, comparable, static_type, value_type
from envgraph.pattern.expressions._evaluate import holds, value_of
from envgraph.pattern.expressions._expressions import ExpressionChecker
from envgraph.pattern.lowering._slots import Slots, Unsatisfiable

Generate = Callable[[ResolvedPath | AttributeType | Feature], str]
"""Registers the generated pattern of a path, or of the values of a type, and returns its qualified name. For a derived
feature it returns the pattern that defines the feature, or ""."""


class BodyLowering:
    """The lowering of the constraints of one checked body to goals over slots.

    Checks and evals are lowered after all other constraints, because their paths reuse the variables of path
    constraints on the same feature. The goals are in the order of the text all the same.

    Attributes:
        slots: the variables.
        goals: the goals over slot numbers, each with the span of its constraint. Expressions name a slot by its number.
    """

    def __init__(self, parameters: Sequence[Parameter], body_types: BodyTypes, generate: Generate) -> None:
        self._types = body_types
        self._metamodel: Metamodel = body_types.metamodel
        self._generate = generate
        self._groups = 0
        self._targets: dict[tuple[int, Feature], int] = {}
        self.slots = Slots(self._metamodel)
        for parameter in parameters:
            self.slots.fresh(body_types.of(parameter.name), parameter.name)
        self.goals = self._lower(body_types.reading.body.constraints)
        for name, type_ in bound_by_type(body_types, parameters):
            self.goals.append((CallAtom(generate(type_), (self.slots.named(name, type_),)), None))

    def _lower(self, constraints: Sequence[Constraint]) -> list[tuple[Goal, Span | None]]:
        buckets: list[list[Goal]] = []
        later: list[tuple[list[Goal], Evaluation | Check, int]] = []
        self._later = later
        for constraint in constraints:
            self._bucket: list[Goal] = []
            buckets.append(self._bucket)
            self._constraint(constraint)
        self._index_functions(buckets)
        for bucket, item, result in later:
            self._bucket = bucket
            if isinstance(item, Check):
                self._check(item.expression)
            else:
                self._evaluation(item.expression, result)
        return [
            (atom, constraint.span)
            for constraint, bucket in zip(constraints, buckets, strict=True)
            for atom in bucket
        ]

    def _constraint(self, constraint: Constraint) -> None:
        match constraint:
            case Check():
                self._later.append((self._bucket, constraint, -1))
            case Comparison():
                self._comparison(constraint)
            case Negation():
                self._negation(constraint.relation)
            case TypeConstraint() | PathConstraint() | PatternCall():
                self._positive(constraint)

    # --- terms

    def _slot(self, term: Term, expected: StaticType | None, group: int | None = None) -> int:
        """Return the slot of an argument: the variable's own, else a new slot.

        A literal fixes the new slot, and goals compute an eval or aggregate. `group` is not used.
        """
        match term:
            case Variable():
                if term.anonymous:
                    return self.slots.fresh(expected)
                return self.slots.named(term.name, self._types.of(term.name))
            case Constant():
                assert term.value is not None
                slot = self.slots.fresh(expected or value_type(term.value))
                self.slots.fix(slot, coerced(term.value, expected))
                return slot
            case EnumLiteral():
                slot = self.slots.fresh(expected or self._types.of_term(term))
                self.slots.fix(slot, term.literal)
                return slot
            case Hash():
                return self.slots.fresh(expected)
            case Evaluation() | Aggregate():
                slot = self.slots.fresh(self._types.of_term(term) or expected)
                self._compute(term, slot)
                return slot

    def _compute(self, term: Evaluation | Aggregate, result: int) -> None:
        if isinstance(term, Evaluation):
            self._later.append((self._bucket, term, result))
        else:
            self._aggregate(term, result)

    # --- comparisons

    def _comparison(self, comparison: Comparison) -> None:
        left, right = comparison.left, comparison.right
        if comparison.operator == "!=":
            one, other = self._sides(left, right)
            self._bucket.append(UnequalAtom(one, other))
        elif isinstance(right, Evaluation | Aggregate) and not isinstance(left, Evaluation | Aggregate):
            self._compute(right, self._slot(left, self._types.of_term(right)))
        elif isinstance(left, Evaluation | Aggregate) and not isinstance(right, Evaluation | Aggregate):
            self._compute(left, self._slot(right, self._types.of_term(left)))
        else:
            self.slots.unite(*self._sides(left, right))

    def _sides(self, left: Term, right: Term) -> tuple[int, int]:
        expected = self._comparable(left, right)
        return self._slot(left, expected), self._slot(right, expected)

    def _comparable(self, left: Term, right: Term) -> StaticType | None:
        """Return the type of the left side, or of the right side if the left side is a literal or has no known type."""
        one, other = self._types.of_term(left), self._types.of_term(right)
        if isinstance(left, Constant) or one is None:
            return other or one
        return one

    # --- positive relations

    def _positive(self, relation: Relation) -> None:
        columns = self._types.columns(relation)
        slots = [self._slot(term, type_) for term, type_ in zip(terms_of(relation), columns, strict=True)]
        match relation:
            case TypeConstraint():
                if isinstance(static_type(relation.type, self._metamodel), ObjectType):
                    self._bucket.append(InstanceAtom(relation.type, slots[0], relation.exact))
            case PathConstraint():
                path = self._path(relation)
                if relation.closure is Closure.ONCE:
                    self._bucket.extend(self._steps(path, slots[0], slots[1]))
                else:
                    step = self._generate(path)
                    self._bucket.append(ClosureAtom(step, relation.closure, slots[0], slots[1]))
            case PatternCall():
                name = self._callee(relation)
                if relation.closure is Closure.ONCE:
                    self._bucket.append(CallAtom(name, tuple(slots)))
                else:
                    self._bucket.append(ClosureAtom(name, relation.closure, slots[0], slots[1]))

    def _path(self, constraint: PathConstraint) -> ResolvedPath:
        path = self._types.path(constraint)
        assert path is not None
        return path

    def _callee(self, call: PatternCall) -> str:
        signature = self._types.callee(call.pattern)
        assert signature is not None
        return signature.pattern.qualified_name

    def _steps(self, path: ResolvedPath, source: int, target: int) -> Iterator[Goal]:
        """Yield one goal for each step of a path, with new variables between steps.

        First yield a test of the source's class if the first step does not imply it.
        """
        if not self._metamodel.is_a(path.steps[0].owner, path.cls):
            yield InstanceAtom(path.cls, source)
        current = source
        for position, feature in enumerate(path.steps):
            last = position == len(path.steps) - 1
            reached = (
                target
                if last
                else self.slots.fresh(ResolvedPath(path.cls, path.steps[: position + 1]).target)
            )
            yield self._feature_atom(feature, current, reached)
            current = reached

    def _feature_atom(
        self, feature: Feature, source: int, target: int
    ) -> AttributeAtom | LinkAtom | CallAtom:
        query = self._generate(feature) if derived(feature) else ""
        if query:
            return CallAtom(query, (source, target))
        if isinstance(feature, Attribute) and not feature.many:
            return AttributeAtom(feature, source, target)
        return LinkAtom(feature, source, target)

    # --- negations and aggregates

    def _negation(self, relation: Relation) -> None:
        grouped = self._group(relation)
        if grouped is not None:
            atom, local, _ = grouped
            self._bucket.append(_absence(atom, local))

    def _aggregate(self, aggregate: Aggregate, result: int) -> None:
        grouped = self._group(aggregate.over)
        if grouped is not None:
            atom, local, column = grouped
            self._bucket.append(AggregateAtom(aggregate.function, atom, local, result, column))
        elif aggregate.function in ("count", "sum"):
            self.slots.fix(result, coerced(0, self.slots.type(result)))
        else:
            raise Unsatisfiable

    def _group(self, relation: Relation) -> tuple[RelationAtom, frozenset[int], int | None] | None:
        """Return a negated or aggregated relation as one atom, its local variables, and the variable marked by `#`.

        Return None if the type of an argument rules out every tuple. The test is needed for correctness, because object
        3 and the number 3 are the same value for a matcher.
        """
        number = self._groups
        self._groups += 1
        columns = self._types.columns(relation)
        slots: list[int] = []
        local: list[int] = []
        column = None
        possible = True
        for term, type_ in zip(terms_of(relation), columns, strict=True):
            slot = self._slot(term, type_)
            slots.append(slot)
            if self._is_local(term, number):
                local.append(slot)
            if isinstance(term, Hash):
                column = slot
            actual = self.slots.type(slot)
            if actual is not None and type_ is not None and not comparable(actual, type_, self._metamodel):
                possible = False
        return (self._single(relation, slots, local), frozenset(local), column) if possible else None

    def _is_local(self, term: Term, number: int) -> bool:
        if isinstance(term, Variable):
            return term.anonymous or self._types.reading.quantified(term.name) == number
        return isinstance(term, Hash)

    def _single(self, relation: Relation, slots: Sequence[int], local: Sequence[int]) -> RelationAtom:
        match relation:
            case TypeConstraint():
                return InstanceAtom(relation.type, slots[0], relation.exact)
            case PatternCall():
                return CallAtom(self._callee(relation), tuple(slots))
            case PathConstraint():
                return self._single_path(self._path(relation), slots[0], slots[1], slots[0] in local)

    def _single_path(self, path: ResolvedPath, source: int, target: int, free: bool) -> RelationAtom:
        """Return a path as one atom: one step as a link or attribute if sufficient, else a call of a generated pattern.

        Args:
            path: the path.
            source: the slot at its start.
            target: the slot at its end.
            free: True if `source` is local to a negation or aggregate, so that nothing else tests its class.
        """
        first = path.steps[0]
        actual = self.slots.type(source)
        typed = not free and isinstance(actual, ObjectType) and self._metamodel.is_a(actual.cls, path.cls)
        if len(path.steps) == 1 and (typed or self._metamodel.is_a(first.owner, path.cls)):
            return self._feature_atom(first, source, target)
        return CallAtom(self._generate(path), (source, target))

    # --- expressions

    def _index_functions(self, buckets: Sequence[Sequence[Goal]]) -> None:
        """Record which variable holds the value of a single-valued feature of an object variable, for `_follow`."""
        for bucket in buckets:
            for atom in bucket:
                if isinstance(atom, AttributeAtom):
                    self._targets.setdefault((self.slots.root(atom.object), atom.attribute), atom.value)
                elif isinstance(atom, LinkAtom) and not atom.reference.many:
                    self._targets.setdefault((self.slots.root(atom.source), atom.reference), atom.target)

    def _check(self, expression: Expression) -> None:
        """Lower a check to goals. Each operand of `&&` becomes a goal of its own.

        Tests with `none` become goals without an expression, and equations may unite or fix slots instead.
        """
        if isinstance(expression, Binary) and expression.operator == "&&":
            for part in children(expression):
                self._check(part)
            return
        tested = none_test(expression)
        if tested is not None and isinstance(expression, Binary):
            self._none_constraint(tested, expression.operator == "==")
            return
        lifted = self._lift(expression)
        reads = reads_of(lifted)
        if not reads:
            if not holds(lifted, {}):
                raise Unsatisfiable
        elif not self._as_equation(lifted):
            self._bucket.append(Condition(lifted, reads))

    def _as_equation(self, expression: Expression) -> bool:
        """Replace `a == b` by united slots or a fixed slot, if the types allow it. Return True if it was replaced.

        Plans can use united and fixed slots as join or index keys.
        """
        if not (isinstance(expression, Binary) and expression.operator == "=="):
            return False
        left, right = expression.left, expression.right
        if isinstance(left, Variable) and isinstance(right, Variable):
            one, other = int(left.name), int(right.name)
            if self.slots.type(one) == self.slots.type(other):
                self.slots.unite(one, other)
                return True
        for side, literal in ((left, right), (right, left)):
            if isinstance(side, Variable) and isinstance(literal, Constant) and literal.value is not None:
                slot = int(side.name)
                own, type_ = value_type(literal.value), self.slots.type(slot)
                if (
                    own == type_
                    or isinstance(literal.value, str)
                    or (own is Scalar.INT and type_ is Scalar.FLOAT)
                ):
                    self.slots.fix(slot, coerced(literal.value, type_))
                    return True
        return False

    def _evaluation(self, expression: Expression, result: int) -> None:
        lifted = self._lift(expression)
        if isinstance(lifted, Variable):
            self.slots.unite(result, int(lifted.name))
            return
        reads = reads_of(lifted)
        if reads:
            self._bucket.append(Valuation(lifted, reads, result))
            return
        value = value_of(lifted, {})
        if value is None:
            raise Unsatisfiable
        self.slots.fix(result, coerced(value, self.slots.type(result)))

    def _lift(self, expression: Expression) -> Expression:
        """Return the expression over slots: paths become variables, enum literals strings, and `none` tests counts."""
        tested = none_test(expression)
        if tested is not None and isinstance(expression, Binary):
            counted = Variable(str(self._count_targets(tested)))
            return Binary(expression.operator, counted, Constant(0), expression.span)
        match expression:
            case Variable():
                slot = self.slots.named(expression.name, self._types.of(expression.name))
                return Variable(str(slot), expression.span)
            case EnumLiteral():
                return Constant(expression.literal)
            case Navigation():
                return Variable(str(self._follow(expression)), expression.span)
            case _:
                return with_children(expression, [self._lift(child) for child in children(expression)])

    def _follow(self, navigation: Navigation) -> int:
        """Return the variable at the end of a path. Steps without a variable get a new variable and a goal."""
        base, features = base_of(navigation)
        current = self._base(base)
        for name in features:
            feature = self._feature(current, name)
            key = (self.slots.root(current), feature)
            if key not in self._targets:
                type_ = feature.type if isinstance(feature, Attribute) else ObjectType(feature.target)
                self._targets[key] = self.slots.fresh(type_)
                self._bucket.append(self._feature_atom(feature, current, self._targets[key]))
            current = self._targets[key]
        return current

    def _base(self, expression: Expression) -> int:
        """Return the variable at the start of a path. If the start is an expression, add goals that compute it."""
        if isinstance(expression, Variable):
            return self.slots.named(expression.name, self._types.of(expression.name))
        type_ = ExpressionChecker(self._types.types, self._metamodel, False).type_of(expression)
        result = self.slots.fresh(type_)
        self._evaluation(expression, result)
        return result

    def _feature(self, slot: int, name: str) -> Feature:
        owner = self.slots.type(slot)
        assert isinstance(owner, ObjectType)
        feature = self._metamodel.feature(owner.cls, name)
        assert feature is not None
        return feature

    def _tested_path(self, navigation: Navigation) -> tuple[RelationAtom, int]:
        """Return the path of a `none` test as one atom, and the new local variable at its end."""
        base, features = base_of(navigation)
        source = self._base(base)
        owner = self.slots.type(source)
        assert isinstance(owner, ObjectType)
        path = resolve_path(owner.cls, features, self._metamodel)
        assert isinstance(path, ResolvedPath)
        target = self.slots.fresh(path.target)
        return self._single_path(path, source, target, False), target

    def _none_constraint(self, navigation: Navigation, absent: bool) -> None:
        if absent:
            atom, target = self._tested_path(navigation)
            self._bucket.append(_absence(atom, frozenset((target,))))
        else:
            self._follow(navigation)

    def _count_targets(self, navigation: Navigation) -> int:
        """Add a goal that counts the values of a path, for a `none` test in an expression. Return its result slot."""
        atom, target = self._tested_path(navigation)
        result = self.slots.fresh(Scalar.INT)
        self._bucket.append(AggregateAtom("count", atom, frozenset((target,)), result))
        return result


def _absence(relation: RelationAtom, local: frozenset[int]) -> Absence:
    return Absence(((relation,),), tuple(dict.fromkeys(v for v in arguments(relation) if v not in local)))


def reads_of(expression: Expression) -> tuple[tuple[str, int], ...]:
    """Return the names (slot numbers as text) and the slots that a lowered expression reads, each pair once."""
    if isinstance(expression, Variable):
        return ((expression.name, int(expression.name)),)
    return tuple(dict.fromkeys(read for child in children(expression) for read in reads_of(child)))
