"""Generate the source of each kind of function: pattern functions, possible closure ends, closure searches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from envgraph import code
from envgraph.match.generate._relation_code import emit_shared_aggregate
from envgraph.match.generate._sinks import (
    OUT,
    distinct_items_sink,
    row,
    search_sink,
    view_sink,
)
from envgraph.match.generate._source_builder import SourceBuilder, local_variable
from envgraph.match.generate._symbols import (
    ClosureFunction,
    ClosureQuestion,
    GeneratedSource,
    MatchLimitCheck,
    RecursiveFunction,
    ResultMode,
    closure_function,
)
from envgraph.match.generate._translation import PlanTranslation
from envgraph.match.plan._duplicate_filters import place_duplicate_filters
from envgraph.match.plan._planner import Planner, determined_variables
from envgraph.match.plan._search_plan import BodyPlan, PatternQuery
from envgraph.match.plan._shared_searches import (
    ClosureEndsQuery,
    closure_of_plan,
    plans_of_ends,
    reach_aggregate_at,
)


def view_source(planner: Planner, key: PatternQuery, mode: ResultMode) -> GeneratedSource:
    """Return the source of the function that answers a pattern query in a result mode.

    Raises:
        Unplannable: a parameter without a value cannot be enumerated.
    """
    view = planner.plan_pattern(key)
    module, block = SourceBuilder(), code.BodyBuilder()
    given = {position: local_variable("v", position) for position in key.bound}
    unique = not view.is_distinct and _should_filter_at_end(planner, view.bodies, key, mode)
    frame, bounded = (
        view_sink(mode, view.is_distinct or unique, ()),
        MatchLimitCheck(key.pattern, counts_failures=True),
    )
    inputs = list(given.values())
    if mode is ResultMode.COUNT and (search := closure_of_plan(view)):
        forward = search.source not in view.bodies[0].plan.steps[0].binds
        size = module.name_of(closure_function(search, ClosureQuestion.SIZE, forward))
        return module.finish(module.add_function("view", inputs, (code.Return(code.emit_call(size, *inputs)),)))
    for body in view.bodies:
        conjunction = body.conjunction
        wanted = mode in (ResultMode.VALUES, ResultMode.BAG)
        positions = key.outputs if wanted else range(len(conjunction.parameters))
        outputs = tuple(conjunction.parameters[p] for p in positions)
        sink = view_sink(mode, view.is_distinct or unique, outputs)
        if unique:  # the plan ends with a duplicate filter
            sink = replace(sink, variables=outputs, repeatable=True, unique=True)
        translation = PlanTranslation(planner, module, conjunction, block, given)
        translation.limit_check = bounded
        translation.emit_plan(body.plan, sink)
    checked = (code.emit_call_statement(module.name_of(bounded)),) if bounded in module else ()
    whole = (*checked, *frame.head, *block.finish_body(), *frame.tail)
    alike = reach_aggregate_at(planner, key, key.bound) if mode is ResultMode.COUNT and key.outputs else None
    if alike is None:
        return module.finish(module.add_function("view", inputs, whole))
    direct = module.add_function("direct", inputs, whole)
    start = inputs[key.bound.index(alike.start)]
    others = code.Tuple(tuple(each for each in inputs if each != start))
    counted = emit_shared_aggregate(module, alike, start, direct, inputs, others)
    return module.finish(module.add_function("view", inputs, (code.Return(counted),)))


def _should_filter_at_end(planner: Planner, bodies: Sequence[BodyPlan], key: PatternQuery, mode: ResultMode) -> bool:
    """Return True if the only body's plan can end with a duplicate filter whose key is shorter than a result.

    Return False also for several bodies, and for result modes that stop at a match.
    """
    if len(bodies) != 1 or mode in (ResultMode.EXISTS, ResultMode.FIRST, ResultMode.EACH):
        return False
    conjunction, steps = bodies[0].conjunction, bodies[0].plan.steps
    outputs = {conjunction.parameters[p] for p in key.outputs}
    known = {number for number, _ in conjunction.constants} | {conjunction.parameters[p] for p in key.bound}
    last = place_duplicate_filters(steps, outputs, known, partial(determined_variables, sizes=planner.sizes)).get(
        len(steps)
    )
    return last is not None and len(last.key) < (
        len(conjunction.parameters) if mode is ResultMode.ROWS else len(key.outputs)
    )


def ends_source(planner: Planner, ends: ClosureEndsQuery) -> GeneratedSource:
    """Return the source of a function for `ends`. Its result has a key (node, *wanted values) for each possible end."""
    module, block = SourceBuilder(), code.BodyBuilder()
    given = {position: local_variable("v", position) for position in ends.given}
    for conjunction, end, plan in plans_of_ends(planner, ends) or ():
        found = (end, *(conjunction.parameters[position] for position in ends.wanted))
        sink = distinct_items_sink(found, partial(row, found), OUT)
        PlanTranslation(planner, module, conjunction, block, given).emit_plan(plan, sink)
    frame = distinct_items_sink((), partial(row, ()), OUT)
    return module.finish(
        module.add_function("ends", list(given.values()), (*frame.head, *block.finish_body(), *frame.tail))
    )


def search_source(planner: Planner, step: str, forward: bool, question: ClosureQuestion) -> GeneratedSource:
    """Return the source of a breadth-first search along a binary pattern.

    `search(start)` returns the nodes reached by one or more steps, nearest first. For `NEW_NODES`, `search(start,
    seen)` skips the nodes in `seen` and adds new ones. For `REACHES`, `search(start, goal, todo)` returns True if it
    reaches the goal; all visited nodes are appended to `todo`, which must be `[start]`.
    """
    module, block = SourceBuilder(), code.BodyBuilder()
    near, far = (0, 1) if forward else (1, 0)
    frame = search_sink(far, question)
    node, other, outside = code.Local("node"), code.Local("other"), list[code.Statement]()
    block.open_loop(node, code.Local("todo"))
    if planner.calls.is_recursive(step):
        ends = (code.Local("_"), other) if forward else (other, code.Local("_"))
        block.open_loop(code.Tuple(ends), code.emit_call(module.name_of(RecursiveFunction(step, (near,))), node))
        block.add(*frame.emit_each(lambda _: other))
    elif planner.calls.summary_of(step).has_closure_or_recursion:
        follow = module.name_of(ClosureFunction(step, False, ClosureQuestion.STEP, forward))
        block.open_loop(other, code.emit_call(follow, node))
        block.add(*frame.emit_each(lambda _: other))
    else:
        for body in planner.plan_expanded(PatternQuery(step, (near,), (far,))).bodies:
            conjunction = body.conjunction
            sink = search_sink(conjunction.parameters[far], question)
            translation = PlanTranslation(planner, module, conjunction, block, {near: node})
            translation.outer_variables = (conjunction.parameters[near],)
            translation.emit_plan(body.plan, sink)
            outside[:0] = [code.Assign(name, code.emit_call("set")) for name in translation.duplicate_filters.outside]
    more = {ClosureQuestion.NEW_NODES: ["seen"], ClosureQuestion.REACHES: ["goal", "todo"]}.get(question, [])
    whole = (*frame.head, *outside, *block.finish_body(), *frame.tail)
    return module.finish(module.add_function("search", list(map(code.Local, ["start", *more])), whole))
