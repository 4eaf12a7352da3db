"""One run of a unit: its limits, what it leaves open, and the random choices among rules and matches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import fsum
from typing import Final

from envgraph.errors import EvaluationError, RuleError
from envgraph.graph import Model, Savepoint
from envgraph.metamodel import Value
from envgraph.rewrite._branches import Branches
from envgraph.rewrite._match import Firing, Row
from envgraph.rewrite._runner import Randomness, RuleRunner, draw

STEP_LIMIT: Final = 100_000
"""How many calls and rounds one run may take, unless told otherwise."""

MOST_LEVELS: Final = 200
"""How deep the steps of a run may nest, those of called units included; Python's own stack ends beyond it."""

REFUSALS: Final = frozenset(
    {"containment", "dangling", "full", "identification", "lost-link", "multiplicity"}
)
"""Reasons for which a step fails; any other `RuleError` ends the run."""

Environment = dict[str, Value]
Action = Callable[["Run", Environment], "bool | None"]
"""Runs a step: None if it fails, else whether it changed anything."""


@dataclass(slots=True)
class Run:
    """The state of one run of a unit.

    Attributes:
        steps: how many are left.
        trace: what was applied, in order.
        refusal: why the model refused the last application that failed, if that is why the last step failed.
    """

    model: Model
    rng: Randomness
    steps: int
    limit: int
    trace: list[Firing] = field(default_factory=list)
    refusal: RuleError | None = None
    levels: int = 0
    _open: list[Savepoint] = field(default_factory=list)

    def count(self) -> None:
        """One more step.

        Raises:
            EvaluationError: that is one too many.
        """
        self.steps -= 1
        if self.steps < 0:
            raise EvaluationError(f"the run took more than {self.limit} steps; `alap` may never end")

    def whole(self, action: Action, environment: Environment) -> bool | None:
        """Run a step that leaves nothing behind if it fails."""
        savepoint, length = self.model.savepoint(), len(self.trace)
        self._open.append(savepoint)
        outcome = action(self, environment)
        # Not in a `finally`: what an exception leaves open is closed by `abandon`, where the stack is not exhausted.
        self._open.pop()
        if outcome is None:
            self.model.rollback(savepoint)
            del self.trace[length:]
        else:
            self.model.release(savepoint)
        return outcome

    def abandon(self) -> None:
        """Take back what every open step has done, after an exception."""
        while self._open:
            self.model.rollback(self._open.pop())


def apply_one(run: Run, rule: RuleRunner, rows: Sequence[Row]) -> tuple[Row, Sequence[object]] | None:
    """Apply a rule at one of the rows, drawn uniformly; if that is refused, at one of the others."""
    left = rows
    while left:
        number = draw(run.rng, len(left))
        row = left[number]
        try:
            result = rule.fire(row)
        except RuleError as error:
            note_refusal(run, error)
            left = [*left[:number], *left[number + 1 :]]
            continue
        run.refusal = None
        run.trace.append(Firing(rule.name, row))
        return row, result
    return None


def note_refusal(run: Run, error: RuleError) -> None:
    if error.reason not in REFUSALS:
        raise error
    run.refusal = error


def apply_one_of(run: Run, rules: Sequence[RuleRunner]) -> bool | None:
    """Draw a rule by weight among those that match, and apply it at one of its matches; go on if that is refused."""
    run.count()
    run.refusal = None
    left = [rule for rule in rules if rule.exists()]
    while left:
        rule = left[draw_weighted(run.rng, [rule.weight for rule in left])]
        if apply_one(run, rule, rule.live_rows()) is not None:
            return True
        left = [other for other in left if other is not rule]
    return None


def draw_weighted(rng: Randomness, weights: Sequence[float]) -> int:
    """A number from 0, with probabilities in proportion to the weights; without a choice nothing is drawn."""
    if len(weights) == 1 or isinstance(rng, Branches):
        return draw(rng, len(weights))
    point = rng.random() * fsum(weights)
    for number, weight in enumerate(weights):
        point -= weight
        if point < 0:
            return number
    return len(weights) - 1  # rounding
