"""Control units: what they mean, and those that are ready to run.

A step *fails* or *succeeds*; a step that succeeds may have changed the model or not. Where Henshin has a unit for it,
the meaning is Henshin's with `strict` and without `rollback`; `atomic` and `try` undo what was done before a failure.

- A call of a rule applies it at one of its matches, drawn uniformly. If the model refuses the application there (a
  dangling link, a full reference ...), the other matches are tried in random order; the call fails if none is left. A
  call of a group draws a rule by weight among those that match, and goes on with the others likewise.
- `first rule` takes the first match, and goes on in order. The order of matches is a function of the model's version.
- `where` leaves those matches for which a condition holds.
- `a; b;` runs the steps in order and fails at the first that fails; what was done before stays.
- `a | b` tries the alternatives, those of the highest `@priority` first, among equals drawn by `@weight`, until one
  succeeds; an alternative that fails leaves nothing behind. It fails if all do.
- `alap` repeats its body as long as that succeeds and applies a rule; the last, failing round leaves nothing
  behind. It never fails.
- `repeat n..m` works its bounds out and draws a number of rounds. The first that fails ends it and leaves nothing
  behind; the step fails if fewer than n have succeeded then, or if a bound has no value.
- `try` never fails by itself: a body that fails is undone, and `else` runs, which may fail.
- `if` runs one branch; without a branch to run it succeeds. `if rule(x)` asks whether the rule is applicable at one of
  its matches: it is tried there, and undone.
- `atomic` undoes everything if its body fails, and fails then.
- `all rule` applies the rule at each of its matches of now that still is one when its turn comes and is not refused;
  it fails if there is none. `by` puts them in order, the largest value first, and equal ones as they come; a match for
  which it has no value is left out. `top 3 rule by e` takes the first three of those alone.
- A failed evaluation, a conflict between the matches of a `forall`, an exception in a Python rule, more steps than
  the limit: these end the whole run with the exception, and everything is undone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from envgraph.code import short_repr
from envgraph.errors import EvaluationError, RuleError
from envgraph.graph import Model, Node
from envgraph.match import Matcher
from envgraph.metamodel import Value
from envgraph.rewrite._match import Firing, Match
from envgraph.rewrite._names import Signature
from envgraph.rewrite.check._unit_check import CheckedUnit, depth
from envgraph.rewrite.run._run import MOST_RUNNING, Environment, Run, Site, at, firings
from envgraph.rewrite.run._runner import RuleRunner
from envgraph.rewrite.run._unit_source import UnitSource


class UnitProgram:
    """A unit that is ready to run: its parameters are given in an environment, where its `out` ones are found then.

    It is compiled when it is first run: what it calls may be defined after it.

    Attributes:
        checked: the unit, and what its names mean; None if it is a Python function.
    """

    checked: CheckedUnit | None = None

    def __init__(self, signature: Signature, checked: CheckedUnit, writer: Callable[[], UnitSource]) -> None:
        self.name = signature.name
        self.signature = signature
        self.weight = signature.weight
        self.priority = signature.priority
        self.levels = depth(checked.unit.body)
        self.checked = checked
        self._writer = writer
        self._function: Callable[[Run, Environment], bool | None] | None = None
        self._source = ""

    def run(self, run: Run, environment: Environment, site: Site | None = None) -> bool | None:
        """Run it inside of a run; `site` is the call."""
        run.count(site)
        run.levels += self.levels
        if run.levels > MOST_RUNNING:
            raise EvaluationError(
                f"more than {MOST_RUNNING} steps inside each other; `{self.name}` is one that calls on",
                site and site[1],
                "use `alap` or `repeat` instead of units that call each other without an end",
            )
        function = self._function or self._compiled()
        outcome = function(run, environment)
        run.levels -= self.levels
        return outcome

    def _compiled(self) -> Callable[[Run, Environment], bool | None]:
        writer = self._writer()
        self._function = writer.compile(self.signature)
        self._source = writer.source
        return self._function

    @property
    def source(self) -> str:
        """The generated source."""
        if self._function is None:
            self._compiled()
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
    """The program of a unit without errors; rules and units may be added until it first runs."""

    def called(name: str) -> Callable[[Run, Environment, Site], bool | None]:
        return units[name].run

    return UnitProgram(signature, checked, lambda: UnitSource(checked, rules, called, group, model, matcher))


@short_repr
class RunResult:
    """What a run has done: true if it succeeded.

    Attributes:
        name: of the unit, rule or group.
        succeeded: whether it did; one that fails keeps what it did before, unless it is `atomic`.
        reason: why it failed: which step, and where it is written; None if it succeeded.
        span: the step that failed, if it was read from a text.
        refusal: the reason of the model, if that refused an application and the run failed for it; else None.
        outputs: values of the `out` parameters, if it succeeded.
        steps: how many calls and rounds it took.
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
        failure: Site | None,
        refusal: RuleError | None,
        outputs: Mapping[str, Node | Value],
        steps: int,
    ) -> None:
        self.name = name
        self.succeeded = failure is None
        self.refusal = refusal
        text, self.span = failure or ("", None)
        where = text + at(self.span)
        self.reason = None if failure is None else where if refusal is None else f"{where}: {refusal.message}"
        self.outputs = MappingProxyType(dict(outputs))
        self.steps = steps
        self.events: tuple[Firing, ...] = ()
        self._trace = trace

    def __bool__(self) -> bool:
        return self.succeeded

    @property
    def applications(self) -> int:
        """How many rules the run itself has applied."""
        return len(self._trace) // 2

    @property
    def matches(self) -> tuple[Match, ...]:
        """Where rules were applied, in order; the `definition` of each is the rule."""
        items = iter(self._trace)
        return tuple(Match(rule.model, rule.shape, row) for rule, row in zip(items, items, strict=True))

    @property
    def firings(self) -> tuple[Firing, ...]:
        """What was applied, for `Engine.replay`: by the run, then by event rules that fired at its end."""
        return (*firings(self._trace), *self.events)

    def __repr__(self) -> str:
        how = "succeeded" if self.succeeded else f"failed: {self.reason}"
        return f"<run of {self.name}: {self.applications} applications, {how}>"
