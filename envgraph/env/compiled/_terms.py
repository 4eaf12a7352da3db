"""Emit code for expressions on encoded values, with tests for missing values and for errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, TypeAlias

from envgraph import code
from envgraph.code import dataclass
from envgraph.env.compiled._facts import Facts
from envgraph.env.compiled._member import MOST_INT, NO_INT, absent, checked, ranks
from envgraph.env.compiled._refused import NotCompiled
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
class Term:
    """The code of an expression's value, with the tests that must pass before the value is used.

    Attributes:
        value: a truth value for bools, otherwise the value's number; it may be evaluated only if the tests pass.
        type: the type of the value; None for `none`.
        valid: tests that the evaluation does not fail; each test may assume that the earlier ones pass.
        present: tests, to run after `valid`, that the expression has a value.
        sure: a class that the object certainly has; None if no class is certain.
        bits: the maximum number of bits of an int; variables have 32.
    """

    value: code.Expression
    type: StaticType | None
    valid: tuple[Test, ...] = ()
    present: tuple[Test, ...] = ()
    sure: str | None = None
    bits: int = _INT_BITS

    @property
    def tests(self) -> tuple[Test, ...]:
        """Return all tests that must pass for the expression to have a value."""
        return (*self.valid, *self.present)

    @property
    def beyond(self) -> Test | None:
        """Return an expression that tests if an int is too large for a variable; None if it always fits."""
        if self.type is not Scalar.INT or self.bits <= _INT_BITS:
            return None
        low = code.Operation("<=", (self.value, code.Constant(NO_INT)))
        high = code.Operation(">", (self.value, code.Constant(MOST_INT)))
        return code.Operation("or", (low, high))

    @property
    def number(self) -> code.Expression:
        """Return code for the number that encodes the value: 0 or 1 for bools."""
        if self.type is Scalar.BOOL:
            return code.Choice(self.value, code.Constant(1), code.Constant(0))
        return self.value


def named(value: code.Expression, type_: StaticType | None, sure: str | None = None) -> Term:
    """Return the term of a value that is never missing, such as the value of a variable."""
    truth = code.equal(value, code.Constant(1)) if type_ is Scalar.BOOL else value
    return Term(truth, type_, sure=sure)


class Terms:
    """An emitter of code for expressions over some variables.

    Args:
        facts: emits code that reads features.
        names: the term of each variable.

    Attributes:
        steps: statements to run before the emitted expressions. They change nothing, and cannot fail.
    """

    def __init__(self, facts: Facts, names: Mapping[str, Term]) -> None:
        self._facts = facts
        self._names = names
        self.steps: list[code.Statement] = []

    def _kept(self, value: code.Expression, type_: StaticType) -> code.Local:
        """Store a value in a new variable, by a statement in `steps`, and return the variable."""
        local = self._facts.local(type_)
        self.steps.append(code.Assign(local, value))
        return local

    def write(self, node: Expression, expected: StaticType | None = None) -> Term:
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
                return Term(code.Constant(-1), None, present=(code.FALSE,))
            case Constant(value):
                assert value is not None
                of_enum = isinstance(expected, EnumType) and isinstance(value, str)
                return literal(self._facts, value, expected if of_enum and expected else value_type(value))
            case EnumLiteral():
                type_ = expected if node.enum is None else self._facts.metamodel.enums.get(node.enum)
                if not isinstance(type_, EnumType):
                    raise NotCompiled(
                        f"the literal `{node.literal}`, whose enum cannot be inferred", node.span
                    )
                return literal(self._facts, node.literal, type_)
            case Navigation():
                return self._read(node)
            case Unary("!", operand):
                inner = self._present(operand)
                return replace(inner, value=code.inverse(inner.value))
            case Unary(_, operand):
                inner = self._present(operand)
                return replace(inner, value=code.Operation("-", (inner.value,)))
            case Binary():
                return self._binary(node)
            case Conditional():
                return self._conditional(node, expected)
            case FunctionCall():
                return self._function(node)

    def _present(self, node: Expression) -> Term:
        """Return the term of an operand that must have a value: the evaluation fails if the value is missing."""
        term = self.write(node)
        return replace(term, valid=term.tests, present=())

    def _read(self, node: Navigation) -> Term:
        owner = self.write(node.object)
        if not isinstance(owner.type, ObjectType):
            raise NotCompiled(f"`.{node.feature}` of a string", node.span)
        feature = self._facts.metamodel.feature(owner.type.cls, node.feature)
        assert feature is not None
        owner = self._having(owner, feature.owner)
        above = owner.sure is not None and self._facts.metamodel.is_a(owner.sure, feature.owner)
        if isinstance(feature, Attribute):
            type_: StaticType = feature.type
            found = self._facts.value(feature, owner.value, sure=above)
            sure = None
        else:
            type_, sure = ObjectType(feature.target), feature.target
            end = self._facts.links.other_end(feature, owner.value, forward=True, sure=above)
            if end is None:
                raise NotCompiled(f"`{feature}`, which may have several targets, in an expression", node.span)
            found = end
        if owner.tests:
            found = code.Choice(code.joined("and", owner.tests, True), found, absent(type_))
        local = self._kept(found, type_)
        present = (*owner.present, self._facts.present(local, type_))
        return Term(named(local, type_).value, type_, owner.valid, present, sure)

    def _having(self, owner: Term, cls: str) -> Term:
        """Return the term of an object with a test that it still has the class of a feature, unless that is certain."""
        if owner.sure is not None or self._facts.changes.fixed_class(cls):
            return owner
        has = self._facts.is_instance(owner.value, cls)
        if owner.present:
            missing = code.inverse(code.joined("and", owner.present, True))
            has = code.Operation("or", (missing, has))
        return replace(owner, valid=(*owner.valid, has))

    # --- operators

    def _binary(self, node: Binary) -> Term:
        match node.operator:
            case "&&" | "||":
                return self._logical(node)
            case "==" | "!=":
                return self._equality(node)
        left, right = self._present(node.left), self._present(node.right)
        valid = (*left.valid, *right.valid)
        if node.operator in _COMPARISONS:
            return Term(code.Operation(node.operator, (left.value, right.value)), Scalar.BOOL, valid)
        if Scalar.STRING in (left.type, right.type):
            raise NotCompiled("a concatenation of strings", node.span)
        return self._arithmetic(node, left, right, valid)

    def _arithmetic(self, node: Binary, left: Term, right: Term, valid: tuple[Test, ...]) -> Term:
        operator = node.operator
        if operator in "/%":
            other = self._kept(right.value, right.type or Scalar.INT)
            there = code.Operation("!=", (other, code.Constant(0)))
            valid = (*valid, there)
            right = replace(right, value=code.Choice(there, other, code.Constant(1)))
        if left.type is Scalar.INT and right.type is Scalar.INT:
            bits = {
                "*": left.bits + right.bits - 1,
                "/": left.bits,
                "%": min(left.bits, right.bits),
            }.get(operator, max(left.bits, right.bits) + 1)
            if bits > 64:
                raise NotCompiled("a product of ints that may exceed 64 bits", node.span)
            made: code.Expression
            if operator in "/%":
                function = "quotient" if operator == "/" else "rest"
                made = code.call(function, left.value, right.value)
            else:
                made = code.Operation(operator, (left.value, right.value))
            return Term(made, Scalar.INT, valid, bits=bits)
        if operator == "%":
            made = code.call("fmod", left.value, right.value)
        else:
            made = code.Operation(operator, (left.value, right.value))
        local = self._kept(made, Scalar.FLOAT)
        finite = code.Operation("<", (code.call("abs", local), code.Name("INFINITY")))
        return Term(local, Scalar.FLOAT, (*valid, finite))

    def _logical(self, node: Binary) -> Term:
        """Emit code for `&&` and `||`; an operand may fail only if the operands before it do not decide the result."""
        operator = "and" if node.operator == "&&" else "or"
        terms = [self._present(part) for part in children(node)]
        valid = [*terms[0].valid]
        for number, term in enumerate(terms[1:], 1):
            if term.valid:
                before = code.joined(operator, [each.value for each in terms[:number]], True)
                decided = before if operator == "or" else code.inverse(before)
                needed = code.joined("and", term.valid, True)
                valid.append(code.Operation("or", (decided, needed)))
        return Term(code.joined(operator, [term.value for term in terms], True), Scalar.BOOL, tuple(valid))

    def _equality(self, node: Binary) -> Term:
        left, right = self._sides(node.left, node.right)
        same: code.Expression
        if not left.present and not right.present:
            same = code.equal(left.value, right.value)
        else:
            there, other = (code.joined("and", term.present, True) for term in (left, right))
            values = [code.equal(left.value, right.value)] if None not in (left.type, right.type) else []
            both = code.joined("and", [there, other, *values], True)
            neither = code.Operation("and", (code.inverse(there), code.inverse(other)))
            same = code.Operation("or", (both, neither))
        if node.operator == "!=":
            same = code.inverse(same)
        return Term(same, Scalar.BOOL, (*left.valid, *right.valid))

    def _sides(self, left: Expression, right: Expression) -> tuple[Term, Term]:
        """Emit code for both sides of a comparison; an enum literal gets the enum of the other side."""
        if _is_literal(left) and not _is_literal(right):
            other, one = self._sides(right, left)
            return one, other
        first = self.write(left)
        return first, self.write(right, first.type)

    def _conditional(self, node: Conditional, expected: StaticType | None) -> Term:
        test = self._present(node.test)
        then, otherwise = self.write(node.then, expected), self.write(node.otherwise, expected)
        type_ = then.type or otherwise.type
        if Scalar.FLOAT in (then.type, otherwise.type):
            type_ = Scalar.FLOAT

        def chosen(ones: Sequence[Test], others: Sequence[Test]) -> tuple[Test, ...]:
            if not ones and not others:
                return ()
            either = code.joined("and", ones, True), code.joined("and", others, True)
            return (code.Choice(test.value, *either),)

        return Term(
            code.Choice(test.value, _as(then, type_), _as(otherwise, type_)),
            type_,
            (*test.valid, *chosen(then.valid, otherwise.valid)),
            chosen(then.present, otherwise.present),
            bits=max(then.bits, otherwise.bits),
        )

    def _function(self, node: FunctionCall) -> Term:
        if node.declaration is not None or node.function not in ("abs", "min", "max", "toFloat"):
            raise NotCompiled(f"the function `{node.function}`", node.span)
        terms = [self._present(argument) for argument in node.arguments]
        types = {term.type for term in terms}
        result: StaticType = (
            Scalar.FLOAT if Scalar.FLOAT in types or node.function == "toFloat" else Scalar.INT
        )
        values = [_as(term, result) for term in terms]
        made = values[0]
        if node.function == "abs":
            made = code.call("abs", made)
        for value in values[1:]:
            made = code.call(node.function, made, value)
        valid = tuple(test for term in terms for test in term.valid)
        return Term(made, result, valid, bits=max(term.bits for term in terms) + 1)


def _as(term: Term, type_: StaticType | None) -> code.Expression:
    """Return the value's code, converted to float if `type_` is float."""
    if type_ is Scalar.FLOAT and term.type is not Scalar.FLOAT:
        return code.call("float", term.value)
    return term.value


