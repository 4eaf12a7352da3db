"""The rules of an engine as a behaviour calls them."""

from __future__ import annotations

from collections.abc import Sequence
from math import fsum

from envgraph.env._prepared import Choices, Perform
from envgraph.graph import Model, Node
from envgraph.metamodel import Value
from envgraph.rewrite import Branches, Engine, RuleRunner


def applying(engine: Engine, name: str, bound: Sequence[str], outputs: Sequence[str]) -> Perform:
    """Applies a rule at one of its matches, or runs a unit, whose choices are equally likely or go by weight.

    Args:
        engine: that has it.
        name: of the rule or unit.
        bound: the parameters that values are given for, in order.
        outputs: the parameters whose values are wanted.
    """
    if engine.signature(name).kind == "rule":
        return _applying_rule(engine.prepare(name), bound, outputs)
    return _running_unit(engine, name, bound, outputs)


def _applying_rule(runner: RuleRunner, bound: Sequence[str], outputs: Sequence[str]) -> Perform:
    find = runner.prepare(tuple(bound))

    def perform(
        values: Sequence[Value | None], choices: Choices, model: Model
    ) -> Sequence[Value | None] | None:
        # Sorted: the order that a matcher lists rows in may depend on how a state was reached.
        rows = sorted(find(*values))
        if not rows:
            return None
        row = rows[choices.pick(len(rows))]
        result = runner.fire(row)
        if not outputs:
            return ()
        found = runner.application(row, result).outputs
        return [_value(found[name]) for name in outputs]

    return perform


def _running_unit(engine: Engine, name: str, bound: Sequence[str], outputs: Sequence[str]) -> Perform:
    def perform(
        values: Sequence[Value | None], choices: Choices, model: Model
    ) -> Sequence[Value | None] | None:
        savepoint = model.savepoint()
        try:
            with engine.lent(_Drawn(choices)):
                result = engine.run(name, bound=dict(zip(bound, values, strict=True)))
            if not result and result.refusal is not None:
                raise result.refusal
        except BaseException:
            model.rollback(savepoint)
            raise
        if not result:  # what it did before the step that failed is taken back: the state stays
            model.rollback(savepoint)
            return None
        model.release(savepoint)
        return [_value(result.outputs.get(output)) for output in outputs]

    return perform


class _Drawn(Branches):
    """The choices of a unit, made like those of a step."""

    def __init__(self, choices: Choices) -> None:
        super().__init__()
        self._choices = choices

    def choose(self, count: int) -> int:
        """See `Branches`."""
        return self._choices.pick(count)

    def weigh(self, weights: Sequence[float]) -> int:
        """See `Branches`."""
        total = fsum(weights)
        return self._choices.choose([weight / total for weight in weights]) or 0


def _value(found: Node | Value | None) -> Value | None:
    return found.id if isinstance(found, Node) else found
