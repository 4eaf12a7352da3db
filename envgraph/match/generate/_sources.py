"""Generate the source of each kind of function: pattern functions, possible closure ends, closure searches."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from envgraph import code
from envgraph.match.generate._generate import Translation
from envgraph.match.generate._relations import same_for_all
from envgraph.match.generate._sinks import (
    OUT,
    distinct_sink,
    empty,
    keeping,
    row,
    view_sink,
    visiting,
)
from envgraph.match.generate._symbols import (
    Bounded,
    Closed,
    ClosureQuestion,
    Mode,
    Recursive,
    Source,
    closed,
)
from envgraph.match.generate._write import Module, local
from envgraph.match.plan._distinct import distinct_places
from envgraph.match.plan._plan import BodyPlan, ViewKey
from envgraph.match.plan._planner import Planner, determined
from envgraph.match.plan._sharing import (
    Ends,
    alike_starts,
    only_search,
    plans_of_ends,
)


def view_source(planner: Planner, key: ViewKey, mode: Mode) -> Source:
    """Return the source of the function that answers a pattern query in a result mode.

    Raises:
        Unplannable: a parameter without a value cannot be enumerated.
    """
    view = planner.view(key)
    module, block = Module(), code.Block()
    given = {position: local("v", position) for position in key.bound}
    unique = not view.distinct and _ends_in_distinct_set(planner, view.bodies, key, mode)
    frame, bounded = view_sink(mode, view.distinct or unique, ()), Bounded(key.pattern, searched=True)
    inputs = list(given.values())
    if mode is Mode.COUNT and (search := only_search(view)):
        forward = search.source not in view.bodies[0].plan.steps[0].binds
        size = module.name(closed(search, ClosureQuestion.SIZE, forward))
        return module.source(module.function("view", inputs, (code.Return(code.call(size, *inputs)),)))
    for body in view.bodies:
        conjunction = body.conjunction
        wanted = mode in (Mode.VALUES, Mode.BAG)
        positions = key.outputs if wanted else range(len(conjunction.parameters))
        outputs = tuple(conjunction.parameters[p] for p in positions)
        sink = distinct_sink(mode, outputs) if unique else view_sink(mode, view.distinct, outputs)
        translation = Translation(planner, module, conjunction, block, given)
        translation.bounded = bounded
        translation.body(body.plan, sink)
    checked = (code.Do(code.call(module.name(bounded))),) if bounded in module else ()
    whole = (*checked, *frame.head, *block.body(), *frame.tail)
    alike = alike_starts(planner, key, key.bound) if mode is Mode.COUNT and key.outputs else None
    if alike is None:
        return module.source(module.function("view", inputs, whole))
    direct = module.function("direct", inputs, whole)
    start = inputs[key.bound.index(alike.start)]
    others = code.Tuple(tuple(each for each in inputs if each != start))
    counted = same_for_all(module, alike, start, direct, inputs, others)
    return module.source(module.function("view", inputs, (code.Return(counted),)))


def _ends_in_distinct_set(planner: Planner, bodies: Sequence[BodyPlan], key: ViewKey, mode: Mode) -> bool:
    """Return True if the only body's plan can end with a duplicate filter whose key is shorter than a result.

    Return False also for several bodies, and for result modes that stop at a match.
    """
    if len(bodies) != 1 or mode in (Mode.EXISTS, Mode.FIRST, Mode.EACH):
        return False
    conjunction, steps = bodies[0].conjunction, bodies[0].plan.steps
    outputs = {conjunction.parameters[p] for p in key.outputs}
    known = {number for number, _ in conjunction.constants} | {conjunction.parameters[p] for p in key.bound}
    last = distinct_places(steps, outputs, known, partial(determined, sizes=planner.sizes)).get(len(steps))
    return last is not None and len(last.key) < (
        len(conjunction.parameters) if mode is Mode.ROWS else len(key.outputs)
    )


def ends_source(planner: Planner, ends: Ends) -> Source:
    """Return the source of a function for `ends`. Its result has a key (node, *wanted values) for each possible end."""
    module, block = Module(), code.Block()
    given = {position: local("v", position) for position in ends.given}
    for conjunction, end, plan in plans_of_ends(planner, ends) or ():
        found = (end, *(conjunction.parameters[position] for position in ends.wanted))
        sink = keeping(found, partial(row, found), OUT)
        Translation(planner, module, conjunction, block, given).body(plan, sink)
    frame = keeping((), partial(row, ()), OUT)
    return module.source(
        module.function("ends", list(given.values()), (*frame.head, *block.body(), *frame.tail))
    )


def reach_source(planner: Planner, step: str, forward: bool, question: ClosureQuestion) -> Source:
    """Return the source of a breadth-first search along a binary pattern.

    `search(start)` returns the nodes reached by one or more steps, nearest first. For `SPREAD`, `search(start, seen)`
    skips the nodes in `seen` and adds new ones. For `HOLDS`, `search(start, goal, todo)` returns True if it reaches
    the goal; all visited nodes are appended to `todo`, which must be `[start]`.
    """
    module, block = Module(), code.Block()
    near, far = (0, 1) if forward else (1, 0)
    frame = visiting(far, question)
    node, other, outside = code.Local("node"), code.Local("other"), list[code.Statement]()
    block.loop(node, code.Local("todo"))
    if planner.calls.recursive(step):
        ends = (code.Local("_"), other) if forward else (other, code.Local("_"))
        block.loop(code.Tuple(ends), code.call(module.name(Recursive(step, (near,))), node))
        block.add(*frame.each(lambda _: other))
    elif planner.calls.of(step).searches:
        follow = module.name(Closed(step, False, ClosureQuestion.STEP, forward))
        block.loop(other, code.call(follow, node))
        block.add(*frame.each(lambda _: other))
    else:
        for body in planner.expanded(ViewKey(step, (near,), (far,))).bodies:
            conjunction = body.conjunction
            sink = visiting(conjunction.parameters[far], question)
            translation = Translation(planner, module, conjunction, block, {near: node})
            translation.around = (conjunction.parameters[near],)
            translation.body(body.plan, sink)
            outside[:0] = [code.Assign(name, empty("set")) for name in translation.distinct.outside]
    more = {ClosureQuestion.SPREAD: ["seen"], ClosureQuestion.HOLDS: ["goal", "todo"]}.get(question, [])
    whole = (*frame.head, *outside, *block.body(), *frame.tail)
    return module.source(module.function("search", list(map(code.Local, ["start", *more])), whole))
