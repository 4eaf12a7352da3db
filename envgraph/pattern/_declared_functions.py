"""Functions that users implement in Python for expressions to call: their declarations, and their code in an engine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from math import isfinite
from reprlib import repr as short

from envgraph.code import dataclass
from envgraph.errors import LIMITS, Diagnostic, FunctionError, Note, Span
from envgraph.metamodel import AttributeType, Metamodel, Value, accepts
from envgraph.pattern._expression_data import Expression, FunctionCall
from envgraph.pattern._goals import ObjectType
from envgraph.pattern._occurrences import Data, rewrite_expressions
from envgraph.pattern._query_data import Parameter
from envgraph.pattern._types import coerce, static_type, type_hint, type_text
from envgraph.pattern.expressions._builtin_functions import FUNCTIONS


@dataclass(frozen=True, slots=True)
class FunctionDeclaration:
    """A declaration `function name(x : T, ...) : U;` of a pure function, whose code an engine receives from Python.

    Attributes:
        parameters: the parameters, each with the name of a data type or enum.
        result: the name of a data type or enum.
    """

    name: str
    parameters: tuple[Parameter, ...]
    result: str
    doc: str | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    result_span: Span | None = field(default=None, compare=False, repr=False)

    @property
    def package(self) -> str:
        """Return "", because the name of a function is the same in all packages."""
        return ""

    @property
    def qualified_name(self) -> str:
        """Return the name, because functions belong to no package."""
        return self.name

    @property
    def signature(self) -> str:
        """Return the declaration as text: `distance(x : int, y : int) : float`."""
        parameters = ", ".join(f"{one.name} : {one.type}" for one in self.parameters)
        return f"{self.name}({parameters}) : {self.result}"


class DeclaredFunction:
    """A declared function of an engine. Its code may be set after the declaration.

    Attributes:
        parameters: types of the parameters.
        result: type of the result. None if the declaration has errors, which have been reported.
        code: the Python function that computes it, or None if not set.
    """

    def __init__(
        self,
        declaration: FunctionDeclaration,
        parameters: Sequence[AttributeType],
        result: AttributeType | None,
    ) -> None:
        self.declaration = declaration
        self.parameters = tuple(parameters)
        self.result = result
        self.code: Callable[..., object] | None = None

    @property
    def name(self) -> str:
        """Return the declared name."""
        return self.declaration.name

    @property
    def types(self) -> tuple[AttributeType | None, ...]:
        """Return the types of the parameters and then of the result. Declarations with equal types agree."""
        return (*self.parameters, self.result)

    def bound_to_call(self, span: Span | None) -> Callable[..., Value]:
        """Return a Python function that calls this function. Its errors have `span`, the place of the call."""
        return partial(self._call, span)

    def _call(self, span: Span | None, *arguments: Value) -> Value:
        if self.code is None:
            hint = f'give the engine its code: `engine.function("{self.name}", ..)`'
            raise FunctionError(f"function `{self.name}` is declared, but has no code", self.name, span, hint)
        given = [coerce(value, type_) for value, type_ in zip(arguments, self.parameters, strict=True)]
        try:
            result = self.code(*given)
        except MemoryError:
            raise
        except Exception as error:
            message = f"{self._call_text(given)} raised {type(error).__name__}: {error}"
            raise FunctionError(message, self.name, span, "correct the Python function") from error
        assert self.result is not None, "an expression with an error is not evaluated"
        if isinstance(result, float):  # floats of NumPy have a class of their own
            result = float(result)
        if _is_valid_result(result, self.result):
            return coerce(result, self.result)  # type: ignore[arg-type]
        message = f"{self._call_text(given)} returned {short(result)}, which is not of type `{type_text(self.result)}`"
        raise FunctionError(message, self.name, span, f"it is declared as `{self.declaration.signature}`")

    def _call_text(self, arguments: Sequence[Value]) -> str:
        return f"`{self.name}({', '.join(map(short, arguments))})`"


def _is_valid_result(value: object, type_: AttributeType) -> bool:
    if isinstance(value, float) and not isfinite(value):
        return False
    return accepts(type_, value) and not (isinstance(value, str) and len(value) > LIMITS["characters"])


Functions = Mapping[str, DeclaredFunction]


def declare_functions(
    declarations: Iterable[FunctionDeclaration], known: Functions, metamodel: Metamodel
) -> tuple[Functions, list[Diagnostic]]:
    """Return the known functions and the newly declared ones, by name, and the diagnostics of the new declarations.

    A second declaration with the same types is ignored, because each file may declare the functions that it uses. The
    name of a built-in function, or other types than before, is an error.
    """
    found = dict(known)
    problems: list[Diagnostic] = []
    for one in declarations:
        other = found.get(one.name)
        if one.name in FUNCTIONS:
            message = f"`{one.name}` is a function of the language: `{FUNCTIONS[one.name].signature}`"
            problems.append(Diagnostic("duplicate-definition", message, one.span, "choose another name"))
            continue
        parameters, result = _check_declaration(one, metamodel, problems)
        if other is None:
            found[one.name] = DeclaredFunction(one, parameters, result)
        elif None not in (result, other.result) and other.types != (*parameters, result):
            message = f"function `{one.name}` is declared twice, with different types"
            place = other.declaration.span
            notes = (Note(f"as `{other.declaration.signature}`, here", place),) if place else ()
            hint = "declare the same types in both places, or choose another name"
            problems.append(Diagnostic("duplicate-definition", message, one.span, hint, notes=notes))
    return found, problems


def _check_declaration(
    declaration: FunctionDeclaration, metamodel: Metamodel, problems: list[Diagnostic]
) -> tuple[list[AttributeType], AttributeType | None]:
    """Return the parameter types and the result type. After adding errors to `problems`, return [] and None."""
    before = len(problems)
    names = [one.name for one in declaration.parameters]
    for number, one in enumerate(declaration.parameters):
        if one.name in names[:number]:
            message = f"two parameters are called `{one.name}`"
            problems.append(Diagnostic("duplicate-parameter", message, one.span, "choose another name"))
        if one.type is None:
            message = f"parameter `{one.name}` of a function has no type"
            problems.append(Diagnostic("missing-type", message, one.span, f"write `{one.name} : int`"))
    written = [(one.type, one.type_span or one.span) for one in declaration.parameters if one.type is not None]
    written.append((declaration.result, declaration.result_span or declaration.span))
    found: list[AttributeType] = []
    for name, span in written:
        type_ = static_type(name, metamodel)
        if type_ is None:
            hint = type_hint(name, metamodel)
            problems.append(Diagnostic("unknown-type", f"unknown type `{name}`", span, hint))
        elif isinstance(type_, ObjectType):
            message = f"`{name}` is a class, but a function takes and returns values of data types"
            hint = f"pass attributes of the object: `{declaration.name}(x.feature)`"
            problems.append(Diagnostic("wrong-type", message, span, hint))
        else:
            found.append(type_)
    if len(problems) > before:
        return [], None
    return found[:-1], found[-1]


def resolve_functions(data: Data, functions: Functions) -> Data:
    """Return a definition whose calls of non-built-in functions refer to `functions`. If unchanged, return `data`."""

    def known(expression: Expression) -> Expression:
        if isinstance(expression, FunctionCall) and expression.declared is not functions:
            builtin = expression.function in FUNCTIONS
            return expression if builtin else replace(expression, declared=functions)
        return expression

    return rewrite_expressions(data, known)
