"""Sinks: the code that a generated function executes for each solution."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from envgraph import code
from envgraph.code import dataclass
from envgraph.match.generate._symbols import Builtin, ClosureQuestion, Mode
from envgraph.match.generate._write import Module
from envgraph.pattern import AggregateAtom

Names = Callable[[int], code.Expression]
"""Returns the code for the value of a variable."""
NONE_YET: Final = code.Constant(0)
OUT, ADD, N, FOUND = code.Local("out"), code.Local("add"), code.Local("n"), code.Local("found")
"""Local variables of functions with sinks."""


@dataclass(frozen=True, slots=True)
class Sink:
    """A sink: the first, last and innermost statements of a generated function that collects solutions.

    Attributes:
        variables: the variables that the innermost statements read.
        head, tail: the first and last statements of the function.
        each: returns the statements for one solution.
        shared: local variables passed to a continuation, which then has no head or tail of its own.
        relay: the treatment of a continuation's result. "flag": return True if it is true; "found": return it unless it
            is None; "sum": add it; "each": yield its items; "": ignore it.
        repeatable: True if repeated solutions change nothing.
        unique: True if the plan ends with a duplicate filter for this sink.
        size: code for the number of solutions so far, where it is needed.
    """

    variables: tuple[int, ...]
    head: code.Body
    each: Callable[[Names], code.Body]
    tail: code.Body
    shared: tuple[code.Local, ...] = ()
    relay: str = ""
    repeatable: bool = False
    unique: bool = False
    size: code.Expression = NONE_YET


def row(variables: Sequence[int], names: Names) -> code.Tuple:
    """Return code for a tuple of the values of some variables."""
    return code.Tuple(tuple([names(variable) for variable in variables]))


def value(variables: Sequence[int], names: Names) -> code.Expression:
    """Return code for the bare value of one variable, or for a tuple of several."""
    return names(variables[0]) if len(variables) == 1 else row(variables, names)


def length(collection: code.Expression) -> code.Call:
    """Return code for the number of elements of a collection."""
    return code.call("len", collection)


def empty(what: str) -> code.Call:
    """Return code for a new empty `set`, `dict` or `list`."""
    return code.call(what)


def view_sink(mode: Mode, distinct: bool, variables: tuple[int, ...]) -> Sink:
    """Return the sink that collects the results of a mode. If `distinct`, no two solutions give the same values."""
    shape = value if mode is Mode.VALUES else row
    match mode:
        case Mode.EXISTS:
            return EXISTENCE
        case Mode.FIRST:
            first = (code.Return(code.NONE),)
            return Sink(
                variables,
                (),
                lambda names: (code.Return(shape(variables, names)),),
                first,
                (),
                "found",
                repeatable=True,
            )
        case Mode.COUNT if distinct:
            return COUNT
        case Mode.EACH:
            return _yielding(variables, distinct)
    if mode is Mode.BAG:
        return _bag(variables, distinct)
    if distinct:
        return gathering(variables, lambda names: shape(variables, names), OUT)
    result = length(OUT) if mode is Mode.COUNT else code.call("list", OUT)
    return keeping(variables, lambda names: shape(variables, names), result)


def _bag(variables: tuple[int, ...], distinct: bool) -> Sink:
    """Return a sink that collects the last variable's value of each distinct solution."""
    last = lambda names: names(variables[-1])  # noqa: E731
    if distinct:
        return gathering(variables, last, OUT)
    result = code.call("list", code.method(OUT, "values"))
    return keeping(variables, lambda names: row(variables, names), result, last)


def keeping(
    variables: tuple[int, ...],
    item: Callable[[Names], code.Expression],
    result: code.Expression,
    kept: Callable[[Names], code.Expression] = lambda _: code.NONE,
) -> Sink:
    """Return a sink that collects the distinct items of the solutions as keys of the dict `out`, in order of discovery.

    Args:
        variables: the variables that are read.
        item: returns code for the item of a solution.
        result: code for the result of the function.
        kept: returns code for the dict value of an item, which must be determined by the item.
    """
    return Sink(
        variables,
        (code.Assign(OUT, code.Text("{}")),),
        lambda names: (code.Assign(code.Index(OUT, item(names)), kept(names)),),
        (code.Return(result),),
        (OUT,),
        repeatable=True,
        size=length(OUT),
    )


