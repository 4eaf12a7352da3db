"""Prepare calls of the engine's rules and units for a behaviour."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from itertools import islice
from operator import add

from envgraph.env._prepared_clauses import CanPerform, ChoiceSource, PerformCall
from envgraph.env._random_choices import all_choice_sequences
from envgraph.errors import LIMITS, RuleError
from envgraph.graph import Model, Node
from envgraph.metamodel import Value
from envgraph.rewrite import Branches, Engine, Firing


def prepare_call(
    engine: Engine, name: str, bound: Sequence[str], outputs: Sequence[str]
) -> tuple[PerformCall, CanPerform]:
    """Return a function that applies a rule at a random match, or runs a unit, and a function that tests if it can.

    Random choices in a unit are sampled uniformly, or by weight.

    Args:
        engine: the engine that has the rule or unit.
        name: the name of the rule or unit.
        bound: the parameters that get values, in order.
        outputs: the parameters whose values are returned.
    """
    if engine.signature(name).kind == "rule":
        return _prepare_rule(engine, name, bound, outputs)
    perform = _prepare_unit(engine, name, bound, outputs)
    return perform, _can_succeed_function(perform, engine.model)


def _prepare_rule(
    engine: Engine, name: str, bound: Sequence[str], outputs: Sequence[str]
) -> tuple[PerformCall, CanPerform]:
    runner, history = engine.prepare(name), engine.history
    find = runner.prepare(tuple(bound))

    def perform(values: Sequence[Value | None], choices: ChoiceSource, model: Model) -> Sequence[Value | None] | None:
        # Sorted, because a matcher's order of rows may depend on how the state was reached.
        rows = sorted(find(*values))
        if not rows:
            return None
        row = rows[choices.pick(len(rows))]
        result = runner.fire(row)
        if history.recorders:
            history.record([Firing(runner.name, row)])
        if not outputs:
            return ()
        found = runner.application(row, result).outputs
        return [_id_or_value(found[name]) for name in outputs]

    return perform, lambda values: bool(find(*values))


def _prepare_unit(engine: Engine, name: str, bound: Sequence[str], outputs: Sequence[str]) -> PerformCall:
    def perform(values: Sequence[Value | None], choices: ChoiceSource, model: Model) -> Sequence[Value | None] | None:
        savepoint = model.graph.history.savepoint()
        try:
            with engine.runs.with_other_randomness(_StepChoices(choices)) as trace:
                result = engine.run(name, bound=dict(zip(bound, values, strict=True)))
            if not result and result.refusal is not None:
                raise result.refusal
        except BaseException:
            model.graph.history.rollback(savepoint)
            raise
        if not result:  # undo the steps before the failed step
            model.graph.history.rollback(savepoint)
            return None
        model.graph.history.release(savepoint)
        engine.history.record(trace, trace.gaps)
        return [_id_or_value(result.outputs.get(output)) for output in outputs]

    return perform


def _can_succeed_function(perform: PerformCall, model: Model) -> CanPerform:
    """Return a function that tests if a unit can succeed: it runs the unit with all choices, and rolls back.

    At most 10,000 sequences of choices are tried. An error counts as success, so that a later run raises it.
    """

    def can_succeed(values: Sequence[Value | None]) -> bool:
        for choices in islice(all_choice_sequences(), LIMITS["outcomes"]):
            savepoint = model.graph.history.savepoint()
            try:
                done = perform(values, choices, model) is not None
            except RuleError:  # `run` raises the error
                done = True
            finally:
                model.graph.history.rollback(savepoint)
            if done:
                return True
        return False

    return can_succeed


class _StepChoices(Branches):
    """The random choices of a unit, made by the `ChoiceSource` of a step."""

    def __init__(self, choices: ChoiceSource) -> None:
        super().__init__()
        self._choices = choices

    def choose(self, count: int) -> int:
        """Return the number of one of `count` alternatives, sampled uniformly."""
        return self._choices.pick(count)

    def weigh(self, weights: Sequence[float]) -> int:
        """Return the number of an alternative, sampled with probability proportional to its weight."""
        total = reduce(add, weights)  # `sum` rounds differently from Python 3.12 on
        return self._choices.choose([weight / total for weight in weights]) or 0


def _id_or_value(found: Node | Value | None) -> Value | None:
    return found.id if isinstance(found, Node) else found
