"""The compiled matcher: compiles a Python function for each kind of query of a pattern."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from envgraph.graph import Model
from envgraph.match._matcher import FREE, Matcher, Row, check_arguments, check_bound
from envgraph.match.demand._compiled_functions import CompiledFunction, CompiledProgram
from envgraph.match.demand._row_order import order_of
from envgraph.match.explain._plan_text import explain_view
from envgraph.match.explain._plan_trace import PlanTrace, trace_plan
from envgraph.match.explain._why_not import FailureSearch, WhyNot
from envgraph.match.generate._sources import view_source
from envgraph.match.generate._symbols import (
    GeneratedSource,
    OperatorSymbol,
    ResultMode,
)
from envgraph.match.passes._call_graph import CallGraph, check_nesting
from envgraph.match.plan._measured_sizes import LiveSizes
from envgraph.match.plan._planner import Planner
from envgraph.match.plan._search_plan import BodyPlan
from envgraph.match.plan._size_estimates import SizeEstimates
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
        self._program = CompiledProgram(model, library)
        self._answers: dict[tuple[str, tuple[int, ...], ResultMode], CompiledFunction] = {}
        self._parameters: dict[str, tuple[StaticType, ...]] = {}
        self._works: dict[tuple[str, int], float] = {}

    @property
    def call_graph(self) -> CallGraph:
        """Return the call graph of the patterns."""
        return self._program.calls

    def rows(self, pattern: str, arguments: tuple[object, ...]) -> list[Row]:
        """Return all matches that agree with the arguments."""
        return self._evaluate(pattern, arguments, ResultMode.ROWS, [])  # type: ignore[no-any-return]

    def first(self, pattern: str, arguments: tuple[object, ...]) -> Row | None:
        """Return the first match of `rows`, or None. The search stops at this match."""
        return self._evaluate(pattern, arguments, ResultMode.FIRST, None)  # type: ignore[no-any-return]

    def exists(self, pattern: str, arguments: tuple[object, ...]) -> bool:
        """Return True if at least one match agrees with the arguments. The search stops at the first match."""
        return self._evaluate(pattern, arguments, ResultMode.EXISTS, False)  # type: ignore[no-any-return]

    def count(self, pattern: str, arguments: tuple[object, ...]) -> int:
        """Return the number of matches that agree with the arguments."""
        return self._evaluate(pattern, arguments, ResultMode.COUNT, 0)  # type: ignore[no-any-return]

    def prepare(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., list[Row]]:
        """Return the compiled function behind `rows`; it does not check its arguments, see `Matcher.prepare`."""
        return self._specialised(pattern, bound, ResultMode.ROWS)

    def prepare_iterator(self, pattern: str, bound: tuple[int, ...]) -> Callable[..., Iterator[Row]]:
        """Return a function that takes values for the bound positions, unchecked, and yields each match when found."""
        return self._specialised(pattern, bound, ResultMode.EACH)

    def prepare_test(self, pattern: str) -> Callable[[Row], bool]:
        """Return a function that returns True if a row is a match. A row with a deleted object is no match."""
        types = self._types(pattern)
        holds = self._specialised(pattern, tuple(range(len(types))), ResultMode.EXISTS)
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
        known = len(given) == len(bound) and not self.call_graph.is_recursive(pattern)

        def actual(body: BodyPlan) -> PlanTrace:
            return trace_plan(self._program.planner, body, given, self._program.build)

        return explain_view(
            self._program.planner,
            self._program.key(pattern, bound, ResultMode.ROWS),
            actual if known else None,
        )

    def why_not(self, pattern: str, given: Mapping[int, Value]) -> WhyNot:
        """Return the explanation why there is no match for values at some positions: see `WhyNot`.

        Raises:
            InvalidArgument: the pattern is unknown, or needs values for other parameters.
        """
        check_bound(self.library, pattern, tuple(given))
        return FailureSearch(self._program.planner, self._program.build, self._first).why_not(pattern, dict(given))

    def _first(self, pattern: str, given: dict[int, Value]) -> Row | None:
        """Return the first match with the given values by position, or None."""
        bound = tuple(sorted(given))
        found = self._specialised(pattern, bound, ResultMode.FIRST)(*[given[position] for position in bound])
        return found  # type: ignore[no-any-return]

    def cost(self, pattern: str, bound: tuple[int, ...]) -> float:
        """Return the estimated cost of `rows` for values at some positions (ascending), in accesses to the model.

        Return infinity if all objects of a class are scanned, since their future number is unknown, or without a plan.
        """
        return self._program.cost(pattern, bound)

    def measured_cost(self, pattern: str) -> float:
        """Return the estimated cost of listing all rows, in accesses to the model of its present size.

        The estimate is cached until the number of objects reaches another power of two.
        """
        place = pattern, len(self.model).bit_length()
        if place not in self._works:
            planner = Planner(self.library, self.call_graph, LiveSizes(self.library, self.model.graph.store))
            self._works[place] = planner.plan_pattern(self._program.key(pattern, (), ResultMode.ROWS)).cost
        return self._works[place]

    def sort_key(self, pattern: str) -> Callable[[Row], list[int]] | None:
        """Return a sort key that puts rows into the order of `prepare`; None if rows do not determine the order."""
        if self.call_graph.is_recursive(pattern):
            return None
        bodies = self._program.planner.plan_pattern(self._program.key(pattern, (), ResultMode.ROWS)).bodies
        return order_of(bodies[0], self.model.graph.store) if len(bodies) == 1 else None

    def analyze(self) -> None:
        """Discard all plans and functions, and plan with sizes measured in the model from now on.

        By default plans use estimates from the metamodel, so that they do not depend on when they are made. Afterwards
        patterns evaluated on demand may list their rows in another order.
        """
        self._replan(LiveSizes(self.library, self.model.graph.store))

    def discard_caches(self) -> None:
        """Discard all cached plans and functions, because pattern names may now refer to other definitions."""
        self._parameters.clear()
        self._replan(self._program.planner.sizes)

    def _replan(self, sizes: SizeEstimates) -> None:
        """Discard all plans and functions, and use these sizes from now on."""
        self._program = CompiledProgram(self.model, self.library, sizes)
        self._answers.clear()
        self._works.clear()

    def source(self, pattern: str, bound: tuple[int, ...] = ()) -> str:
        """Return the generated source of `rows` for values at the bound positions.

        Raises:
            InvalidArgument: the pattern is unknown, or needs values for other parameters.
        """
        check_bound(self.library, pattern, bound)
        return view_source(
            self._program.planner, self._program.key(pattern, bound, ResultMode.ROWS), ResultMode.ROWS
        ).text

    # --- lookup of compiled functions

    def _types(self, pattern: str) -> tuple[StaticType, ...]:
        """Return the types of a pattern's parameters; cached."""
        types = self._parameters.get(pattern)
        if types is None:
            types = self._parameters[pattern] = self.library.parameter_types(pattern)
        return types

    def _evaluate(self, pattern: str, arguments: tuple[object, ...], mode: ResultMode, nothing: object) -> Any:
        """Return the result of a pattern in a result mode; `nothing` if an argument is a deleted object."""
        types = self._types(pattern)
        if arguments.count(FREE) == len(arguments) == len(types):
            return self._specialised(pattern, (), mode)()
        checked = check_arguments(self.model, self.library, pattern, types, arguments)
        if checked is None:
            return nothing
        bound = tuple([position for position, argument in enumerate(checked) if argument is not FREE])
        return self._specialised(pattern, bound, mode)(*[checked[position] for position in bound])

    def _specialised(self, pattern: str, bound: tuple[int, ...], mode: ResultMode) -> CompiledFunction:
        """Return the compiled function for a pattern, bound positions and result mode; functions are cached."""
        question = (pattern, bound, mode)
        answer = self._answers.get(question)
        if answer is None:
            check_bound(self.library, pattern, bound)
            check_nesting(self.call_graph, pattern)
            answer = self._answers[question] = self._program.query_function(pattern, bound, mode)
        return answer

    def build(self, source: GeneratedSource, operator_value: Callable[[OperatorSymbol], object]) -> CompiledFunction:
        """Return the function of a generated source. `operator_value` returns the values of `OperatorSymbol`
        symbols.
        """
        return self._program.build(source, operator_value)
