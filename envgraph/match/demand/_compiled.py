"""The compiled matcher: compiles a Python function for each kind of query of a pattern."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from envgraph.graph import Model
from envgraph.match._matcher import FREE, Matcher, Row, check_arguments, check_bound
from envgraph.match.demand._order import order_of
from envgraph.match.demand._program import Function, Program
from envgraph.match.explain._explain import explain_view
from envgraph.match.explain._trace import Trace, trace
from envgraph.match.explain._why import Reasons, WhyNot
from envgraph.match.generate._sources import view_source
from envgraph.match.generate._symbols import (
    Held,
    Mode,
    Source,
)
from envgraph.match.passes._calls import CallGraph, check_nesting
from envgraph.match.plan._estimate import Sizes
from envgraph.match.plan._live import LiveSizes
from envgraph.match.plan._plan import BodyPlan
from envgraph.match.plan._planner import Planner
from envgraph.metamodel import Value
from envgraph.pattern import Library, ObjectType, StaticType


class CompiledMatcher(Matcher):
    """A `Matcher` that compiles a function for each pattern and set of bound positions when it is first used.

    Args:
        model: the model to search; it may change between calls.
        library: the patterns; more may be added later.
    """

    def __init__(self, model: Model, library: Library) -> None:
        self.model = model
        self.library = library
        self._program = Program(model, library)
        self._answers: dict[tuple[str, tuple[int, ...], Mode], Function] = {}
        self._parameters: dict[str, tuple[StaticType, ...]] = {}
        self._works: dict[tuple[str, int], float] = {}

    @property
    def calls(self) -> CallGraph:
        """Return the call graph of the patterns."""
        return self._program.calls

    def rows(self, pattern: str, arguments: tuple[object, ...]) -> list[Row]:
        """Return all matches that agree with the arguments."""
        return self._ask(pattern, arguments, Mode.ROWS, [])  # type: ignore[no-any-return]

    def first(self, pattern: str, arguments: tuple[object, ...]) -> Row | None:
        """Return the first match of `rows`, or None. The search stops at this match."""
        return self._ask(pattern, arguments, Mode.FIRST, None)  # type: ignore[no-any-return]

    def exists(self, pattern: str, arguments: tuple[object, ...]) -> bool:
        """Return True if at least one match agrees with the arguments. The search stops at the first match."""
        return self._ask(pattern, arguments, Mode.EXISTS, False)  # type: ignore[no-any-return]

    def count(self, pattern: str, arguments: tuple[object, ...]) -> int:
        """Return the number of matches that agree with the arguments."""
        return self._ask(pattern, arguments, Mode.COUNT, 0)  # type: ignore[no-any-return]

    def prepare(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., list[Row]]:
        """Return the compiled function behind `rows`; it does not check its arguments, see `Matcher.prepare`."""
        return self._specialised(pattern, bound, Mode.ROWS)

    def seeker(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., Iterator[Row]]:
        """Return a function that takes values for the bound positions, unchecked, and yields each match when found."""
        return self._specialised(pattern, bound, Mode.EACH)

    def tester(self, pattern: str) -> Callable[[Row], bool]:
        """Return a function that returns True if a row is a match. A row with a deleted object is no match."""
        types = self._types(pattern)
        holds = self._specialised(pattern, tuple(range(len(types))), Mode.EXISTS)
        objects = tuple(p for p, type_ in enumerate(types) if isinstance(type_, ObjectType))
        classes = self.model.graph.store.classes

        def test(row: Row) -> bool:
            for position in objects:
                if classes[row[position]] < 0:  # type: ignore[index]
                    return False
            return bool(holds(*row))

        return test

    def explain(self, pattern: str, bound: tuple[int, ...] = (), values: Sequence[Any] = ()) -> str:
        """Return as text the plan of `rows` for values at the bound positions, with estimates, and the source.

        Without bound positions, or with values for them, the plan is also executed unless the pattern is recursive. The
        measured rows of each step are shown beside the estimates.

        Raises:
            InvalidArgument: the pattern is unknown, or needs values for other parameters.
        """
        check_bound(self.library, pattern, bound)
        given = dict(zip(bound, values, strict=False))
        known = len(given) == len(bound) and not self.calls.recursive(pattern)

        def actual(body: BodyPlan) -> Trace:
            return trace(self._program.planner, body, given, self._program.build)

        return explain_view(
            self._program.planner, self._program.key(pattern, bound, Mode.ROWS), actual if known else None
        )

    def why_not(self, pattern: str, given: Mapping[int, Value]) -> WhyNot:
        """Return the explanation why there is no match for values at some positions: see `WhyNot`.

        Raises:
            InvalidArgument: the pattern is unknown, or needs values for other parameters.
        """
        check_bound(self.library, pattern, tuple(given))
        return Reasons(self._program.planner, self._program.build, self._first).why_not(pattern, dict(given))

    def _first(self, pattern: str, given: dict[int, Value]) -> Row | None:
        """Return the first match with the given values by position, or None."""
        bound = tuple(sorted(given))
        found = self._specialised(pattern, bound, Mode.FIRST)(*[given[position] for position in bound])
        return found  # type: ignore[no-any-return]

    def cost(self, pattern: str, bound: tuple[int, ...]) -> float:
        """Return the estimated cost of `rows` for values at some positions (ascending), in accesses to the model.

        Return infinity if all objects of a class are scanned, since their future number is unknown, or without a plan.
        """
        return self._program.cost(pattern, bound)

    def work(self, pattern: str) -> float:
        """Return the estimated cost of listing all rows, in accesses to the model of its present size.

        The estimate is cached until the number of objects reaches another power of two.
        """
        place = pattern, len(self.model).bit_length()
        if place not in self._works:
            planner = Planner(self.library, self.calls, LiveSizes(self.library, self.model.graph.store))
            self._works[place] = planner.view(self._program.key(pattern, (), Mode.ROWS)).cost
        return self._works[place]

    def order(self, pattern: str) -> Callable[[Row], list[int]] | None:
        """Return a sort key that puts rows into the order of `prepare`; None if rows do not determine the order."""
        if self.calls.recursive(pattern):
            return None
        bodies = self._program.planner.view(self._program.key(pattern, (), Mode.ROWS)).bodies
        return order_of(bodies[0], self.model.graph.store) if len(bodies) == 1 else None

    def analyze(self) -> None:
        """Discard all plans and functions, and plan with sizes measured in the model from now on.

        By default plans use estimates from the metamodel, so that they do not depend on when they are made. Afterwards
        patterns evaluated on demand may list their rows in another order.
        """
        self._plan_with(LiveSizes(self.library, self.model.graph.store))

    def forget(self) -> None:
        """Discard all cached plans and functions, because pattern names may now refer to other definitions."""
        self._parameters.clear()
        self._plan_with(self._program.planner.sizes)

    def _plan_with(self, sizes: Sizes) -> None:
        """Discard all plans and functions, and use these sizes from now on."""
        self._program = Program(self.model, self.library, sizes)
        self._answers.clear()
        self._works.clear()

    def source(self, pattern: str, bound: tuple[int, ...] = ()) -> str:
        """Return the generated source of `rows` for values at the bound positions.

        Raises:
            InvalidArgument: the pattern is unknown, or needs values for other parameters.
        """
        check_bound(self.library, pattern, bound)
        return view_source(
            self._program.planner, self._program.key(pattern, bound, Mode.ROWS), Mode.ROWS
        ).text

    # --- lookup of compiled functions

    def _types(self, pattern: str) -> tuple[StaticType, ...]:
        """Return the types of a pattern's parameters; cached."""
        types = self._parameters.get(pattern)
        if types is None:
            types = self._parameters[pattern] = self.library.parameter_types(pattern)
        return types

    def _ask(self, pattern: str, arguments: tuple[object, ...], mode: Mode, nothing: object) -> Any:
        """Return the result of a pattern in a result mode; `nothing` if an argument is a deleted object."""
        types = self._types(pattern)
        if arguments.count(FREE) == len(arguments) == len(types):
            return self._specialised(pattern, (), mode)()
        checked = check_arguments(self.model, self.library, pattern, types, arguments)
        if checked is None:
            return nothing
        bound = tuple([position for position, argument in enumerate(checked) if argument is not FREE])
        return self._specialised(pattern, bound, mode)(*[checked[position] for position in bound])

    def _specialised(self, pattern: str, bound: tuple[int, ...], mode: Mode) -> Function:
        """Return the compiled function for a pattern, bound positions and result mode; functions are cached."""
        question = (pattern, bound, mode)
        answer = self._answers.get(question)
        if answer is None:
            check_bound(self.library, pattern, bound)
            check_nesting(self.calls, pattern)
            answer = self._answers[question] = self._program.answering(pattern, bound, mode)
        return answer

    def build(self, source: Source, held: Callable[[Held], object]) -> Function:
        """Return the function of a generated source. `held` returns the values of `Held` symbols."""
        return self._program.build(source, held)
