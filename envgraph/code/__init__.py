"""Generated code: a small tree, one printer to Python text, one place that compiles and runs it; quick data classes.

A producer never writes text. It makes nodes (`envgraph.code._tree`), most easily with a `Block`, which keeps loops and
tests open until what stands inside them has been added::

    block = Block()
    block.loop(Local("v0"), Name("E3"))                       # for v0 in E3:
    block.test(Operation("!=", (Local("v0"), Local("a0"))))   #     if v0 != a0:
    block.add(Do(Call(Name("add"), (Local("v0"),))))          #         add(v0)
    view = Function("view", (Local("a0"),), block.body())
    define((view,), "<generated>", {"E3": .., "add": ..})["view"]

The tree settles everything that decides results and their order, so that other printers can follow: loops, sharing,
what stands inside what. What it refers to from outside is a `Name`, which the namespace given to `define` has; what it
computes itself is a `Local`. A test is an `If` of its own: the printer joins those that stand directly inside each
other, so a pass can put something between two of them. Where parentheses and line breaks are, the printer alone knows.

Every statement can carry an `origin`: the step, the operation, whatever it was made from. Lines inside it have the same
unless they have one of their own, and `origin_of` finds that of the line that has raised an error.
"""

from envgraph.code._block import Block
from envgraph.code._compile import define as define_text
from envgraph.code._counters import with_counters
from envgraph.code._lines import define, origin_of
from envgraph.code._printer import ATOM, Printed, expression_text, printed
from envgraph.code._records import dataclass
from envgraph.code._short import (
    FALSE,
    NONE,
    TRUE,
    call,
    chained,
    equal,
    inverse,
    is_none,
    joined,
    method,
    some,
    tuple_of,
)
from envgraph.code._tree import (
    Assign,
    Body,
    Call,
    Choice,
    Constant,
    Do,
    Each,
    Expression,
    For,
    Function,
    Handler,
    If,
    Index,
    Lambda,
    Leave,
    Let,
    Local,
    Mapping,
    Member,
    Name,
    Operation,
    Raise,
    Return,
    Statement,
    Text,
    Try,
    Tuple,
    While,
    Yield,
)
from envgraph.code._walk import compared_fields, differing_fields, walk

__all__ = [
    "ATOM",
    "FALSE",
    "NONE",
    "TRUE",
    "Assign",
    "Block",
    "Body",
    "Call",
    "Choice",
    "Constant",
    "Do",
    "Each",
    "Expression",
    "For",
    "Function",
    "Handler",
    "If",
    "Index",
    "Lambda",
    "Leave",
    "Let",
    "Local",
    "Mapping",
    "Member",
    "Name",
    "Operation",
    "Printed",
    "Raise",
    "Return",
    "Statement",
    "Text",
    "Try",
    "Tuple",
    "While",
    "Yield",
    "call",
    "chained",
    "compared_fields",
    "dataclass",
    "define",
    "define_text",
    "differing_fields",
    "equal",
    "expression_text",
    "inverse",
    "is_none",
    "joined",
    "method",
    "origin_of",
    "printed",
    "some",
    "tuple_of",
    "walk",
    "with_counters",
]
