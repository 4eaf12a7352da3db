"""Sinks: what generated code does with each solution."""

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
"""The code of a variable."""
NONE_YET: Final = code.Constant(0)
OUT, ADD, N, FOUND = code.Local("out"), code.Local("add"), code.Local("n"), code.Local("found")
"""Variables of functions with sinks."""


@dataclass(frozen=True, slots=True)
class Sink:
    """Start, end and innermost statements of a function that collects solutions.

    Attributes:
        variables: the variables that it reads.
        head, tail: first and last statements of the function.
        each: statements for one solution.
        shared: variables that a continuation of the function takes over; it has no head or tail of its own then.
        relay: what the caller does with the value of a continuation: "flag" returns True if it is true, "found"
            returns it unless it is None, "sum" adds it up, "each" yields what it yields, "" ignores it.
        repeatable: whether the same values again change nothing.
        unique: whether that is so because they are kept from it.
        size: how many there are so far, where that matters.
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
    """The values of some variables as one."""
    return code.Tuple(tuple([names(variable) for variable in variables]))


def value(variables: Sequence[int], names: Names) -> code.Expression:
    """A bare value, or a tuple of several."""
    return names(variables[0]) if len(variables) == 1 else row(variables, names)


def length(collection: code.Expression) -> code.Call:
    """Return how many elements there are."""
    return code.call("len", collection)


def empty(what: str) -> code.Call:
    """A new `set`, `dict` or `list`."""
    return code.call(what)


def view_sink(mode: Mode, distinct: bool, variables: tuple[int, ...]) -> Sink:
    """The sink of a view; `distinct` if no solution gives the same values as another."""
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
    """Collects the last value of each solution."""
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
    """Collects an item of each solution in `out`, each once, in the order in which they are found first.

    What is kept with an item follows from it.
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
    """The sink of a generator."""
    tail = (code.Yield(code.Tuple(()), each=True),)  # what yields nothing is a generator, too
    if distinct:
        return Sink(variables, (), lambda names: (code.Yield(row(variables, names)),), tail, (), "each")
    new = code.Local("r")

    def each(names: Names) -> code.Body:
        passed = code.Operation("not in", (code.Let(new, row(variables, names)), OUT))
        return (code.If(passed, (code.Do(code.method(OUT, "add", new)), code.Yield(new))),)

    return Sink(variables, (code.Assign(OUT, empty("set")),), each, tail, (OUT,), "each", repeatable=True)


def distinct_sink(mode: Mode, variables: tuple[int, ...]) -> Sink:
    """The sink of a view whose plan tells its values apart at its end."""
    return replace(view_sink(mode, True, variables), variables=variables, repeatable=True, unique=True)


def gathering(
    variables: tuple[int, ...], item: Callable[[Names], code.Expression], result: code.Expression
) -> Sink:
    """Collects an item of each solution in the list `out`."""
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
    """Adds a reached object to a breadth-first search, which a goal ends."""
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

    # The start is not seen: it is reached only if some path leads back to it.
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
    """Return what makes the value of an aggregate of its rows."""
    if goal.function == "count":
        return COUNT
    assert goal.column is not None
    column = goal.column
    return gathering((column,), lambda names: names(column), code.call(fold(module, goal), OUT))


def fold(module: Module, goal: AggregateAtom) -> code.Name:
    """Return what makes the value of an aggregate of the values of its column."""
    return module.name(Builtin(_FOLDS[goal.function]))


_FOLDS = {"sum": "total", "avg": "mean", "min": "least", "max": "most"}
