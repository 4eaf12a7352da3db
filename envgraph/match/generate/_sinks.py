"""What generated code does with each solution."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from envgraph.code import dataclass
from envgraph.match.generate._symbols import Mode, Reach

Names = Callable[[int], str]
"""The source of a variable."""


@dataclass(frozen=True, slots=True)
class Sink:
    """Start, end and innermost lines of a function that collects solutions.

    Attributes:
        variables: the variables that it reads.
        head, tail: first and last lines of the function.
        each: lines for one solution.
        shared: names that a continuation of the function takes over; it has no head or tail of its own then.
        relay: what the caller does with the value of a continuation: "flag" returns True if it is true, "found"
            returns it unless it is None, "sum" adds it up, "each" yields what it yields, "" ignores it.
        repeatable: whether the same values again change nothing.
        sieved: whether that is so because they are kept from it.
        size: source of how many there are so far, where that matters.
    """

    variables: tuple[int, ...]
    head: tuple[str, ...]
    each: Callable[[Names], Sequence[str]]
    tail: tuple[str, ...]
    shared: tuple[str, ...] = ()
    relay: str = ""
    repeatable: bool = False
    sieved: bool = False
    size: str = "0"


def row(variables: Sequence[int], names: Names) -> str:
    """The source of a tuple."""
    return f"({''.join(f'{names(v)}, ' for v in variables)})".replace(
        ", )", ",)" if len(variables) == 1 else ")"
    )


def value(variables: Sequence[int], names: Names) -> str:
    """The source of a bare value, or of a tuple of several."""
    return names(variables[0]) if len(variables) == 1 else row(variables, names)


def view_sink(mode: Mode, distinct: bool, variables: tuple[int, ...]) -> Sink:
    """The sink of a view; `distinct` if no solution gives the same values as another."""
    shape = value if mode is Mode.VALUES else row
    match mode:
        case Mode.EXISTS:
            return EXISTENCE
        case Mode.FIRST:
            first = ("return None",)
            return Sink(
                variables,
                (),
                lambda n: [f"return {shape(variables, n)}"],
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
        return gathering(variables, lambda n: shape(variables, n), "return out")
    tail = "return len(out)" if mode is Mode.COUNT else "return list(out)"
    each = lambda n: [f"out[{shape(variables, n)}] = None"]  # noqa: E731
    return Sink(variables, ("out = {}",), each, (tail,), ("out",), repeatable=True, size="len(out)")


def _yielding(variables: tuple[int, ...], distinct: bool) -> Sink:
    """The sink of a generator."""
    tail = ("yield from ()",)  # what yields nothing is a generator, too
    if distinct:
        return Sink(variables, (), lambda names: [f"yield {row(variables, names)}"], tail, (), "each")

    def each(names: Names) -> list[str]:
        return [f"if (r := {row(variables, names)}) not in out:", "    out.add(r)", "    yield r"]

    return Sink(variables, ("out = set()",), each, tail, ("out",), "each", repeatable=True)


def sieved_sink(mode: Mode, variables: tuple[int, ...]) -> Sink:
    """The sink of a view whose plan has a sieve at its end."""
    return replace(view_sink(mode, True, variables), variables=variables, repeatable=True, sieved=True)


def gathering(variables: tuple[int, ...], item: Callable[[Names], str], tail: str) -> Sink:
    """Collects an item of each solution in the list `out`."""
    head = ("out = []", "add = out.append")
    each = lambda names: [f"add({item(names)})"]  # noqa: E731
    return Sink(variables, head, each, (tail,), ("out", "add"), size="len(out)")


EXISTENCE = Sink((), (), lambda names: ["return True"], ("return False",), relay="flag", repeatable=True)
COUNT = Sink((), ("n = 0",), lambda names: ["n += 1"], ("return n",), relay="sum", size="n")


def visiting(variable: int, question: Reach) -> Sink:
    """Adds a reached object to a breadth-first search, which a goal ends."""
    goal = question is Reach.HOLDS

    def each(names: Names) -> list[str]:
        node = names(variable)
        stop = [f"if {node} == goal:", "    return True"] if goal else []
        return [*stop, f"if {node} not in seen:", f"    add({node})", f"    push({node})"]

    # The start is not seen: it is reached only if some path leads back to it.
    head = ["add = seen.add", "push = todo.append"]
    if question is not Reach.SPREAD:
        head.insert(0, "seen = set()")
    if not goal:
        head.insert(0, "todo = [start]")
    shared = ("seen", "add", "push", "goal") if goal else ("seen", "add", "push")
    tail = ("return False",) if goal else ("del todo[0]", "return todo")
    return Sink((variable,), tuple(head), each, tail, shared, "flag" if goal else "", repeatable=True)
