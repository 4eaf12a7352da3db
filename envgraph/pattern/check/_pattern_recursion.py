"""Check patterns that call themselves, directly or through other patterns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

from envgraph.code import dataclass
from envgraph.errors import SHOWN, Diagnostic, Severity, Span
from envgraph.metamodel import Feature, shortest_path, strong_components
from envgraph.pattern._analysis import LibraryEntry, calls_of, defined_features
from envgraph.pattern._query_data import Closure, Pattern


@dataclass(frozen=True, slots=True)
class _CallEdge:
    caller: str
    callee: str
    span: Span | None
    word: str

    @property
    def is_monotone(self) -> bool:
        return not self.word


def check_recursion(patterns: Sequence[Pattern], entries: Mapping[str, LibraryEntry]) -> Iterator[Diagnostic]:
    """Report recursive patterns, at most one diagnostic for each group of patterns that call each other.

    A cycle through a negation or an aggregate is an error, because it has no least fixed point. A cycle through a
    closure is an error, because the closure cannot be separated from the pattern that it follows. Other cycles get a
    warning, because VIATRA's default engine computes them wrongly (not with `@SafeRecursion`), or they have no base
    case.
    """
    defined = defined_features(entries)
    edges = [edge for pattern in patterns for edge in _call_edges(pattern, entries, defined)]
    onward: dict[str, list[_CallEdge]] = {}
    for edge in edges:
        onward.setdefault(edge.caller, []).append(edge)
    circles = strong_components(list(onward), lambda name: [edge.callee for edge in onward.get(name, ())])
    component = {name: number for number, (names, _) in enumerate(circles) for name in names}
    endless = _patterns_without_base(patterns, entries, component)
    reported: set[int] = set()
    # Edges with errors come first, so that a cycle with an error is not reported as a warning.
    for edge in sorted(edges, key=lambda edge: (edge.is_monotone, edge.caller not in endless)):
        number = component[edge.caller]
        if number in reported or component.get(edge.callee) != number:
            continue
        cycle = [edge, *_shortest_call_path(edge.callee, edge.caller, onward, component)]
        reported.add(number)
        if edge.is_monotone and edge.caller in endless:
            if None not in entries[edge.caller].types:  # otherwise an error about the type has the same cause
                yield _no_base_warning(edge, cycle)
            continue
        annotations = (each for link in cycle for each in entries[link.caller].pattern.annotations)
        if edge.is_monotone and any(annotation.name == "SafeRecursion" for annotation in annotations):
            continue
        yield replace(_recursion_diagnostic(edge, cycle), subject=tuple(link.caller for link in cycle))


def _call_edges(
    pattern: Pattern, entries: Mapping[str, LibraryEntry], defined: Mapping[Feature, str]
) -> Iterator[_CallEdge]:
    calls = entries[pattern.qualified_name].calls
    for body in pattern.bodies:
        for call, word in calls_of(body):
            if call.pattern in calls:
                span = call.pattern_span or call.span
                yield _CallEdge(pattern.qualified_name, calls[call.pattern], span, word or str(call.closure))
    for read in entries[pattern.qualified_name].reads:
        if read.feature in defined:
            yield _CallEdge(pattern.qualified_name, defined[read.feature], read.span, read.word)


def _patterns_without_base(
    patterns: Sequence[Pattern], entries: Mapping[str, LibraryEntry], component: Mapping[str, int]
) -> set[str]:
    """Return the patterns that can never match, because all their bodies need matches of patterns that never match.

    `component` has for each pattern the number of its cycle; only calls within a cycle count.
    """
    missing: dict[tuple[str, int], int] = {}
    waiting: dict[str, list[tuple[str, int]]] = {}
    for pattern in patterns:
        caller, calls = pattern.qualified_name, entries[pattern.qualified_name].calls
        for number, body in enumerate(pattern.bodies):
            needed = {
                calls[call.pattern]: None
                for call, word in calls_of(body)
                if not word and call.closure is not Closure.STAR and call.pattern in calls
            }
            inside = [one for one in needed if component.get(one, -1) == component.get(caller)]
            missing[caller, number] = len(inside)
            for one in inside:
                waiting.setdefault(one, []).append((caller, number))
    based = dict.fromkeys(caller for (caller, _), count in missing.items() if not count)
    queue = list(based)
    for name in queue:
        for place in waiting.get(name, ()):
            missing[place] -= 1
            if not missing[place] and place[0] not in based:
                based[place[0]] = None
                queue.append(place[0])
    return {caller for caller, _ in missing if caller not in based}


def _shortest_call_path(
    start: str, goal: str, onward: Mapping[str, Sequence[_CallEdge]], component: Mapping[str, int]
) -> list[_CallEdge]:
    """Return the calls of a shortest path from one pattern to another of its component, [] if they are equal."""

    def inside(name: str) -> list[str]:
        return [edge.callee for edge in onward[name] if component.get(edge.callee) == component[start]]

    way = [] if start == goal else shortest_path(start, goal, inside) or []
    steps = pairwise((start, *way))
    return [next(edge for edge in onward[one] if edge.callee == other) for one, other in steps]


def _no_base_warning(edge: _CallEdge, cycle: Sequence[_CallEdge]) -> Diagnostic:
    message = f"recursion without a base case can never match: {_cycle_text(cycle)}"
    hint = f"give `{edge.caller}` a body that does not call it: `or {{ .. }}`"
    return Diagnostic("no-base-case", message, edge.span, hint, Severity.WARNING)


def _cycle_text(cycle: Sequence[_CallEdge]) -> str:
    steps = [f" -> {link.word + ' ' if link.word else ''}{link.callee}" for link in cycle]
    if len(steps) > SHOWN.cycle:
        steps[SHOWN.cycle // 2 : -SHOWN.cycle // 2] = [f" -> ({len(steps) - SHOWN.cycle} more)"]
    return cycle[0].caller + "".join(steps)


def _recursion_diagnostic(edge: _CallEdge, cycle: Sequence[_CallEdge]) -> Diagnostic:
    span, path = edge.span, _cycle_text(cycle)
    if edge.is_monotone:
        hint = "annotate the pattern with `@SafeRecursion` if this is intended"
        return Diagnostic("recursive-pattern", f"recursive pattern: {path}", span, hint, Severity.WARNING)
    if edge.word in ("+", "*"):
        hint = "write the recursion with plain calls, or use the closure of another pattern"
        return Diagnostic("recursion-through-closure", f"recursion through a closure: {path}", span, hint)
    what = "a negation" if edge.word == "neg" else "an aggregate"
    hint = f"call a pattern here that does not depend on `{edge.caller}`"
    return Diagnostic("recursion-through-negation", f"recursion through {what}: {path}", span, hint)