def _yielding(variables: tuple[int, ...], distinct: bool) -> Sink:
    """Return a sink that yields each solution once, as a tuple. If `distinct`, no two solutions are the same."""
    tail = (code.Yield(code.Tuple(()), each=True),)  # makes the function a generator in any case
    if distinct:
        return Sink(variables, (), lambda names: (code.Yield(row(variables, names)),), tail, (), "each")
    new = code.Local("r")

    def each(names: Names) -> code.Body:
        passed = code.Operation("not in", (code.Let(new, row(variables, names)), OUT))
        return (code.If(passed, (code.Do(code.method(OUT, "add", new)), code.Yield(new))),)

    return Sink(variables, (code.Assign(OUT, empty("set")),), each, tail, (OUT,), "each", repeatable=True)


def distinct_sink(mode: Mode, variables: tuple[int, ...]) -> Sink:
    """Return the sink for a result mode and a plan that ends with a duplicate filter, so no solution repeats."""
    return replace(view_sink(mode, True, variables), variables=variables, repeatable=True, unique=True)


def gathering(
    variables: tuple[int, ...], item: Callable[[Names], code.Expression], result: code.Expression
) -> Sink:
    """Return a sink that appends an item of each solution to the list `out`."""
    head = (code.Assign(OUT, code.Text("[]")), code.Assign(ADD, code.Member(OUT, "append")))
    each = lambda names: (code.Do(code.call(ADD, item(names))),)  # noqa: E731
    return Sink(variables, head, each, (code.Return(result),), (OUT, ADD), size=length(OUT))


EXISTENCE = Sink(
    (),
    (),
    lambda names: (code.Return(code.TRUE),),
    (code.Return(code.FALSE),),
    relay="flag",
    repeatable=True,
)
COUNT = Sink(
    (),
    (code.Assign(N, code.Constant(0)),),
    lambda names: (code.Assign(N, code.Constant(1), "+="),),
    (code.Return(N),),
    relay="sum",
    size=N,
)


def visiting(variable: int, question: ClosureQuestion) -> Sink:
    """Return the sink of a breadth-first search: it queues each new node, and for `HOLDS` ends at the goal."""
    seen, todo, start, goal, push = map(code.Local, ("seen", "todo", "start", "goal", "push"))
    meets = question is ClosureQuestion.HOLDS

    def each(names: Names) -> code.Body:
        node = names(variable)
        reached = code.If(code.Operation("==", (node, goal)), (code.Return(code.TRUE),))
        new = code.If(
            code.Operation("not in", (node, seen)),
            (code.Do(code.call(ADD, node)), code.Do(code.call(push, node))),
        )
        return (reached, new) if meets else (new,)

    # The start is not in `seen`: it is reached only if a path leads back to it.
    head: list[code.Statement] = [
        code.Assign(ADD, code.Member(seen, "add")),
        code.Assign(push, code.Member(todo, "append")),
    ]
    if question is not ClosureQuestion.SPREAD:
        head.insert(0, code.Assign(seen, empty("set")))
    if not meets:
        head.insert(0, code.Assign(todo, code.Text("[start]", reads=(start,))))
    shared = (seen, ADD, push, goal) if meets else (seen, ADD, push)
    tail = (
        (code.Return(code.FALSE),)
        if meets
        else (code.Do(code.Text("del todo[0]", reads=(todo,))), code.Return(todo))
    )
    return Sink((variable,), tuple(head), each, tail, shared, "flag" if meets else "", repeatable=True)


def folding(module: Module, goal: AggregateAtom) -> Sink:
    """Return the sink that computes an aggregate of the solutions."""
    if goal.function == "count":
        return COUNT
    assert goal.column is not None
    column = goal.column
    return gathering((column,), lambda names: names(column), code.call(fold(module, goal), OUT))


def fold(module: Module, goal: AggregateAtom) -> code.Name:
    """Return the name of the function that computes an aggregate from the values of its column."""
    return module.name(Builtin(_FOLDS[goal.function]))


_FOLDS = {"sum": "total", "avg": "mean", "min": "least", "max": "most"}
