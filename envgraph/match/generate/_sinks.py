"""What generated code does with each solution."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from envgraph.code import (
    FALSE,
    NONE,
    TRUE,
    Assign,
    Body,
    Call,
    Constant,
    Do,
    Expression,
    If,
    Index,
    Let,
    Local,
    Member,
    Operation,
    Return,
    Statement,
    Text,
    Tuple,
    Yield,
    call,
    dataclass,
    method,
)
from envgraph.match.generate._symbols import ClosureQuestion, Mode

Names = Callable[[int], Expression]
"""The code of a variable."""
NONE_YET: Final = Constant(0)
OUT, ADD, N, FOUND = Local("out"), Local("add"), Local("n"), Local("found")
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
        sieved: whether that is so because they are kept from it.
        size: how many there are so far, where that matters.
    """

    variables: tuple[int, ...]
    head: Body
    each: Callable[[Names], Body]
    tail: Body
    shared: tuple[Local, ...] = ()
    relay: str = ""
    repeatable: bool = False
    sieved: bool = False
    size: Expression = NONE_YET


def row(variables: Sequence[int], names: Names) -> Tuple:
    """The values of some variables as one."""
    return Tuple(tuple([names(variable) for variable in variables]))


def value(variables: Sequence[int], names: Names) -> Expression:
    """A bare value, or a tuple of several."""
    return names(variables[0]) if len(variables) == 1 else row(variables, names)


def length(collection: Expression) -> Call:
    """How many elements there are."""
    return call("len", collection)


def empty(what: str) -> Call:
    """A new `set`, `dict` or `list`."""
    return call(what)


def view_sink(mode: Mode, distinct: bool, variables: tuple[int, ...]) -> Sink:
    """The sink of a view; `distinct` if no solution gives the same values as another."""
    shape = value if mode is Mode.VALUES else row
    match mode:
        case Mode.EXISTS:
            return EXISTENCE
        case Mode.FIRST:
            first = (Return(NONE),)
            return Sink(
                variables,
                (),
                lambda names: (Return(shape(variables, names)),),
                first,
                (),
                "found",
                repeatable=True,
            )
        case Mode.COUNT if distinct:
            return COUNT
        case Mode.EACH:
            return _yielding(variables, distinct)
    if distinct:
        return gathering(variables, lambda names: shape(variables, names), OUT)
    result = length(OUT) if mode is Mode.COUNT else call("list", OUT)
    return keeping(variables, lambda names: shape(variables, names), result)


def keeping(variables: tuple[int, ...], item: Callable[[Names], Expression], result: Expression) -> Sink:
    """Collects an item of each solution in `out`, each once, in the order in which they are found first."""
    return Sink(
        variables,
        (Assign(OUT, Text("{}")),),
        lambda names: (Assign(Index(OUT, item(names)), NONE),),
        (Return(result),),
        (OUT,),
        repeatable=True,
        size=length(OUT),
    )


def _yielding(variables: tuple[int, ...], distinct: bool) -> Sink:
    """The sink of a generator."""
    tail = (Yield(Tuple(()), each=True),)  # what yields nothing is a generator, too
    if distinct:
        return Sink(variables, (), lambda names: (Yield(row(variables, names)),), tail, (), "each")
    new = Local("r")

    def each(names: Names) -> Body:
        passed = Operation("not in", (Let(new, row(variables, names)), OUT))
        return (If(passed, (Do(method(OUT, "add", new)), Yield(new))),)

    return Sink(variables, (Assign(OUT, empty("set")),), each, tail, (OUT,), "each", repeatable=True)


def sieved_sink(mode: Mode, variables: tuple[int, ...]) -> Sink:
    """The sink of a view whose plan tells its values apart at its end."""
    return replace(view_sink(mode, True, variables), variables=variables, repeatable=True, sieved=True)


def gathering(variables: tuple[int, ...], item: Callable[[Names], Expression], result: Expression) -> Sink:
    """Collects an item of each solution in the list `out`."""
    head = (Assign(OUT, Text("[]")), Assign(ADD, Member(OUT, "append")))
    each = lambda names: (Do(call(ADD, item(names))),)  # noqa: E731
    return Sink(variables, head, each, (Return(result),), (OUT, ADD), size=length(OUT))


EXISTENCE = Sink(
    (),
    (),
    lambda names: (Return(TRUE),),
    (Return(FALSE),),
    relay="flag",
    repeatable=True,
)
COUNT = Sink(
    (),
    (Assign(N, Constant(0)),),
    lambda names: (Assign(N, Constant(1), "+="),),
    (Return(N),),
    relay="sum",
    size=N,
)


def visiting(variable: int, question: ClosureQuestion) -> Sink:
    """Adds a reached object to a breadth-first search, which a goal ends."""
    seen, todo, start, goal, push = map(Local, ("seen", "todo", "start", "goal", "push"))
    meets = question is ClosureQuestion.HOLDS

    def each(names: Names) -> Body:
        node = names(variable)
        reached = If(Operation("==", (node, goal)), (Return(TRUE),))
        new = If(Operation("not in", (node, seen)), (Do(call(ADD, node)), Do(call(push, node))))
        return (reached, new) if meets else (new,)

    # The start is not seen: it is reached only if some path leads back to it.
    head: list[Statement] = [Assign(ADD, Member(seen, "add")), Assign(push, Member(todo, "append"))]
    if question is not ClosureQuestion.SPREAD:
        head.insert(0, Assign(seen, empty("set")))
    if not meets:
        head.insert(0, Assign(todo, Text("[start]", reads=(start,))))
    shared = (seen, ADD, push, goal) if meets else (seen, ADD, push)
    tail = (Return(FALSE),) if meets else (Do(Text("del todo[0]", reads=(todo,))), Return(todo))
    return Sink((variable,), tuple(head), each, tail, shared, "flag" if meets else "", repeatable=True)
