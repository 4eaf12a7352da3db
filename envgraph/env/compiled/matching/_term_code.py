"""Emit code for expressions on encoded values, with tests for missing values and for errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, TypeAlias

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled.layout._member_data import check_int_range, emit_missing_value, literal_ranks
from envgraph.env.compiled.layout._not_compiled import NotCompiled
from envgraph.env.compiled.layout._program_layout import L, S, StringNumber, emit_entry, emit_sum
from envgraph.env.compiled.layout._text_tables import TextTable
from envgraph.env.compiled.matching._model_reading import ModelReader
from envgraph.metamodel import LARGEST_INT, Attribute, EnumType, Reference, Scalar, Value
from envgraph.pattern import (
    FUNCTIONS,
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
    check_expression,
    children,
    value_type,
    with_children,
)

Test: TypeAlias = code.Expression

_COMPARISONS: Final = ("<", "<=", ">", ">=")
_EXACT_FLOAT: Final = 2**53
"""Below this, floats that equal ints are different for different ints."""
_CHECKED: Final = {"+": "add_checked", "-": "subtract_checked", "*": "multiply_checked"}
"""Functions that return the last 64 bits of a result, and if it has more."""
_TO_FLOAT: Final = ("toFloat", "doubleValue", "floatValue")
"""The functions that only change the type of a number."""


@dataclass(frozen=True, slots=True)
class CodeTerm:
    """The code of an expression's value, with the tests that must pass before the value is used.

    Attributes:
        value: a truth value for bools, otherwise the value's number; it may be evaluated only if the tests pass.
        type: the type of the value; None for `none`.
        valid: tests that the evaluation does not fail; each test may assume that the earlier ones pass.
        present: tests, to run after `valid`, that the expression has a value.
        certain_class: a class that the object certainly has; None if no class is certain.
        most: the largest absolute value of an int.
        beyond: code that tests if an int has more than 64 bits; None if it cannot have.
    """

    value: code.Expression
    type: StaticType | None
    valid: tuple[Test, ...] = ()
    present: tuple[Test, ...] = ()
    certain_class: str | None = None
    most: int = LARGEST_INT
    beyond: Test | None = None

    @property
    def tests(self) -> tuple[Test, ...]:
        """Return all tests that must pass for the expression to have a value."""
        return (*self.valid, *self.present)

    def limited(self, *, is_operand: bool) -> CodeTerm:
        """Return the term with tests that an int has at most 64 bits.

        A whole expression with more has no value, as on the live engine. An operand with more is exact there, and
        ints of -(2**63) represent missing values here, so that both set an error of the state.
        """
        if self.type is not Scalar.INT or self.most <= LARGEST_INT:
            return self
        beyond = self.beyond or code.FALSE
        tests = [] if is_operand or self.beyond is None else [code.emit_not(beyond)]
        tests.append(code.emit_call("within", S, self.value, beyond if is_operand else code.FALSE))
        if self.present:
            missing = code.emit_not(code.emit_joined("and", self.present, True))
            tests = [code.Operation("or", (missing, test)) for test in tests]
        return replace(self, valid=(*self.valid, *tests), most=LARGEST_INT, beyond=None)

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
        return self._emit(node, expected).limited(is_operand=False)

    def _emit(self, node: Expression, expected: StaticType | None = None) -> CodeTerm:
        """Emit code for an expression, without tests that its own value has at most 64 bits."""
        node = self._as_call(node)
        if self._is_text_operation(node):
            return self._emit_text_operation(node)
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
                if node.declaration is not None:
                    raise NotCompiled(f"the function `{node.function}`, which is written in Python", node.span)
                return self._emit_function(node.function, node.arguments)

    def _emit_required(self, node: Expression) -> CodeTerm:
        """Return the term of an operand that must have a value: the evaluation fails if the value is missing."""
        term = self._emit(node).limited(is_operand=True)
        return replace(term, valid=term.tests, present=())

    def _emit_navigation(self, node: Navigation) -> CodeTerm:
        owner = self._emit(node.object)
        assert isinstance(owner.type, ObjectType), "functions of values are function calls"
        feature = self._feature_of(owner.type.cls, node.feature)
        owner = self._with_class_test(owner, feature.owner)
        above = owner.certain_class is not None and self._facts.metamodel.is_a(owner.certain_class, feature.owner)
        if isinstance(feature, Attribute):
            type_: StaticType = feature.type
            found = self._facts.emit_attribute_value(feature, owner.value, class_known=above)
            sure = None
        else:
            type_, sure = ObjectType(feature.target), feature.target
            end = self._facts.links.only_other_end(feature, owner.value, forward=True, class_known=above)
            assert end is not None, "paths lead along single references"
            found = end
        if owner.tests:
            found = code.ConditionalExpression(
                code.emit_joined("and", owner.tests, True), found, emit_missing_value(type_)
            )
        local = self._emit_local(found, type_)
        present = (*owner.present, self._facts.emit_is_present(local, type_))
        return CodeTerm(variable_term(local, type_).value, type_, owner.valid, present, sure)

    def _feature_of(self, cls: str, name: str) -> Attribute | Reference:
        feature = self._facts.metamodel.feature(cls, name)
        assert feature is not None
        return feature

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
        first, links = node.chain()
        found = self._emit_required(first)
        for link in links:
            left, right = found.limited(is_operand=True), self._emit_required(link.right)
            valid = (*left.valid, *right.valid)
            if link.operator in _COMPARISONS:
                return CodeTerm(_emit_comparison(link.operator, left, right), Scalar.BOOL, valid)
            found = self._emit_arithmetic(link.operator, left, right, valid)
        return found

    def _emit_arithmetic(self, operator: str, left: CodeTerm, right: CodeTerm, valid: tuple[Test, ...]) -> CodeTerm:
        """Emit code for `+`, `-`, `*`, `/`, `%` or `mod` of two numbers."""
        if operator in ("/", "%", "mod"):
            other = self._emit_local(right.value, right.type or Scalar.INT)
            there = code.Operation("!=", (other, code.Constant(0)))
            valid = (*valid, there)
            right = replace(right, value=code.ConditionalExpression(there, other, code.Constant(1)))
        if Scalar.FLOAT in (left.type, right.type):
            made: code.Expression = code.Operation("%" if operator == "mod" else operator, (left.value, right.value))
            made = code.emit_call("fmod", left.value, right.value) if operator == "%" else made
            return self._emit_finite(made, valid)
        function = {"/": "quotient", "%": "rest", "mod": "modulo"}.get(operator)
        if function:
            most = {"/": left.most, "%": min(left.most, right.most), "mod": right.most}[operator]
            return CodeTerm(code.emit_call(function, left.value, right.value), Scalar.INT, valid, most=most)
        most = left.most * right.most if operator == "*" else left.most + right.most
        if most <= LARGEST_INT:
            return CodeTerm(code.Operation(operator, (left.value, right.value)), Scalar.INT, valid, most=most)
        return self._emit_checked(code.emit_call(_CHECKED[operator], left.value, right.value), valid)

    def _emit_checked(self, pair: code.Expression, valid: tuple[Test, ...]) -> CodeTerm:
        """Return the term of an int that a function returns with a truth value: if it has more than 64 bits."""
        local, beyond = self._facts.new_local_for(Scalar.INT), self._facts.module.new_local("o")
        self.statements.append(code.Assign(code.emit_tuple(local, beyond), pair))
        return CodeTerm(local, Scalar.INT, valid, most=LARGEST_INT + 1, beyond=beyond)

    def _emit_finite(self, made: code.Expression, valid: tuple[Test, ...]) -> CodeTerm:
        """Return the term of a float, which has no value if it is not finite."""
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
            same = _emit_comparison("==", left, right)
        else:
            there, other = (code.emit_joined("and", term.present, True) for term in (left, right))
            values = [_emit_comparison("==", left, right)] if None not in (left.type, right.type) else []
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
        first = self._emit(left).limited(is_operand=True)
        return first, self._emit(right, first.type).limited(is_operand=True)

    def _emit_conditional(self, node: Conditional, expected: StaticType | None) -> CodeTerm:
        test = self._emit_required(node.test)
        if expected is None and _is_literal(node.then):  # `::literal` has the enum of the other branch
            expected = self._type_of(node.otherwise)
        then = self._emit(node.then, expected)
        otherwise = self._emit(node.otherwise, expected or then.type)
        type_ = then.type or otherwise.type
        if Scalar.FLOAT in (then.type, otherwise.type):
            type_ = Scalar.FLOAT

        def tests_of_branch(ones: Sequence[Test], others: Sequence[Test]) -> tuple[Test, ...]:
            if not ones and not others:
                return ()
            either = code.emit_joined("and", ones, True), code.emit_joined("and", others, True)
            return (code.ConditionalExpression(test.value, *either),)

        beyond = None
        if then.beyond or otherwise.beyond:
            beyond = code.ConditionalExpression(test.value, then.beyond or code.FALSE, otherwise.beyond or code.FALSE)
        return CodeTerm(
            code.ConditionalExpression(test.value, emit_as_type(then, type_), emit_as_type(otherwise, type_)),
            type_,
            (*test.valid, *tests_of_branch(then.valid, otherwise.valid)),
            tests_of_branch(then.present, otherwise.present),
            most=max(then.most, otherwise.most),
            beyond=beyond,
        )

    def _emit_function(self, name: str, arguments: Sequence[Expression]) -> CodeTerm:
        """Emit code for a function of numbers."""
        terms = [self._emit_required(argument) for argument in arguments]
        valid = tuple(test for term in terms for test in term.valid)
        if name == "mod":
            return self._emit_arithmetic(name, terms[0], terms[1], valid)
        if FUNCTIONS[name].result is Scalar.INT:
            (term,) = terms
            if term.type is Scalar.INT:
                return term
            number = term.value
            if name == "round":
                number = code.emit_call("nearest", number)
            elif name in ("floor", "ceil"):
                number = code.emit_method_call(code.Name("np"), name, number)
            return self._emit_checked(code.emit_call("whole", number), valid)
        if FUNCTIONS[name].result is Scalar.FLOAT and name not in _TO_FLOAT:
            return self._emit_finite(code.emit_call(name, *map(emit_as_float, terms)), valid)
        types = {term.type for term in terms}
        result = FUNCTIONS[name].result or (Scalar.FLOAT if Scalar.FLOAT in types else Scalar.INT)
        made, *values = [emit_as_type(term, result) for term in terms]
        if name == "abs":
            made = code.emit_call("abs", made)
        for value in values:
            made = code.emit_call(name, made, value)
        return CodeTerm(made, result, valid, most=max(term.most for term in terms))

    # --- strings

    def _type_of(self, node: Expression) -> StaticType | None:
        types = {name: term.type for name, term in self._names.items()}
        return check_expression(node, types, self._facts.metamodel)[0]

    def _as_call(self, node: Expression) -> Expression:
        """Return a function after its argument, such as `text.length`, as a call; other expressions unchanged."""
        match node:
            case Navigation(object, name) if name in FUNCTIONS and not isinstance(self._type_of(object), ObjectType):
                return FunctionCall(name, (object,), node.span)
        return node

    def _is_text_operation(self, node: Expression) -> bool:
        """Return True for a function of strings or of all data, `+` of strings, and comparisons of such results."""
        match self._as_call(node):
            case FunctionCall(name) as call:
                return call.declaration is None and FUNCTIONS[name].parameters[0] in ("string", "data")
            case Binary("+" | "-"):
                return self._type_of(node) is Scalar.STRING
            case Binary(operator) if operator in ("==", "!=", *_COMPARISONS):
                made = [side for side in children(node) if self._is_text_operation(side)]
                return any(self._type_of(side) is Scalar.STRING for side in made)
            case _:
                return False

    def _emit_text_operation(self, node: Expression) -> CodeTerm:
        """Emit code that reads the result of operations on strings from a table of the results for all operands.

        Raises:
            NotCompiled: the result is a string, or an operand has too many values.
        """
        if self._type_of(node) is Scalar.STRING:
            raise NotCompiled("strings that change", node.span)
        operands: list[CodeTerm] = []
        present: list[Test] = []

        def emit_operand(part: Expression) -> Expression:
            part = self._as_call(part)
            if isinstance(part, Constant | EnumLiteral):
                return part
            if self._is_text_operation(part):
                return with_children(part, [*map(emit_operand, children(part))])
            term = self._emit(part).limited(is_operand=True)
            if not isinstance(term.type, EnumType) and term.type not in (Scalar.BOOL, Scalar.STRING):
                raise NotCompiled("a string made of a number", part.span)
            if compared and any(part is side for side in children(node)):
                present.extend(term.present)
            else:
                term = replace(term, valid=term.tests)
            operands.append(term)
            return Variable(f"x{len(operands)}")

        compared = node.operator if isinstance(node, Binary) and node.operator in ("==", "!=") else None
        tabulated = emit_operand(node)
        types = tuple(one.type for one in operands if one.type is not None)
        table = self._facts.layout.offset(TextTable(tabulated, types))
        parts = [one.number_code for one in operands]
        for number in range(len(parts) - 1):
            parts[number] = code.Operation("*", (parts[number], emit_entry(L, emit_sum(table, number))))
        found: code.Expression = emit_entry(L, emit_sum(table, max(len(parts) - 1, 0), *parts))
        valid, nothing = [test for one in operands for test in one.valid], emit_missing_value(Scalar.INT)
        for tests, otherwise in ((present, code.Constant(int(compared == "!="))), (valid, nothing)):
            if tests:
                found = code.ConditionalExpression(code.emit_joined("and", tests, True), found, otherwise)
        local = self._emit_local(found, Scalar.INT)
        return replace(
            variable_term(local, self._type_of(node)), valid=(*valid, code.Operation("!=", (local, nothing)))
        )


def _emit_comparison(operator: str, left: CodeTerm, right: CodeTerm) -> code.Expression:
    """Return code that compares two values. An int and a float are compared exactly, as in Python."""
    for one, other, flipped in ((left, right, False), (right, left, True)):
        if one.type is Scalar.INT and other.type is Scalar.FLOAT and one.most > _EXACT_FLOAT:
            constant = other.value.value if isinstance(other.value, code.Constant) else None
            if not isinstance(constant, float) or abs(constant) >= _EXACT_FLOAT:
                sides = code.emit_call("order", one.value, other.value), code.Constant(0)
                return code.Operation(operator, sides[::-1] if flipped else sides)
    return code.Operation(operator, (left.value, right.value))


def emit_as_type(term: CodeTerm, type_: StaticType | None) -> code.Expression:
    """Return the value's code, converted to float if `type_` is float."""
    if type_ is Scalar.FLOAT and term.type is not Scalar.FLOAT:
        return code.emit_call("float", term.value)
    return term.value


