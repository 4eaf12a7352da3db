"""Generate Python functions: a syntax tree, its printer, and the compiler; also fast data classes and lazy imports.

Code that generates functions builds syntax tree nodes (`envgraph.code._tree`) and never source text. The easiest way
is a `Block`, which keeps loops and tests open until their contents have been added::

    block = Block()
    block.loop(Local("v0"), Name("E3"))                       # for v0 in E3:
    block.test(Operation("!=", (Local("v0"), Local("a0"))))   #     if v0 != a0:
    block.add(Do(Call(Name("add"), (Local("v0"),))))          #         add(v0)
    view = Function("view", (Local("a0"),), block.body())
    define((view,), "<generated>", {"E3": .., "add": ..})["view"]

The tree fixes loops, sharing of values and nesting, and so all results and their order. A printer for another language
could use the same tree. A `Name` refers to a value in the namespace given to `define`. A `Local` is a variable of the
function. Each test is its own `If` node, so that a pass can insert a statement between two tests. The printer joins
directly nested tests with `and`, and decides on parentheses and line breaks.

Each statement can carry an `origin`, any object that it was generated from, such as a step of a plan. Nested statements
without an origin inherit it. `origin_of` returns the origin of the generated line that raised an error.
"""

from typing import TYPE_CHECKING

from envgraph.code._later import later as later

if TYPE_CHECKING:
    from envgraph.code._block import Block as Block
    from envgraph.code._compile import define_text as define_text
    from envgraph.code._counters import with_counters as with_counters
    from envgraph.code._lines import define as define, origin_of as origin_of
    from envgraph.code._printer import (
        ATOM as ATOM,
        Printed as Printed,
        expression_text as expression_text,
        printed as printed,
    )
    from envgraph.code._records import dataclass as dataclass
    from envgraph.code._reprs import short_repr as short_repr, visible as visible
    from envgraph.code._short import (
        FALSE as FALSE,
        NONE as NONE,
        TRUE as TRUE,
        call as call,
        chained as chained,
        equal as equal,
        inverse as inverse,
        is_none as is_none,
        joined as joined,
        method as method,
        some as some,
        tuple_of as tuple_of,
    )
    from envgraph.code._tree import (
        Assign as Assign,
        Body as Body,
        Call as Call,
        Choice as Choice,
        Constant as Constant,
        Do as Do,
        Each as Each,
        Expression as Expression,
        For as For,
        Function as Function,
        Handler as Handler,
        If as If,
        Index as Index,
        Lambda as Lambda,
        Leave as Leave,
        Let as Let,
        Local as Local,
        Mapping as Mapping,
        Member as Member,
        Name as Name,
        Operation as Operation,
        Raise as Raise,
        Return as Return,
        Statement as Statement,
        Text as Text,
        Try as Try,
        Tuple as Tuple,
        While as While,
        Yield as Yield,
    )
    from envgraph.code._walk import (
        compared_fields as compared_fields,
        differing_fields as differing_fields,
        walk as walk,
    )

later(globals())
