"""Control units: the meaning of their steps, and compiled units.

A step *fails* or *succeeds*. A step that succeeds may or may not have changed the model. If Henshin has a unit of the
same kind, the meaning is that of Henshin with `strict` and without `rollback`; `atomic` and `try` undo changes.

- A call of a rule applies it at one of its matches, drawn uniformly. If the rule is refused there (a dangling edge, a
  full reference ..), the other matches are tried in random order. The call fails if the rule has no match or is refused
  at every match. A call of a group draws a rule by weight among those with a match; if it fails, another is drawn.
- `first rule` takes the first match, then the others in order. The order of matches depends only on the version.
- `where` restricts the matches to those for which a condition holds.
- `a; b;` runs the steps in order and fails at the first that fails; changes of earlier steps remain.
- `a | b` tries the alternatives until one succeeds: those of the highest `@priority` first, in random order by
  `@weight`. The changes of a failed alternative are undone. The step fails if all alternatives fail.
- `alap` repeats its body as long as it succeeds and applies a rule. The changes of the last, failed round are undone.
  The step never fails.
- `repeat n..m` computes its bounds and draws a number of rounds. The first round that fails ends the step and is
  undone. The step fails if fewer than n rounds succeeded, or if a bound has no value.
- `try` undoes its body if it fails, and then runs `else`. It fails only if `else` fails.
- `if` runs one branch, and succeeds if the branch is missing. `if rule(x)` tests if the rule is applicable at one of
  its matches by applying it and undoing this.
- `atomic` undoes everything if its body fails, and then fails.
- `all rule` applies the rule at each of its current matches, except matches that no longer hold or at which it is
  refused; it fails if it was never applied. `by` orders the matches, the largest value first; equal values keep
  their order, and matches without a value are left out. `top 3 rule by e` takes only the first three of these.
- A failed evaluation, contradictory matches of a `forall`, an exception in a Python rule, or more steps than the limit
  end the whole run with an exception, and everything is undone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from envgraph.code import shorten_repr
from envgraph.errors import LIMITS, EvaluationError, RuleError
from envgraph.graph import Model, Node
from envgraph.match import Matcher
from envgraph.metamodel import Value
from envgraph.rewrite._matches import Firing, Match
from envgraph.rewrite._signatures import Signature
from envgraph.rewrite.check._unit_check import CheckedUnit, nesting_depth
from envgraph.rewrite.run._rule_runner import RuleRunner
from envgraph.rewrite.run._unit_code import UnitSource
from envgraph.rewrite.run._unit_runtime import Environment, StepDescription, UnitRun, firings, format_span


class UnitProgram:
    """A compiled unit. An environment passes its parameters, and receives the values of its `out` parameters.

    The unit is compiled when it first runs, because definitions that it calls may be added later.

    Attributes:
        checked: the unit and the meaning of its names; None for a Python function.
    """

    checked: CheckedUnit | None = None

    def __init__(self, signature: Signature, checked: CheckedUnit, writer: Callable[[], UnitSource]) -> None:
        self.name = signature.name
        self.signature = signature
        self.weight = signature.weight
        self.priority = signature.priority
        self.levels = nesting_depth(checked.unit.body)
        self.checked = checked
        self._writer = writer
        self._function: Callable[[UnitRun, Environment], bool | None] | None = None
        self._source = ""

    def run(self, run: UnitRun, environment: Environment, call_site: StepDescription | None = None) -> bool | None:
        """Execute the unit as part of a run and return its outcome; `call_site` describes the call in messages.

        Raises:
            EvaluationError: too many nested steps, or the step limit is exceeded.
        """
        run.count_step(call_site)
        run.levels += self.levels
        if run.levels > (most := LIMITS["nested steps"]):
            raise EvaluationError(
                f"steps are nested more than {most} levels deep; `{self.name}` is one of the called units",
                call_site and call_site[1],
                "use `alap` or `repeat` instead of units that call each other without an end",
            )
        function = self._function or self._compile()
        outcome = function(run, environment)
        run.levels -= self.levels
        return outcome

    def _compile(self) -> Callable[[UnitRun, Environment], bool | None]:
        writer = self._writer()
        self._function = writer.compile(self.signature)
        self._source = writer.source
        return self._function

    @property
    def source(self) -> str:
        """Return the generated Python source of the unit."""
        if self._function is None:
            self._compile()
        return self._source


def unit_program(
    checked: CheckedUnit,
    signature: Signature,
    rules: Mapping[str, RuleRunner],
    units: Mapping[str, UnitProgram],
    group: Callable[[str], tuple[str, ...]],
    model: Model,
    matcher: Matcher,
) -> UnitProgram:
    """Return the program of a unit without errors, compiled at its first run, when all its callees must exist."""

    def called(name: str) -> Callable[[UnitRun, Environment, StepDescription], bool | None]:
        return units[name].run

    return UnitProgram(signature, checked, lambda: UnitSource(checked, rules, called, group, model, matcher))


@shorten_repr
class RunResult:
    """The result of a run, which is true if the run succeeded.

    Attributes:
        name: name of the unit, rule or group.
        succeeded: True if the run succeeded. The changes of a failed run remain, unless the unit is `atomic`.
        reason: the step that failed, its span and the reason; None if the run succeeded.
        span: span of the step that failed, if it was parsed from text.
        refusal: the refused application that made the run fail, or None.
        outputs: values of the `out` parameters, if the run succeeded.
        steps: number of calls and loop rounds.
        events: applications of event rules that fired at the end of the run.
    """

    __slots__ = (
        "_trace",
        "events",
        "name",
        "outputs",
        "reason",
        "refusal",
        "span",
        "steps",
        "succeeded",
    )

    def __init__(
        self,
        name: str,
        trace: Sequence[Any],
        failure: StepDescription | None,
        refusal: RuleError | None,
        outputs: Mapping[str, Node | Value],
        steps: int,
    ) -> None:
        self.name = name
        self.succeeded = failure is None
        self.refusal = refusal
        text, self.span = failure or ("", None)
        where = text + format_span(self.span)
        self.reason = None if failure is None else where if refusal is None else f"{where}: {refusal.message}"
        self.outputs = MappingProxyType(dict(outputs))
        self.steps = steps
        self.events: tuple[Firing, ...] = ()
        self._trace = trace

    def __bool__(self) -> bool:
        return self.succeeded

    @property
    def applications(self) -> int:
        """Return the number of rule applications of the run, without event rules."""
        return len(self._trace) // 2

    @property
    def matches(self) -> tuple[Match, ...]:
        """Return the matches at which rules were applied, in order. The `definition` of each is the rule."""
        items = iter(self._trace)
        return tuple(Match(rule.model, rule.shape, row) for rule, row in zip(items, items, strict=True))

    @property
    def firings(self) -> tuple[Firing, ...]:
        """Return the applications for `Engine.replay`: those of the run, then those of event rules."""
        return (*firings(self._trace), *self.events)

    def __repr__(self) -> str:
        how = "succeeded" if self.succeeded else f"failed: {self.reason}"
        return f"<run of {self.name}: {self.applications} applications, {how}>"
