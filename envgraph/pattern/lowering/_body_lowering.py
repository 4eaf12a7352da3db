"""Lower one body of a pattern to goals over numbered variables (slots)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from envgraph.errors import Span
from envgraph.metamodel import Attribute, AttributeType, Feature, Metamodel, Scalar
from envgraph.pattern._enumerable_variables import enumerated_by_type
from envgraph.pattern._expression_data import (
    Binary,
    Constant,
    EnumLiteral,
    Expression,
    Navigation,
    Variable,
)
from envgraph.pattern._feature_paths import ResolvedPath, is_derived, resolve_path
from envgraph.pattern._goals import (
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    CallAtom,
    ClosureAtom,
    ConditionAtom,
    Goal,
    InstanceAtom,
    LinkAtom,
    ObjectType,
    RelationAtom,
    StaticType,
    UnequalAtom,
    ValuationAtom,
    relation_variables,
)
from envgraph.pattern._occurrences import base_of, children, none_test_path, terms_of, with_children
from envgraph.pattern._query_data import (
    Aggregate,
    Check,
    Closure,
    ColumnMark,
    Comparison,
    Constraint,
    Evaluation,
    Negation,
    Parameter,
    PathConstraint,
    PatternCall,
    Relation,
    Term,
    TypeConstraint,
)
from envgraph.pattern._type_inference import BodyTypes
from envgraph.pattern._types import are_comparable, coerce, static_type, value_type
from envgraph.pattern.expressions._evaluate import check_holds, value_of
from envgraph.pattern.expressions._expression_types import ExpressionChecker
from envgraph.pattern.lowering._variable_slots import Slots, Unsatisfiable

PatternGenerator = Callable[[ResolvedPath | AttributeType | Feature], str]
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

    def __init__(self, parameters: Sequence[Parameter], body_types: BodyTypes, generate: PatternGenerator) -> None:
        self._types = body_types
        self._metamodel: Metamodel = body_types.metamodel
        self._generate = generate
        self._group_count = 0
        self._value_slots: dict[tuple[int, Feature], int] = {}
        self.slots = Slots(self._metamodel)
        for parameter in parameters:
            self.slots.create_slot(body_types.type_of(parameter.name), parameter.name)
        self.goals = self._lower_all(body_types.reading.body.constraints)
        for name, type_ in enumerated_by_type(body_types, parameters):
            self.goals.append((CallAtom(generate(type_), (self.slots.named_slot(name, type_),)), None))

    def _lower_all(self, constraints: Sequence[Constraint]) -> list[tuple[Goal, Span | None]]:
        buckets: list[list[Goal]] = []
        later: list[tuple[list[Goal], Evaluation | Check, int]] = []
        self._deferred_items = later
        for constraint in constraints:
            self._current_goals: list[Goal] = []
            buckets.append(self._current_goals)
            self._lower_constraint(constraint)
        self._index_single_values(buckets)
        for bucket, item, result in later:
            self._current_goals = bucket
            if isinstance(item, Check):
                self._lower_check(item.expression)
            else:
                self._lower_evaluation(item.expression, result)
        return [
            (atom, constraint.span) for constraint, bucket in zip(constraints, buckets, strict=True) for atom in bucket
        ]

    def _lower_constraint(self, constraint: Constraint) -> None:
        match constraint:
            case Check():
                self._deferred_items.append((self._current_goals, constraint, -1))
            case Comparison():
                self._lower_comparison(constraint)
            case Negation():
                if grouped := self._grouped_atom(constraint.relation):
                    self._current_goals.append(_absence_of(*grouped[:2]))
            case TypeConstraint() | PathConstraint() | PatternCall():
                self._lower_relation(constraint)

    # --- terms

    def _slot_for(self, term: Term, expected: StaticType | None) -> int:
        """Return the slot of an argument: the variable's own, else a new slot.

        A literal fixes the new slot, and goals compute an eval or aggregate.
        """
        match term:
            case Variable():
                if term.is_anonymous:
                    return self.slots.create_slot(expected)
                return self.slots.named_slot(term.name, self._types.type_of(term.name))
            case Constant():
                assert term.value is not None
                slot = self.slots.create_slot(expected or value_type(term.value))
                self.slots.fix_value(slot, coerce(term.value, expected))
                return slot
            case EnumLiteral():
                slot = self.slots.create_slot(expected or self._types.type_of_term(term))
                self.slots.fix_value(slot, term.literal)
                return slot
            case ColumnMark():
                return self.slots.create_slot(expected)
            case Evaluation() | Aggregate():
                slot = self.slots.create_slot(self._types.type_of_term(term) or expected)
                self._lower_computed(term, slot)
                return slot

    def _lower_computed(self, term: Evaluation | Aggregate, result: int) -> None:
        if isinstance(term, Evaluation):
            self._deferred_items.append((self._current_goals, term, result))
        else:
            self._lower_aggregate(term, result)

    # --- comparisons

    def _lower_comparison(self, comparison: Comparison) -> None:
        left, right = comparison.left, comparison.right
        if comparison.operator == "!=":
            one, other = self._side_slots(left, right)
            self._current_goals.append(UnequalAtom(one, other))
        elif isinstance(right, Evaluation | Aggregate) and not isinstance(left, Evaluation | Aggregate):
            self._lower_computed(right, self._slot_for(left, self._types.type_of_term(right)))
        elif isinstance(left, Evaluation | Aggregate) and not isinstance(right, Evaluation | Aggregate):
            self._lower_computed(left, self._slot_for(right, self._types.type_of_term(left)))
        else:
            self.slots.unite(*self._side_slots(left, right))

    def _side_slots(self, left: Term, right: Term) -> tuple[int, int]:
        expected = self._compared_type(left, right)
        return self._slot_for(left, expected), self._slot_for(right, expected)

    def _compared_type(self, left: Term, right: Term) -> StaticType | None:
        """Return the type of the left side, or of the right side if the left side is a literal or has no known type."""
        one, other = self._types.type_of_term(left), self._types.type_of_term(right)
        if isinstance(left, Constant) or one is None:
            return other or one
        return one

    # --- positive relations

    def _lower_relation(self, relation: Relation) -> None:
        columns = self._types.column_types(relation)
        slots = [self._slot_for(term, type_) for term, type_ in zip(terms_of(relation), columns, strict=True)]
        match relation:
            case TypeConstraint():
                if isinstance(static_type(relation.type, self._metamodel), ObjectType):
                    self._current_goals.append(InstanceAtom(relation.type, slots[0], relation.exact))
            case PathConstraint():
                path = self._resolved_path(relation)
                if relation.closure is Closure.ONCE:
                    self._current_goals.extend(self._step_atoms(path, slots[0], slots[1]))
                else:
                    step = self._generate(path)
                    self._current_goals.append(ClosureAtom(step, relation.closure, slots[0], slots[1]))
            case PatternCall():
                name = self._callee_name(relation)
                if relation.closure is Closure.ONCE:
                    self._current_goals.append(CallAtom(name, tuple(slots)))
                else:
                    self._current_goals.append(ClosureAtom(name, relation.closure, slots[0], slots[1]))

    def _resolved_path(self, constraint: PathConstraint) -> ResolvedPath:
        path = self._types.resolved_path(constraint)
        assert path is not None
        return path

    def _callee_name(self, call: PatternCall) -> str:
        signature = self._types.callee(call.pattern)
        assert signature is not None
        return signature.pattern.qualified_name

    def _step_atoms(self, path: ResolvedPath, source: int, target: int) -> Iterator[Goal]:
        """Yield one goal for each step of a path, with new variables between steps.

        First yield a test of the source's class if the first step does not imply it.
        """
        if not self._metamodel.is_a(path.steps[0].owner, path.cls):
            yield InstanceAtom(path.cls, source)
        current = source
        for position, feature in enumerate(path.steps):
            last = position == len(path.steps) - 1
            reached = (
                target if last else self.slots.create_slot(ResolvedPath(path.cls, path.steps[: position + 1]).target)
            )
            yield self._feature_atom(feature, current, reached)
            current = reached

    def _feature_atom(self, feature: Feature, source: int, target: int) -> AttributeAtom | LinkAtom | CallAtom:
        query = self._generate(feature) if is_derived(feature) else ""
        if query:
            return CallAtom(query, (source, target))
        if isinstance(feature, Attribute) and not feature.many:
            return AttributeAtom(feature, source, target)
        return LinkAtom(feature, source, target)

    # --- negations and aggregates

    def _lower_aggregate(self, aggregate: Aggregate, result: int) -> None:
        grouped = self._grouped_atom(aggregate.over)
        if grouped is not None:
            atom, local, column = grouped
            self._current_goals.append(AggregateAtom(aggregate.function, atom, local, result, column))
        elif aggregate.function in ("count", "sum"):
            self.slots.fix_value(result, coerce(0, self.slots.type_of(result)))
        else:
            raise Unsatisfiable

    def _grouped_atom(self, relation: Relation) -> tuple[RelationAtom, frozenset[int], int | None] | None:
        """Return a negated or aggregated relation as one atom, its local variables, and the variable marked by `#`.

        Return None if the type of an argument rules out every tuple. The test is needed for correctness, because object
        3 and the number 3 are the same value for a matcher.
        """
        number = self._group_count
        self._group_count += 1
        columns = self._types.column_types(relation)
        slots: list[int] = []
        local: list[int] = []
        column = None
        possible = True
        for term, type_ in zip(terms_of(relation), columns, strict=True):
            slot = self._slot_for(term, type_)
            slots.append(slot)
            if self._is_local(term, number):
                local.append(slot)
            if isinstance(term, ColumnMark):
                column = slot
            actual = self.slots.type_of(slot)
            if actual is not None and type_ is not None and not are_comparable(actual, type_, self._metamodel):
                possible = False
        return (self._relation_atom(relation, slots, local), frozenset(local), column) if possible else None

    def _is_local(self, term: Term, number: int) -> bool:
        if isinstance(term, Variable):
            return term.is_anonymous or self._types.reading.quantifying_relation(term.name) == number
        return isinstance(term, ColumnMark)

    def _relation_atom(self, relation: Relation, slots: Sequence[int], local: Sequence[int]) -> RelationAtom:
        match relation:
            case TypeConstraint():
                return InstanceAtom(relation.type, slots[0], relation.exact)
            case PatternCall():
                return CallAtom(self._callee_name(relation), tuple(slots))
            case PathConstraint():
                return self._path_atom(self._resolved_path(relation), slots[0], slots[1], slots[0] in local)

    def _path_atom(self, path: ResolvedPath, source: int, target: int, is_local_source: bool) -> RelationAtom:
        """Return a path as one atom: one step as a link or attribute if sufficient, else a call of a generated pattern.

        Args:
            path: the path.
            source: the slot at its start.
            target: the slot at its end.
            is_local_source: True if `source` is local to a negation or aggregate, so that nothing else tests its class.
        """
        first = path.steps[0]
        actual = self.slots.type_of(source)
        typed = not is_local_source and isinstance(actual, ObjectType) and self._metamodel.is_a(actual.cls, path.cls)
        if len(path.steps) == 1 and (typed or self._metamodel.is_a(first.owner, path.cls)):
            return self._feature_atom(first, source, target)
        return CallAtom(self._generate(path), (source, target))

    # --- expressions

    def _index_single_values(self, buckets: Sequence[Sequence[Goal]]) -> None:
        """Record which variable holds the value of a single-valued feature of an object variable, for `_path_end`."""
        for bucket in buckets:
            for atom in bucket:
                if isinstance(atom, AttributeAtom):
                    self._value_slots.setdefault((self.slots.representative(atom.object), atom.attribute), atom.value)
                elif isinstance(atom, LinkAtom) and not atom.reference.many:
                    self._value_slots.setdefault((self.slots.representative(atom.source), atom.reference), atom.target)

    def _lower_check(self, expression: Expression) -> None:
        """Lower a check to goals. Each operand of `&&` becomes a goal of its own.

        Tests with `none` become goals without an expression, and equations may unite or fix slots instead.
        """
        if isinstance(expression, Binary) and expression.operator == "&&":
            for part in children(expression):
                self._lower_check(part)
            return
        tested = none_test_path(expression)
        if tested is not None and isinstance(expression, Binary):
            self._lower_none_test(tested, expression.operator == "==")
            return
        lifted = self._over_slots(expression)
        reads = slots_read(lifted)
        if not reads:
            if not check_holds(lifted, {}):
                raise Unsatisfiable
        elif not self._unite_equation(lifted):
            self._current_goals.append(ConditionAtom(lifted, reads))

    def _unite_equation(self, expression: Expression) -> bool:
        """Replace `a == b` by united slots or a fixed slot, if the types allow it. Return True if it was replaced.

        Plans can use united and fixed slots as join or index keys.
        """
        if not (isinstance(expression, Binary) and expression.operator == "=="):
            return False
        left, right = expression.left, expression.right
        if isinstance(left, Variable) and isinstance(right, Variable):
            one, other = int(left.name), int(right.name)
            if self.slots.type_of(one) == self.slots.type_of(other):
                self.slots.unite(one, other)
                return True
        for side, literal in ((left, right), (right, left)):
            if isinstance(side, Variable) and isinstance(literal, Constant) and literal.value is not None:
                slot = int(side.name)
                own, type_ = value_type(literal.value), self.slots.type_of(slot)
                if own == type_ or isinstance(literal.value, str) or (own is Scalar.INT and type_ is Scalar.FLOAT):
                    self.slots.fix_value(slot, coerce(literal.value, type_))
                    return True
        return False

    def _lower_evaluation(self, expression: Expression, result: int) -> None:
        lifted = self._over_slots(expression)
        if isinstance(lifted, Variable):
            self.slots.unite(result, int(lifted.name))
            return
        reads = slots_read(lifted)
        if reads:
            self._current_goals.append(ValuationAtom(lifted, reads, result))
            return
        value = value_of(lifted, {})
        if value is None:
            raise Unsatisfiable
        self.slots.fix_value(result, coerce(value, self.slots.type_of(result)))

    def _over_slots(self, expression: Expression) -> Expression:
        """Return the expression over slots: paths become variables, enum literals strings, and `none` tests counts."""
        tested = none_test_path(expression)
        if tested is not None and isinstance(expression, Binary):
            counted = Variable(str(self._target_count(tested)))
            return Binary(expression.operator, counted, Constant(0), expression.span)
        match expression:
            case Variable():
                slot = self.slots.named_slot(expression.name, self._types.type_of(expression.name))
                return Variable(str(slot), expression.span)
            case EnumLiteral():
                return Constant(expression.literal)
            case Navigation():
                return Variable(str(self._path_end(expression)), expression.span)
            case _:
                return with_children(expression, [self._over_slots(child) for child in children(expression)])

    def _path_end(self, navigation: Navigation) -> int:
        """Return the variable at the end of a path. Steps without a variable get a new variable and a goal."""
        base, features = base_of(navigation)
        current = self._path_start(base)
        for name in features:
            feature = self._feature_of(current, name)
            key = (self.slots.representative(current), feature)
            if key not in self._value_slots:
                type_ = feature.type if isinstance(feature, Attribute) else ObjectType(feature.target)
                self._value_slots[key] = self.slots.create_slot(type_)
                self._current_goals.append(self._feature_atom(feature, current, self._value_slots[key]))
            current = self._value_slots[key]
        return current

    def _path_start(self, expression: Expression) -> int:
        """Return the variable at the start of a path. If the start is an expression, add goals that compute it."""
        if isinstance(expression, Variable):
            return self.slots.named_slot(expression.name, self._types.type_of(expression.name))
        type_ = ExpressionChecker(self._types.types, self._metamodel, False).type_of(expression)
        result = self.slots.create_slot(type_)
        self._lower_evaluation(expression, result)
        return result

    def _feature_of(self, slot: int, name: str) -> Feature:
        owner = self.slots.type_of(slot)
        assert isinstance(owner, ObjectType)
        feature = self._metamodel.feature(owner.cls, name)
        assert feature is not None
        return feature

    def _tested_path_atom(self, navigation: Navigation) -> tuple[RelationAtom, int]:
        """Return the path of a `none` test as one atom, and the new local variable at its end."""
        base, features = base_of(navigation)
        source = self._path_start(base)
        owner = self.slots.type_of(source)
        assert isinstance(owner, ObjectType)
        path = resolve_path(owner.cls, features, self._metamodel)
        assert isinstance(path, ResolvedPath)
        target = self.slots.create_slot(path.target)
        return self._path_atom(path, source, target, False), target

    def _lower_none_test(self, navigation: Navigation, absent: bool) -> None:
        if absent:
            atom, target = self._tested_path_atom(navigation)
            self._current_goals.append(_absence_of(atom, frozenset((target,))))
        else:
            self._path_end(navigation)

    def _target_count(self, navigation: Navigation) -> int:
        """Add a goal that counts the values of a path, for a `none` test in an expression. Return its result slot."""
        atom, target = self._tested_path_atom(navigation)
        result = self.slots.create_slot(Scalar.INT)
        self._current_goals.append(AggregateAtom("count", atom, frozenset((target,)), result))
        return result


def _absence_of(relation: RelationAtom, local: frozenset[int]) -> AbsenceAtom:
    return AbsenceAtom(((relation,),), tuple(dict.fromkeys(v for v in relation_variables(relation) if v not in local)))


def slots_read(expression: Expression) -> tuple[tuple[str, int], ...]:
    """Return the names (slot numbers as text) and the slots that a lowered expression reads, each pair once."""
    if isinstance(expression, Variable):
        return ((expression.name, int(expression.name)),)
    return tuple(dict.fromkeys(read for child in children(expression) for read in slots_read(child)))
