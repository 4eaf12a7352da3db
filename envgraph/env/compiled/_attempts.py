"""Emit functions for rules in a unit that may be refused: save the state, restore it, and try the next match."""

from __future__ import annotations

from typing import TYPE_CHECKING

from envgraph import code
from envgraph.behaviour import RuleCall
from envgraph.env.compiled._bodies import CAPACITY
from envgraph.env.compiled._layout import (
    ERROR,
    NOBODY,
    ONE,
    RF,
    RI,
    TOP,
    ZERO,
    D,
    F,
    S,
    Width,
    call,
    cell,
    failed,
    listed,
    plus,
)
from envgraph.env.compiled._terms import zero_of

if TYPE_CHECKING:
    from envgraph.env.compiled._writer import Writer


def attempts(
    writer: Writer, rule: RuleCall, bound: tuple[str, ...], wanted: tuple[str, ...], *, asks: bool
) -> tuple[list[code.Local], code.Body]:
    """Return the parameters and body of a function that applies a rule at a random match, and tries others if refused.

    The function returns 1 and the outputs after an application. It returns 0 if there is no match, or if the rule is
    refused at all of them, which also sets the error of the state. It returns -1 after any other error.

    Args:
        writer: the emitter of the function that calls this function.
        rule: the call.
        bound, wanted: the parameters that get values, and the outputs to return.
        asks: True to test only if the rule can be applied. No match is sampled, and the state does not change. The
            function then returns 1 after any other error, too.
    """
    plan, given, key = writer.asked(rule, bound)
    types = writer.output_types(rule, wanted)
    nothing = [zero_of(type_) for type_ in types]
    done, left, row = (writer.module.fresh(name) for name in ("done", "n", "k"))
    loads, values = writer.matching.loaded(key, row)
    matched = {**given, **dict(zip(key.outputs, values, strict=True))}
    here = [writer.facts.local(plan.types[p]) for p in sorted(matched)]

    def fire() -> tuple[list[code.Local], code.Body]:
        return here, writer.fired(rule, dict(enumerate(here)), wanted)

    fired = writer.module.once(("fire", rule.rule, wanted), "fire", fire)
    find = writer.matching.rows(key) if key.outputs else writer.matching.exists(key)
    found: code.Expression = call(find, *given.values())
    writer.module.uses(find, 0)
    writer.module.uses(fired, 2)
    outputs = [writer.facts.local(type_) for type_ in types]
    kept, above = (plus(TOP, code.Operation("*", (CAPACITY, code.Constant(n)))) for n in (1, 2))
    sizes = [writer.facts.layout.offset(Width(of)) for of in ("S", "F")]
    put_back = code.Do(code.call("put_back", S, F, *sizes, RI, RF, kept))
    target = code.tuple_of(done, *outputs) if outputs else done
    refused = code.equal(cell(ERROR), code.Name("REFUSED"))
    success = code.Return(listed(done, outputs))
    wrong = code.Return(listed(ONE if asks else NOBODY, nothing))
    turn = (
        code.Assign(row, plus(TOP, ZERO if asks else code.call("pick", D, left))),
        *loads,
        code.Assign(target, call(fired, *(matched[p] for p in sorted(matched)), top=above)),
        code.If(code.equal(done, ONE), ((put_back, success) if asks else (success,))),
        code.If(code.inverse(refused), ((put_back, wrong) if asks else (wrong,))),
        put_back,
        code.Do(code.call("drop_row", RI, RF, row, plus(TOP, left))),
        code.Assign(left, ONE, "-="),
    )
    body = (
        code.Assign(left, found if key.outputs else code.Choice(found, ONE, ZERO)),
        code.If(code.Operation("!=", (cell(ERROR), ZERO)), (wrong,)),
        code.If(code.equal(left, ZERO), (code.Return(listed(ZERO, nothing)),)),
        code.Do(code.call("keep", S, F, *sizes, RI, RF, kept)),
        code.While(code.Operation(">", (left, ZERO)), turn),
        failed("REFUSED"),
        code.Return(listed(ZERO, nothing)),
    )
    return [given[plan.variables.index(name)] for name in bound], body
