"""Map the Java types, constants and functions of VIATRA queries to those of this package."""

from __future__ import annotations

from collections.abc import Mapping
from math import e, pi
from sys import float_info
from typing import Final

from envgraph.metamodel import Value

_INTS: Final = ("Integer", "Long", "Short", "Byte")
_FLOATS: Final = ("Double", "Float")

JAVA_TYPES: Final[Mapping[str, str]] = {
    **dict.fromkeys((*_INTS, "int", "long", "short", "byte", "BigInteger"), "int"),
    **dict.fromkeys((*_FLOATS, "double", "float", "BigDecimal"), "float"),
    **dict.fromkeys(("boolean", "Boolean"), "bool"),
    **dict.fromkeys(("String", "char", "Character", "CharSequence"), "string"),
}
"""Java's names for the data types, without their packages."""

JAVA_CLASSES: Final = frozenset({*_INTS, *_FLOATS, "Boolean", "Math", "Objects", "String"})
"""Java classes that a file may use without an import."""

JAVA_DOMAINS: Final = frozenset({"com", "edu", "io", "java", "javax", "net", "org"})
"""The first words of full names of Java classes, such as `java.util.List`."""

CAST_FUNCTIONS: Final[Mapping[str, str]] = {"int": "toInt", "float": "toFloat", "string": "toString"}
"""The function for a cast to each data type."""

OPERATOR_METHODS: Final[Mapping[str, str]] = {"equals": "==", "concat": "+"}
"""Java methods that are replaced by operators."""

JAVA_CONSTANTS: Final[Mapping[tuple[str, str], Value]] = {
    ("Integer", "MAX_VALUE"): 2**31 - 1,
    ("Integer", "MIN_VALUE"): -(2**31),
    ("Long", "MAX_VALUE"): 2**63 - 1,
    ("Long", "MIN_VALUE"): -(2**63),
    ("Double", "MAX_VALUE"): float_info.max,
    ("Math", "PI"): pi,
    ("Math", "E"): e,
    ("Boolean", "TRUE"): True,
    ("Boolean", "FALSE"): False,
}

_MATH: Final = ("abs", "ceil", "exp", "floor", "log", "max", "min", "pow", "round", "sqrt")

_FUNCTIONS: Final[Mapping[tuple[str, str], str]] = {
    **{("Math", name): name for name in _MATH},
    ("Math", "floorMod"): "mod",
    **{(cls, name): name for cls in (*_INTS, *_FLOATS) for name in ("max", "min")},
    **{(cls, "valueOf"): "toInt" for cls in _INTS},
    **{(cls, "valueOf"): "toFloat" for cls in _FLOATS},
    **{(cls, "toString"): "toString" for cls in (*_INTS, *_FLOATS, "Boolean")},
    ("String", "valueOf"): "toString",
    ("Objects", "equals"): "equals",
}


def builtin_function_for(cls: str, name: str) -> str | None:
    """Return the built-in function that equals a static Java method, or None; a package before the class is ignored.

    >>> builtin_function_for("Math", "floorMod"), builtin_function_for("Math", "cbrt")
    ('mod', None)
    """
    return _FUNCTIONS.get((cls.rpartition(".")[2], name))