def emit_as_float(term: CodeTerm) -> code.Expression:
    """Return the code of a number converted to float."""
    return emit_as_type(term, Scalar.FLOAT)


def _is_literal(node: Expression) -> bool:
    """Return True for literals and conditionals of literals, because their enum follows only from the expected type."""
    if isinstance(node, Conditional):
        return _is_literal(node.then) and _is_literal(node.otherwise)
    return isinstance(node, EnumLiteral | Constant)


def emit_literal(facts: ModelReader, value: Value, type_: StaticType) -> CodeTerm:
    """Return the term of a literal of a type. Raise `NotCompiled` if it is the int of a missing value."""
    match type_:
        case EnumType():
            return CodeTerm(code.Constant(literal_ranks(type_)[str(value)]), type_)
        case Scalar.STRING:
            return CodeTerm(facts.layout.offset(StringNumber(str(value))), type_)
        case Scalar.FLOAT:
            return CodeTerm(code.Constant(float(value)), type_)
        case Scalar.BOOL:
            return CodeTerm(code.TRUE if value else code.FALSE, type_)
        case _:
            number = check_int_range(int(value))
            return CodeTerm(code.Constant(number), type_, most=abs(number))


def initial_constant(type_: StaticType | None) -> code.Expression:
    """Return the constant that initializes a variable of a type before it is assigned: 0, or 0.0 for floats."""
    return code.Constant(0.0 if type_ is Scalar.FLOAT else 0)
