"""Sinks: the code that a generated function executes for each solution."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from envgraph import code
from envgraph.code import dataclass
from envgraph.match.generate._source_builder import SourceBuilder
from envgraph.match.generate._symbols import Builtin, ClosureQuestion, ResultMode
from envgraph.pattern import AggregateAtom

VariableCode = Callable[[int], code.Expression]
"""Returns the code for the value of a variable."""
NONE_YET: Final = code.Constant(0)
OUT, ADD, N, FOUND = code.Local("out"), code.Local("add"), code.Local("n"), code.Local("found")
"""Local variables of functions with sinks."""


@dataclass(frozen=True, slots=True)
class SolutionSink:
    """A sink: the first, last and innermost statements of a generated function that collects solutions.

    Attributes:
        variables: the variables that the innermost statements read.
        head, tail: the first and last statements of the function.
        emit_each: returns the statements for one solution.
        shared: local variables passed to a continuation, which then has no head or tail of its own.
        relay: the treatment of a continuation's result. "flag": return True if it is true; "found": return it unless it
            is None; "sum": add it; "each": yield its items; "": ignore it.
        repeatable: True if repeated solutions change nothing.
        unique: True if the plan ends with a duplicate filter for this sink.
        size: code for the number of solutions so far, where it is needed.
    """

    variables: tuple[int, ...]
    head: code.Body
    emit_each: Callable[[VariableCode], code.Body]
    tail: code.Body
    shared: tuple[code.Local, ...] = ()
    relay: str = ""
    repeatable: bool = False
    unique: bool = False
    size: code.Expression = NONE_YET


def row(variables: Sequence[int], names: VariableCode) -> code.Tuple:
    """Return code for a tuple of the values of some variables."""
    return code.Tuple(tuple([names(variable) for variable in variables]))


def value(variables: Sequence[int], names: VariableCode) -> code.Expression:
    """Return code for the bare value of one variable, or for a tuple of several."""
    return names(variables[0]) if len(variables) == 1 else row(variables, names)


def length(collection: code.Expression) -> code.Call:
    """Return code for the number of elements of a collection."""
    return code.emit_call("len", collection)


def view_sink(mode: ResultMode, is_distinct: bool, variables: tuple[int, ...]) -> SolutionSink:
    """Return the sink that collects the results of a mode. If `is_distinct`, no two solutions give the same values."""
    shape = value if mode is ResultMode.VALUES else row
    match mode:
        case ResultMode.EXISTS:
            return EXISTENCE
        case ResultMode.FIRST:
            first = (code.Return(code.NONE),)
            return SolutionSink(
                variables,
                (),
                lambda names: (code.Return(shape(variables, names)),),
                first,
                (),
                "found",
                repeatable=True,
            )
        case ResultMode.COUNT if is_distinct:
            return COUNT
        case ResultMode.EACH:
            return _generator_sink(variables, is_distinct)
    if mode is ResultMode.BAG:
        return _bag_sink(variables, is_distinct)
    if is_distinct:
        return list_sink(variables, lambda names: shape(variables, names), OUT)
    result = length(OUT) if mode is ResultMode.COUNT else code.emit_call("list", OUT)
    return distinct_items_sink(variables, lambda names: shape(variables, names), result)


def _bag_sink(variables: tuple[int, ...], is_distinct: bool) -> SolutionSink:
    """Return a sink that collects the last variable's value of each distinct solution."""
    last = lambda names: names(variables[-1])  # noqa: E731
    if is_distinct:
        return list_sink(variables, last, OUT)
    result = code.emit_call("list", code.emit_method_call(OUT, "values"))
    return distinct_items_sink(variables, lambda names: row(variables, names), result, last)


def distinct_items_sink(
    variables: tuple[int, ...],
    item: Callable[[VariableCode], code.Expression],
    result: code.Expression,
    kept: Callable[[VariableCode], code.Expression] = lambda _: code.NONE,
) -> SolutionSink:
    """Return a sink that collects the distinct items of the solutions as keys of the dict `out`, in order of discovery.

    Args:
        variables: the variables that are read.
        item: returns code for the item of a solution.
        result: code for the result of the function.
        kept: returns code for the dict value of an item, which must be determined by the item.
    """
    return SolutionSink(
        variables,
        (code.Assign(OUT, code.PythonText("{}")),),
        lambda names: (code.Assign(code.Subscript(OUT, item(names)), kept(names)),),
        (code.Return(result),),
        (OUT,),
        repeatable=True,
        size=length(OUT),
    )


