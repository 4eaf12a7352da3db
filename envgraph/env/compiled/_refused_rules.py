"""Emit functions for rules in a unit that may be refused: save the state, restore it, and try the next match."""

from __future__ import annotations

from typing import TYPE_CHECKING

from envgraph import code
from envgraph.behaviour import RuleCall
from envgraph.env.compiled._body_code import CAPACITY
from envgraph.env.compiled._program_layout import (
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
    emit_call,
    emit_error,
    emit_result,
    emit_state_entry,
    emit_sum,
)
from envgraph.env.compiled._term_code import initial_constant

if TYPE_CHECKING:
    from envgraph.env.compiled._clause_code import FunctionEmitter


def emit_attempts(
    writer: FunctionEmitter,
    rule: RuleCall,
    bound: tuple[str, ...],
    output_names: tuple[str, ...],
    *,
    tests_only: bool,
) -> tuple[list[code.Local], code.Body]:
    """Return the parameters and body of a function that applies a rule at a random match, and tries others if refused.

    The function returns 1 and the outputs after an application. It returns 0 if there is no match, or if the rule is
    refused at all of them, which also sets the error of the state. It returns -1 after any other error.

    Args:
        writer: the emitter of the function that calls this function.
        rule: the call.
        bound, output_names: the parameters that get values, and the outputs to return.
        tests_only: True to test only if the rule can be applied. No match is sampled, and the state does not
            change. The function then returns 1 after any other error, too.
    """
    plan, given, key = writer.plan_and_view(rule, bound)
    types = writer.output_types(rule, output_names)
    nothing = [initial_constant(type_) for type_ in types]
    done, left, row = (writer.module.new_local(name) for name in ("done", "n", "k"))
    loads, values = writer.matching.load_row(key, row)
    matched = {**given, **dict(zip(key.outputs, values, strict=True))}
    here = [writer.facts.new_local_for(plan.types[p]) for p in sorted(matched)]

    def emit_effects() -> tuple[list[code.Local], code.Body]:
        return here, writer.emit_rule_effects(rule, dict(enumerate(here)), output_names)

    fired = writer.module.function_for(("fire", rule.rule, output_names), "fire", emit_effects)
    find = writer.matching.emit_rows(key) if key.outputs else writer.matching.emit_exists(key)
    found: code.Expression = emit_call(find, *given.values())
    writer.module.record_call(find, 0)
    writer.module.record_call(fired, 2)
    outputs = [writer.facts.new_local_for(type_) for type_ in types]
    kept, above = (emit_sum(TOP, code.Operation("*", (CAPACITY, code.Constant(n)))) for n in (1, 2))
    sizes = [writer.facts.layout.offset(Width(of)) for of in ("S", "F")]
    put_back = code.ExpressionStatement(code.emit_call("put_back", S, F, *sizes, RI, RF, kept))
    target = code.emit_tuple(done, *outputs) if outputs else done
    refused = code.emit_equal(emit_state_entry(ERROR), code.Name("REFUSED"))
    success = code.Return(emit_result(done, outputs))
    wrong = code.Return(emit_result(ONE if tests_only else NOBODY, nothing))
    turn = (
        code.Assign(row, emit_sum(TOP, ZERO if tests_only else code.emit_call("pick", D, left))),
        *loads,
        code.Assign(target, emit_call(fired, *(matched[p] for p in sorted(matched)), top=above)),
        code.If(code.emit_equal(done, ONE), ((put_back, success) if tests_only else (success,))),
        code.If(code.emit_not(refused), ((put_back, wrong) if tests_only else (wrong,))),
        put_back,
        code.ExpressionStatement(code.emit_call("drop_row", RI, RF, row, emit_sum(TOP, left))),
        code.Assign(left, ONE, "-="),
    )
    body = (
        code.Assign(left, found if key.outputs else code.ConditionalExpression(found, ONE, ZERO)),
        code.If(code.Operation("!=", (emit_state_entry(ERROR), ZERO)), (wrong,)),
        code.If(code.emit_equal(left, ZERO), (code.Return(emit_result(ZERO, nothing)),)),
        code.ExpressionStatement(code.emit_call("keep", S, F, *sizes, RI, RF, kept)),
        code.While(code.Operation(">", (left, ZERO)), turn),
        emit_error("REFUSED"),
        code.Return(emit_result(ZERO, nothing)),
    )
    return [given[plan.variables.index(name)] for name in bound], body
