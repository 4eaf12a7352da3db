"""Build generated source: give names to its symbols, and collect its inner functions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from envgraph import code
from envgraph.match.generate._symbols import (
    Builtin,
    ClassTable,
    ClosureFunction,
    ConstantSymbol,
    GeneratedSource,
    MatchLimitCheck,
    OperatorSymbol,
    PatternFunction,
    ReachAggregateSymbol,
    RecursiveFunction,
    StoreColumn,
    Symbol,
    Valued,
)
from envgraph.metamodel import EnumType, Value
from envgraph.pattern import Expression as Term, ObjectType, StaticType, compile_expression

_COLUMNS: Final = {"extents": "E", "values": "A", "forward": "F", "backward": "B"}
_PREFIXES: Final[Mapping[type, str]] = {
    **{
        MatchLimitCheck: "m",
        ClassTable: "T",
        ClosureFunction: "r",
        ConstantSymbol: "k",
        ReachAggregateSymbol: "n",
        Valued: "i",
    },
    **{RecursiveFunction: "f", PatternFunction: "f"},
}


class SourceBuilder:
    """A generated source under construction: the names of its symbols, and its inner functions."""

    def __init__(self) -> None:
        self._names: dict[Symbol, code.Name] = {}
        self._symbols: list[tuple[str, Symbol]] = []
        self._counts: dict[str, int] = {}
        self._functions: list[code.Function] = []

    def name_of(self, symbol: Symbol) -> code.Name:
        """Return the name of a symbol; a new symbol becomes a parameter of `build`."""
        if symbol not in self._names:
            self._names[symbol] = name = code.Name(self._invent(symbol))
            self._symbols.append((name.name, symbol))
        return self._names[symbol]

    def __contains__(self, symbol: Symbol) -> bool:
        return symbol in self._names

    def _invent(self, symbol: Symbol) -> str:
        """Return a name for a symbol: a fixed one for a column of the store or a builtin, else a new one."""
        match symbol:
            case StoreColumn("classes"):
                return "C"
            case StoreColumn(kind, index):
                return f"{_COLUMNS[kind]}{index}"
            case Builtin(name):
                return name
            case OperatorSymbol(what):
                return self.fresh_name(f"{what}_")
            case _:
                return self.fresh_name(_PREFIXES[type(symbol)])

    def fresh_name(self, prefix: str) -> str:
        """Return a name that is not in use yet: the prefix with a number."""
        number = self._counts.get(prefix, 0)
        self._counts[prefix] = number + 1
        return f"{prefix}{number}"

    def literal(self, value: Value) -> code.Name:
        """Add a constant as a new parameter of `build`, and return the parameter's name."""
        return self.name_of(ConstantSymbol(value))

    def emit_expression(
        self,
        expression: Term,
        names: Mapping[str, code.Expression],
        types: Mapping[str, StaticType],
        part: bool = False,
    ) -> code.Expression:
        """Return the code of an expression, or of one side of a comparison (`part`).

        If the expression may have no value, emit a function that then returns None, and return a call of the function.
        `names` and `types` map the names in the expression to code and types.
        """
        first = self._counts.get("k", 0)
        compiled = compile_expression(
            expression, names, types, is_comparison_side=part, constant=lambda i: code.Name(f"k{first + i}")
        )
        for value in compiled.constants:
            self.name_of(ConstantSymbol(value))
        if not compiled.can_fail:
            return compiled.tree
        inputs = tuple(
            sorted({each for each in names.values() if isinstance(each, code.Local)}, key=lambda each: each.name)
        )
        failed = code.ExceptClause(code.Name("EvaluationError"), None, (code.Return(code.NONE),))
        body = (code.Try((code.Return(compiled.tree),), (failed,)),)
        return code.Call(self.add_function(self.fresh_name("x"), inputs, body), inputs)

    def add_function(self, name: str, parameters: Sequence[code.Local], body: code.Body) -> code.Name:
        """Add an inner function to the source, and return the function's name."""
        self._functions.append(code.Function(name, tuple(parameters), body))
        return code.Name(name)

    def finish(self, function: code.Name) -> GeneratedSource:
        """Return the finished source, whose `build` returns the given inner function."""
        parameters = tuple(code.Name(name) for name, _ in self._symbols)
        build = code.Function("build", parameters, (*self._functions, code.Return(function)))
        return GeneratedSource(build, tuple(self._symbols))


def local_variable(prefix: str, variable: int, type_: StaticType | None = None) -> code.Local:
    """Return the local variable of generated code that holds the value of a pattern variable."""
    match type_:
        case None:
            return code.Local(f"{prefix}{variable}")
        case ObjectType():
            return code.Local(f"{prefix}{variable}", "object")
        case EnumType():
            return code.Local(f"{prefix}{variable}", "string")
        case _:
            return code.Local(f"{prefix}{variable}", type_.value)