def _generator_sink(variables: tuple[int, ...], is_distinct: bool) -> SolutionSink:
    """Return a sink that yields each solution once, as a tuple. If `is_distinct`, no two solutions are the same."""
    tail = (code.Yield(code.Tuple(()), is_from=True),)  # makes the function a generator in any case
    if is_distinct:
        return SolutionSink(variables, (), lambda names: (code.Yield(row(variables, names)),), tail, (), "each")
    new = code.Local("r")

    def each(names: VariableCode) -> code.Body:
        passed = code.Operation("not in", (code.AssignmentExpression(new, row(variables, names)), OUT))
        return (code.If(passed, (code.ExpressionStatement(code.emit_method_call(OUT, "add", new)), code.Yield(new))),)

    return SolutionSink(
        variables,
        (code.Assign(OUT, code.emit_call("set")),),
        each,
        tail,
        (OUT,),
        "each",
        repeatable=True,
    )


def list_sink(
    variables: tuple[int, ...], item: Callable[[VariableCode], code.Expression], result: code.Expression
) -> SolutionSink:
    """Return a sink that appends an item of each solution to the list `out`."""
    head = (code.Assign(OUT, code.PythonText("[]")), code.Assign(ADD, code.AttributeAccess(OUT, "append")))
    each = lambda names: (code.emit_call_statement(ADD, item(names)),)  # noqa: E731
    return SolutionSink(variables, head, each, (code.Return(result),), (OUT, ADD), size=length(OUT))


EXISTENCE = SolutionSink(
    (),
    (),
    lambda names: (code.Return(code.TRUE),),
    (code.Return(code.FALSE),),
    relay="flag",
    repeatable=True,
)
COUNT = SolutionSink(
    (),
    (code.Assign(N, code.Constant(0)),),
    lambda names: (code.Assign(N, code.Constant(1), "+="),),
    (code.Return(N),),
    relay="sum",
    size=N,
)


def search_sink(variable: int, question: ClosureQuestion) -> SolutionSink:
    """Return the sink of a breadth-first search: it queues each new node, and for `REACHES` ends at the goal."""
    seen, todo, start, goal, push = map(code.Local, ("seen", "todo", "start", "goal", "push"))
    meets = question is ClosureQuestion.REACHES

    def each(names: VariableCode) -> code.Body:
        node = names(variable)
        reached = code.If(code.Operation("==", (node, goal)), (code.Return(code.TRUE),))
        new = code.If(
            code.Operation("not in", (node, seen)),
            (
                code.emit_call_statement(ADD, node),
                code.emit_call_statement(push, node),
            ),
        )
        return (reached, new) if meets else (new,)

    # The start is not in `seen`: it is reached only if a path leads back to it.
    head: list[code.Statement] = [
        code.Assign(ADD, code.AttributeAccess(seen, "add")),
        code.Assign(push, code.AttributeAccess(todo, "append")),
    ]
    if question is not ClosureQuestion.NEW_NODES:
        head.insert(0, code.Assign(seen, code.emit_call("set")))
    if not meets:
        head.insert(0, code.Assign(todo, code.PythonText("[start]", reads=(start,))))
    shared = (seen, ADD, push, goal) if meets else (seen, ADD, push)
    tail = (
        (code.Return(code.FALSE),)
        if meets
        else (code.ExpressionStatement(code.PythonText("del todo[0]", reads=(todo,))), code.Return(todo))
    )
    return SolutionSink((variable,), tuple(head), each, tail, shared, "flag" if meets else "", repeatable=True)


def aggregate_sink(module: SourceBuilder, goal: AggregateAtom) -> SolutionSink:
    """Return the sink that computes an aggregate of the solutions."""
    if goal.function == "count":
        return COUNT
    assert goal.column is not None
    column = goal.column
    return list_sink((column,), lambda names: names(column), code.emit_call(aggregate_function_name(module, goal), OUT))


def aggregate_function_name(module: SourceBuilder, goal: AggregateAtom) -> code.Name:
    """Return the name of the function that computes an aggregate from the values of its column."""
    return module.name_of(Builtin(_FOLDS[goal.function]))


_FOLDS = {"sum": "total", "avg": "mean", "min": "least", "max": "most"}
