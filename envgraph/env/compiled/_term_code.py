"""Emit code for expressions on encoded values, with tests for missing values and for errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, TypeAlias

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled._member_data import (
    MAX_INT,
    NO_INT,
    check_int_range,
    emit_missing_value,
    literal_ranks,
)
from envgraph.env.compiled._model_reading import ModelReader
from envgraph.env.compiled._not_compiled import NotCompiled
from envgraph.metamodel import Attribute, EnumType, Scalar, Value
from envgraph.pattern import (
    Binary,
    Conditional,
    Constant,
    EnumLiteral,
    Expression,
    FunctionCall,
    Navigation,
    ObjectType,
    StaticType,
    Unary,
    Variable,
    children,
    value_type,
)

Test: TypeAlias = code.Expression

_COMPARISONS: Final = ("<", "<=", ">", ">=")
_INT_BITS: Final = 32
"""Bits of ints in states: with more, programs and their exports read other states."""


@dataclass(frozen=True, slots=True)
class CodeTerm:
    """The code of an expression's value, with the tests that must pass before the value is used.

    Attributes:
        value: a truth value for bools, otherwise the value's number; it may be evaluated only if the tests pass.
        type: the type of the value; None for `none`.
        valid: tests that the evaluation does not fail; each test may assume that the earlier ones pass.
        present: tests, to run after `valid`, that the expression has a value.
        certain_class: a class that the object certainly has; None if no class is certain.
        max_bits: the maximum number of bits of an int; variables have 32.
    """

    value: code.Expression
    type: StaticType | None
    valid: tuple[Test, ...] = ()
    present: tuple[Test, ...] = ()
    certain_class: str | None = None
    max_bits: int = _INT_BITS

    @property
    def tests(self) -> tuple[Test, ...]:
        """Return all tests that must pass for the expression to have a value."""
        return (*self.valid, *self.present)

    @property
    def overflow_test(self) -> Test | None:
        """Return an expression that tests if an int is too large for a variable; None if it always fits."""
        if self.type is not Scalar.INT or self.max_bits <= _INT_BITS:
            return None
        low = code.Operation("<=", (self.value, code.Constant(NO_INT)))
        high = code.Operation(">", (self.value, code.Constant(MAX_INT)))
        return code.Operation("or", (low, high))

    @property
    def number_code(self) -> code.Expression:
        """Return code for the number that encodes the value: 0 or 1 for bools."""
        if self.type is Scalar.BOOL:
            return code.ConditionalExpression(self.value, code.Constant(1), code.Constant(0))
        return self.value


def variable_term(value: code.Expression, type_: StaticType | None, sure: str | None = None) -> CodeTerm:
    """Return the term of a value that is never missing, such as the value of a variable."""
    truth = code.emit_equal(value, code.Constant(1)) if type_ is Scalar.BOOL else value
    return CodeTerm(truth, type_, certain_class=sure)


class ExpressionEmitter:
    """An emitter of code for expressions over some variables.

    Args:
        facts: emits code that reads features.
        names: the term of each variable.

    Attributes:
        statements: statements to run before the emitted expressions. They change nothing, and cannot fail.
    """

    def __init__(self, facts: ModelReader, names: Mapping[str, CodeTerm]) -> None:
        self._facts = facts
        self._names = names
        self.statements: list[code.Statement] = []

    def _emit_local(self, value: code.Expression, type_: StaticType) -> code.Local:
        """Store a value in a new variable, by a statement in `statements`, and return the variable."""
        local = self._facts.new_local_for(type_)
        self.statements.append(code.Assign(local, value))
        return local

    def emit(self, node: Expression, expected: StaticType | None = None) -> CodeTerm:
        """Emit code for an expression.

        Args:
            node: the expression.
            expected: the type of the value if it is known; it determines the enum of a literal without enum name.

        Raises:
            NotCompiled: the expression contains a construct that the compiler does not support.
        """
        match node:
            case Variable():
                return self._names[node.name]
            case Constant(value) if value is None:
                return CodeTerm(code.Constant(-1), None, present=(code.FALSE,))
            case Constant(value):
                assert value is not None
                of_enum = isinstance(expected, EnumType) and isinstance(value, str)
                return emit_literal(self._facts, value, expected if of_enum and expected else value_type(value))
            case EnumLiteral():
                type_ = expected if node.enum is None else self._facts.metamodel.enums.get(node.enum)
                if not isinstance(type_, EnumType):
                    raise NotCompiled(f"the literal `{node.literal}`, whose enum cannot be inferred", node.span)
                return emit_literal(self._facts, node.literal, type_)
            case Navigation():
                return self._emit_navigation(node)
            case Unary("!", operand):
                inner = self._emit_required(operand)
                return replace(inner, value=code.emit_not(inner.value))
            case Unary(_, operand):
                inner = self._emit_required(operand)
                return replace(inner, value=code.Operation("-", (inner.value,)))
            case Binary():
                return self._emit_binary(node)
            case Conditional():
                return self._emit_conditional(node, expected)
            case FunctionCall():
                return self._emit_function(node)

    def _emit_required(self, node: Expression) -> CodeTerm:
        """Return the term of an operand that must have a value: the evaluation fails if the value is missing."""
        term = self.emit(node)
        return replace(term, valid=term.tests, present=())

    def _emit_navigation(self, node: Navigation) -> CodeTerm:
        owner = self.emit(node.object)
        if not isinstance(owner.type, ObjectType):
            raise NotCompiled(f"`.{node.feature}` of a string", node.span)
        feature = self._facts.metamodel.feature(owner.type.cls, node.feature)
        assert feature is not None
        owner = self._with_class_test(owner, feature.owner)
        above = owner.certain_class is not None and self._facts.metamodel.is_a(owner.certain_class, feature.owner)
        if isinstance(feature, Attribute):
            type_: StaticType = feature.type
            found = self._facts.emit_attribute_value(feature, owner.value, class_known=above)
            sure = None
        else:
            type_, sure = ObjectType(feature.target), feature.target
            end = self._facts.links.only_other_end(feature, owner.value, forward=True, class_known=above)
            if end is None:
                raise NotCompiled(f"`{feature}`, which may have several targets, in an expression", node.span)
            found = end
        if owner.tests:
            found = code.ConditionalExpression(
                code.emit_joined("and", owner.tests, True), found, emit_missing_value(type_)
            )
        local = self._emit_local(found, type_)
        present = (*owner.present, self._facts.emit_is_present(local, type_))
        return CodeTerm(variable_term(local, type_).value, type_, owner.valid, present, sure)

    def _with_class_test(self, owner: CodeTerm, cls: str) -> CodeTerm:
        """Return the term of an object with a test that it still has the class of a feature, unless that is certain."""
        if owner.certain_class is not None or self._facts.changes.is_fixed_class(cls):
            return owner
        has = self._facts.emit_is_instance(owner.value, cls)
        if owner.present:
            missing = code.emit_not(code.emit_joined("and", owner.present, True))
            has = code.Operation("or", (missing, has))
        return replace(owner, valid=(*owner.valid, has))

    # --- operators

    def _emit_binary(self, node: Binary) -> CodeTerm:
        match node.operator:
            case "&&" | "||":
                return self._emit_logical(node)
            case "==" | "!=":
                return self._emit_equality(node)
        left, right = self._emit_required(node.left), self._emit_required(node.right)
        valid = (*left.valid, *right.valid)
        if node.operator in _COMPARISONS:
            return CodeTerm(code.Operation(node.operator, (left.value, right.value)), Scalar.BOOL, valid)
        if Scalar.STRING in (left.type, right.type):
            raise NotCompiled("a concatenation of strings", node.span)
        return self._emit_arithmetic(node, left, right, valid)

    def _emit_arithmetic(self, node: Binary, left: CodeTerm, right: CodeTerm, valid: tuple[Test, ...]) -> CodeTerm:
        operator = node.operator
        if operator in "/%":
            other = self._emit_local(right.value, right.type or Scalar.INT)
            there = code.Operation("!=", (other, code.Constant(0)))
            valid = (*valid, there)
            right = replace(right, value=code.ConditionalExpression(there, other, code.Constant(1)))
        if left.type is Scalar.INT and right.type is Scalar.INT:
            bits = {
                "*": left.max_bits + right.max_bits - 1,
                "/": left.max_bits,
                "%": min(left.max_bits, right.max_bits),
            }.get(operator, max(left.max_bits, right.max_bits) + 1)
            if bits > 64:
                raise NotCompiled("a product of ints that may exceed 64 bits", node.span)
            made: code.Expression
            if operator in "/%":
                function = "quotient" if operator == "/" else "rest"
                made = code.emit_call(function, left.value, right.value)
            else:
                made = code.Operation(operator, (left.value, right.value))
            return CodeTerm(made, Scalar.INT, valid, max_bits=bits)
        if operator == "%":
            made = code.emit_call("fmod", left.value, right.value)
        else:
            made = code.Operation(operator, (left.value, right.value))
        local = self._emit_local(made, Scalar.FLOAT)
        finite = code.Operation("<", (code.emit_call("abs", local), code.Name("INFINITY")))
        return CodeTerm(local, Scalar.FLOAT, (*valid, finite))

    def _emit_logical(self, node: Binary) -> CodeTerm:
        """Emit code for `&&` and `||`; an operand may fail only if the operands before it do not decide the result."""
        operator = "and" if node.operator == "&&" else "or"
        terms = [self._emit_required(part) for part in children(node)]
        valid = [*terms[0].valid]
        for number, term in enumerate(terms[1:], 1):
            if term.valid:
                before = code.emit_joined(operator, [each.value for each in terms[:number]], True)
                decided = before if operator == "or" else code.emit_not(before)
                needed = code.emit_joined("and", term.valid, True)
                valid.append(code.Operation("or", (decided, needed)))
        return CodeTerm(code.emit_joined(operator, [term.value for term in terms], True), Scalar.BOOL, tuple(valid))

    def _emit_equality(self, node: Binary) -> CodeTerm:
        left, right = self._emit_sides(node.left, node.right)
        same: code.Expression
        if not left.present and not right.present:
            same = code.emit_equal(left.value, right.value)
        else:
            there, other = (code.emit_joined("and", term.present, True) for term in (left, right))
            values = [code.emit_equal(left.value, right.value)] if None not in (left.type, right.type) else []
            both = code.emit_joined("and", [there, other, *values], True)
            neither = code.Operation("and", (code.emit_not(there), code.emit_not(other)))
            same = code.Operation("or", (both, neither))
        if node.operator == "!=":
            same = code.emit_not(same)
        return CodeTerm(same, Scalar.BOOL, (*left.valid, *right.valid))

    def _emit_sides(self, left: Expression, right: Expression) -> tuple[CodeTerm, CodeTerm]:
        """Emit code for both sides of a comparison; an enum literal gets the enum of the other side."""
        if _is_literal(left) and not _is_literal(right):
            other, one = self._emit_sides(right, left)
            return one, other
        first = self.emit(left)
        return first, self.emit(right, first.type)

    def _emit_conditional(self, node: Conditional, expected: StaticType | None) -> CodeTerm:
        test = self._emit_required(node.test)
        then, otherwise = self.emit(node.then, expected), self.emit(node.otherwise, expected)
        type_ = then.type or otherwise.type
        if Scalar.FLOAT in (then.type, otherwise.type):
            type_ = Scalar.FLOAT

        def tests_of_branch(ones: Sequence[Test], others: Sequence[Test]) -> tuple[Test, ...]:
            if not ones and not others:
                return ()
            either = code.emit_joined("and", ones, True), code.emit_joined("and", others, True)
            return (code.ConditionalExpression(test.value, *either),)

        return CodeTerm(
            code.ConditionalExpression(test.value, _emit_as_type(then, type_), _emit_as_type(otherwise, type_)),
            type_,
            (*test.valid, *tests_of_branch(then.valid, otherwise.valid)),
            tests_of_branch(then.present, otherwise.present),
            max_bits=max(then.max_bits, otherwise.max_bits),
        )

    def _emit_function(self, node: FunctionCall) -> CodeTerm:
        if node.declaration is not None or node.function not in ("abs", "min", "max", "toFloat"):
            raise NotCompiled(f"the function `{node.function}`", node.span)
        terms = [self._emit_required(argument) for argument in node.arguments]
        types = {term.type for term in terms}
        result: StaticType = Scalar.FLOAT if Scalar.FLOAT in types or node.function == "toFloat" else Scalar.INT
        values = [_emit_as_type(term, result) for term in terms]
        made = values[0]
        if node.function == "abs":
            made = code.emit_call("abs", made)
        for value in values[1:]:
            made = code.emit_call(node.function, made, value)
        valid = tuple(test for term in terms for test in term.valid)
        return CodeTerm(made, result, valid, max_bits=max(term.max_bits for term in terms) + 1)


def _emit_as_type(term: CodeTerm, type_: StaticType | None) -> code.Expression:
    """Return the value's code, converted to float if `type_` is float."""
    if type_ is Scalar.FLOAT and term.type is not Scalar.FLOAT:
        return code.emit_call("float", term.value)
    return term.value