def as_float(term: Term) -> code.Expression:
    """Return the code of a number converted to float."""
    return _as(term, Scalar.FLOAT)


def _is_literal(node: Expression) -> bool:
    """Return True for literals and conditionals of literals, because their enum follows only from the expected type."""
    if isinstance(node, Conditional):
        return _is_literal(node.then) and _is_literal(node.otherwise)
    return isinstance(node, EnumLiteral | Constant)


def literal(facts: Facts, value: Value, type_: StaticType) -> Term:
    """Return the term of a literal of a type. Raise `NotCompiled` if it is an int that does not fit into 32 bits."""
    match type_:
        case EnumType():
            return Term(code.Constant(ranks(type_)[str(value)]), type_)
        case Scalar.STRING:
            return Term(facts.string(str(value)), type_)
        case Scalar.FLOAT:
            return Term(code.Constant(float(value)), type_)
        case Scalar.BOOL:
            return Term(code.TRUE if value else code.FALSE, type_)
        case _:
            number = checked(int(value))
            return Term(code.Constant(number), type_, bits=max(number.bit_length(), 1) + 1)


def zero_of(type_: StaticType | None) -> code.Expression:
    """Return the constant that initializes a variable of a type before it is assigned: 0, or 0.0 for floats."""
    return code.Constant(0.0 if type_ is Scalar.FLOAT else 0)
