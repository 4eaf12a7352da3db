"""Generate Python functions: a syntax tree, its printer, and the compiler; also fast data classes and lazy imports.

Code that generates functions builds syntax tree nodes (`envgraph.code._syntax_tree`) and never source text. The easiest
way is a `BodyBuilder`, which keeps loops and tests open until their contents have been added::

    block = Block()
    block.loop(Local("v0"), Name("E3"))                       # for v0 in E3:
    block.test(Operation("!=", (Local("v0"), Local("a0"))))   #     if v0 != a0:
    block.add(Do(Call(Name("add"), (Local("v0"),))))          #         add(v0)
    view = Function("view", (Local("a0"),), block.body())
    define((view,), "<generated>", {"E3": .., "add": ..})["view"]

The tree fixes loops, sharing of values and nesting, and so all results and their order. A printer for another language
could use the same tree. A `Name` refers to a value in the namespace given to `define_functions`. A `Local` is a
variable of the function. Each test is its own `If` node, so that a pass can insert a statement between two tests. The
printer joins directly nested tests with `and`, and decides on parentheses and line breaks.

Each statement can carry an `origin`, any object that it was generated from, such as a step of a plan. Nested statements
without an origin inherit it. `origin_of` returns the origin of the generated line that raised an error.
"""

from typing import TYPE_CHECKING

from envgraph.code._lazy_exports import export_lazily as export_lazily

if TYPE_CHECKING:
    from envgraph.code._body_builder import BodyBuilder as BodyBuilder
    from envgraph.code._call_counters import with_counters as with_counters
    from envgraph.code._compile_text import execute_text as execute_text
    from envgraph.code._data_classes import dataclass as dataclass
    from envgraph.code._data_walk import (
        compared_fields as compared_fields,
        differing_fields as differing_fields,
        walk_parts as walk_parts,
    )
    from envgraph.code._line_origins import define_functions as define_functions, origin_of as origin_of
    from envgraph.code._node_shorthands import (
        FALSE as FALSE,
        NONE as NONE,
        TRUE as TRUE,
        emit_call as emit_call,
        emit_call_statement as emit_call_statement,
        emit_equal as emit_equal,
        emit_is_none as emit_is_none,
        emit_is_not_none as emit_is_not_none,
        emit_joined as emit_joined,
        emit_method_call as emit_method_call,
        emit_not as emit_not,
        emit_tuple as emit_tuple,
    )
    from envgraph.code._printer import (
        ATOM as ATOM,
        expression_text as expression_text,
        print_source as print_source,
    )
    from envgraph.code._reprs import escape_unprintable as escape_unprintable, shorten_repr as shorten_repr
    from envgraph.code._syntax_tree import (
        Assign as Assign,
        AssignmentExpression as AssignmentExpression,
        AttributeAccess as AttributeAccess,
        Body as Body,
        BreakOrContinue as BreakOrContinue,
        Call as Call,
        Comprehension as Comprehension,
        ConditionalExpression as ConditionalExpression,
        Constant as Constant,
        DictExpression as DictExpression,
        ExceptClause as ExceptClause,
        Expression as Expression,
        ExpressionStatement as ExpressionStatement,
        For as For,
        Function as Function,
        If as If,
        Lambda as Lambda,
        Local as Local,
        Name as Name,
        Operation as Operation,
        PythonText as PythonText,
        Raise as Raise,
        Return as Return,
        Statement as Statement,
        Subscript as Subscript,
        Try as Try,
        Tuple as Tuple,
        While as While,
        Yield as Yield,
    )

export_lazily(globals())