def emit_as_float(term: CodeTerm) -> code.Expression:
    """Return the code of a number converted to float."""
    return _emit_as_type(term, Scalar.FLOAT)


def _is_literal(node: Expression) -> bool:
    """Return True for literals and conditionals of literals, because their enum follows only from the expected type."""
    if isinstance(node, Conditional):
        return _is_literal(node.then) and _is_literal(node.otherwise)
    return isinstance(node, EnumLiteral | Constant)


def emit_literal(facts: ModelReader, value: Value, type_: StaticType) -> CodeTerm:
    """Return the term of a literal of a type. Raise `NotCompiled` if it is an int that does not fit into 32 bits."""
    match type_:
        case EnumType():
            return CodeTerm(code.Constant(literal_ranks(type_)[str(value)]), type_)
        case Scalar.STRING:
            return CodeTerm(facts.string_number(str(value)), type_)
        case Scalar.FLOAT:
            return CodeTerm(code.Constant(float(value)), type_)
        case Scalar.BOOL:
            return CodeTerm(code.TRUE if value else code.FALSE, type_)
        case _:
            number = check_int_range(int(value))
            return CodeTerm(code.Constant(number), type_, max_bits=max(number.bit_length(), 1) + 1)


def initial_constant(type_: StaticType | None) -> code.Expression:
    """Return the constant that initializes a variable of a type before it is assigned: 0, or 0.0 for floats."""
    return code.Constant(0.0 if type_ is Scalar.FLOAT else 0)
