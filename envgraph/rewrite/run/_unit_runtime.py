"""The state of a run of a unit, and functions that generated units call for rare or long tasks.

The outcome of a step is None if the step failed, else True or False: whether it changed anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import field
from math import fsum
from typing import Any, Final, NoReturn

from envgraph.code import dataclass
from envgraph.errors import RAISE_LIMIT_HINT, EvaluationError, RuleError, Span
from envgraph.graph import Model, Savepoint
from envgraph.metamodel import Attribute, Value
from envgraph.pattern import Expression, evaluate, explain_error, required_paths
from envgraph.rewrite._choice_enumeration import Branches
from envgraph.rewrite._matches import Firing, Row
from envgraph.rewrite.run._rule_runner import REFUSALS, Randomness, RuleRunner, drawn_others

Environment = dict[str, Value]

StepDescription = tuple[str, Span | None]
"""A description of a step and its span, for messages."""

Unset = type("Unset", (), {"__slots__": (), "__repr__": lambda self: "UNSET"})
UNSET: Final = Unset()
"""The value of an `out` parameter of a unit that is not bound yet."""


@dataclass(slots=True)
class UnitRun:
    """The state of one run of a unit.

    Attributes:
        steps: number of steps left.
        limit: number of steps at the beginning.
        trace: applications in order, as a flat list (a rule, its match, a rule, its match ..), since it may be long.
        refusal: the refusal of the last failed application, if the last step failed because of it; else None.
        failure: text and span of the step that failed last.
        levels: number of nested steps, including those of called units.
        gaps: numbers of applications after which something other than a rule changed the model: see `Trace`.
        open_savepoints: savepoints of the running steps that are undone if they fail.
        ordered: True if matches are sorted before one is drawn.
    """

    model: Model
    rng: Randomness
    steps: int
    limit: int
    trace: list[Any] = field(default_factory=list)
    refusal: RuleError | None = None
    failure: StepDescription = "", None
    levels: int = 0
    gaps: list[int] = field(default_factory=list)
    open_savepoints: list[Savepoint] = field(default_factory=list)
    pick: Callable[[int], int] = field(init=False)
    record: Callable[[Any], None] = field(init=False)
    ordered: bool = field(init=False)

    def __post_init__(self) -> None:
        self.ordered = isinstance(self.rng, Branches)
        self.record = self.trace.append
        self.pick = _index_drawer(self.rng)

    @property
    def firings(self) -> list[Firing]:
        """Return the applications in order."""
        return firings(self.trace)

    def count_step(self, call_site: StepDescription | None = None) -> None:
        """Count one step, described by `call_site` in the error message.

        Raises:
            EvaluationError: the step limit is exceeded.
        """
        self.steps -= 1
        if self.steps < 0:
            raise_step_limit(self, call_site)

    def whole(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Run a step, and undo its changes and remove its applications if it fails. Return its outcome."""
        savepoint, length, gaps = self.model.graph.history.savepoint(), len(self.trace), len(self.gaps)
        self.open_savepoints.append(savepoint)
        outcome = function(self, *arguments)
        # No `finally`: after an exception, perhaps by an exhausted stack, `undo_all` closes the open savepoints.
        self.open_savepoints.pop()
        if outcome is None:
            self.model.graph.history.rollback(savepoint)
            del self.trace[length:], self.gaps[gaps:]
        else:
            self.model.graph.history.release(savepoint)
        return outcome

    def undo_all(self) -> None:
        """Undo the changes of all running steps after an exception."""
        if self.open_savepoints:
            interrupted = self.model.graph.store.interrupted_writes
            interrupted.append(self.open_savepoints[0])
            interrupted.repair()
            self.open_savepoints.clear()


def format_span(span: Span | None) -> str:
    """Format a span as ` (span)`, or "" for None."""
    return f" ({span})" if span else ""


def firings(trace: Sequence[Any]) -> list[Firing]:
    """Convert a flat trace to a list of firings."""
    items = iter(trace)
    return [Firing(rule.name, row) for rule, row in zip(items, items, strict=True)]


def _index_drawer(rng: Randomness) -> Callable[[int], int]:
    if isinstance(rng, Branches):
        return rng.choose
    random = rng.random
    return lambda count: int(random() * count)


def raise_step_limit(run: UnitRun, call_site: StepDescription | None) -> NoReturn:
    """Raise the error that the step limit is reached; `call_site` is the loop or call that took the last step."""
    name, span = call_site or ("", None)
    where = f", the last one in {name}" if name else ""
    message = f"the run took more than {run.limit} steps{where}; it may never end"
    cure = "make the unit terminate"
    if idle := _idle_rule(run):
        message += f": rule `{idle}`, applied last, changes nothing if it is applied once more"
        cure = f"let the `lhs` of `{idle}` match only where the rule changes something"
    raise EvaluationError(message, span, f"{cure}, or set `step_limit` of the engine; {RAISE_LIMIT_HINT}")


def _idle_rule(run: UnitRun) -> str | None:
    """Return the name of the rule that was applied last if it changes nothing when applied there once more, else None.

    The changes of the run are undone after the step limit is reached, so this trial may change the model.
    """
    if not run.trace:
        return None
    rule, row = run.trace[-2:]
    store = run.model.graph.store
    if not rule.is_deterministic or not rule.still_holds(row):
        return None
    before = store.hash_sum
    with suppress(RuleError, EvaluationError):
        rule.fire(row)
        if store.hash_sum == before:
            return str(rule.name)
    return None


def record_refusal(run: UnitRun, error: RuleError) -> None:
    """Record that the model refused an application. Raise errors that are no refusals."""
    if error.reason not in REFUSALS:
        raise error
    run.refusal = error


# --- calls


def fire_one(run: UnitRun, rule: RuleRunner, rows: Sequence[Row]) -> tuple[Row, Sequence[Any]] | None:
    """Apply a rule at a random row, and after refusals at others. Return the row and the slots of the rule.

    Return None if there are no rows, or if the rule is refused at all rows; `run` then stores the last refusal.
    """
    if not rows:
        return None
    number = run.pick(len(rows)) if len(rows) > 1 else 0
    row = rows[number]
    try:
        result = rule.fire(row)
    except RuleError as error:
        return _fire_at_others(run, rule, drawn_others(rows, number, run.pick), error)
    return row, result


def _fire_at_others(
    run: UnitRun, rule: RuleRunner, rows: Iterable[Row], error: RuleError
) -> tuple[Row, Sequence[Any]] | None:
    """Apply a refused rule at the first of the other rows at which it is not refused. Return this row and the slots.

    Return None if there is no such row; `run` then stores the last refusal.
    """
    try:
        return rule.fire_next(rows, error)
    except RuleError as refused:
        record_refusal(run, refused)
        return None


def call_rule(
    run: UnitRun, rule: RuleRunner, rows: Sequence[Row], missing: StepDescription, refused: StepDescription
) -> Sequence[Any] | None:
    """Apply a rule at a random match, record the application, and return its slots. Return None if the call fails.

    The failure is `missing` if there is no match, and `refused` if the rule is refused at each match.
    """
    if not rows:
        return _record_call(run, rule, None, missing)
    number = run.pick(len(rows)) if len(rows) > 1 else 0
    row = rows[number]
    try:
        result = rule.fire(row)
    except RuleError as error:
        return _record_call(run, rule, _fire_at_others(run, rule, drawn_others(rows, number, run.pick), error), refused)
    put = run.record
    put(rule)
    put(row)
    return result


def call_first(
    run: UnitRun,
    rule: RuleRunner,
    row: Row | None,
    rows: Callable[[], Iterable[Row]],
    missing: StepDescription,
    refused: StepDescription,
) -> Sequence[Any] | None:
    """Apply a rule at its first match `row`, record the application, and return its slots; None if the call fails.

    After a refusal, the later matches of `rows` are tried. `missing` and `refused` are as for `call_rule`.
    """
    if row is None:
        return _record_call(run, rule, None, missing)
    found: tuple[Row, Sequence[Any]] | None
    try:
        found = row, rule.fire(row)
    except RuleError as error:
        left = list(rows())
        found = _fire_at_others(run, rule, left[left.index(row) + 1 :], error)
    return _record_call(run, rule, found, refused)


def _record_call(
    run: UnitRun, rule: RuleRunner, found: tuple[Row, Sequence[Any]] | None, failure: StepDescription
) -> Sequence[Any] | None:
    if found is None:
        run.failure = failure
        return None
    run.record(rule)
    run.record(found[0])
    return found[1]


def fire_every(run: UnitRun, rule: RuleRunner, rows: Iterable[Row], call_site: StepDescription) -> bool | None:
    """Apply a rule at each of the rows, except rows that are no match any more or at which it is refused.

    Return True if the rule was applied at all, else None. Each row counts as a step.
    """
    changed = None
    for row in rows:
        run.steps -= 1
        if run.steps < 0:
            raise_step_limit(run, call_site)
        if rule.still_holds(row):
            try:
                rule.fire(row)
            except RuleError as error:
                record_refusal(run, error)
                continue
            run.record(rule)
            run.record(row)
            changed = True
    if changed:
        run.refusal = None
    return changed


def fire_one_of(run: UnitRun, rules: Sequence[RuleRunner]) -> tuple[RuleRunner, Row, Sequence[Any]] | None:
    """Draw a rule by weight among those with a match, and apply it at a random match; after a refusal, draw again.

    Return the rule, the row and the slots; None if no rule can be applied.
    """
    left = [rule for rule in rules if rule.exists()]
    while left:
        rule = left[draw_weighted(run.rng, [rule.weight for rule in left])]
        rows = rule.live_rows()
        found = fire_one(run, rule, sorted(rows) if run.ordered else rows)
        if found is not None:
            return rule, *found
        left = [other for other in left if other is not rule]
    return None


def apply_one_of(run: UnitRun, rules: Sequence[RuleRunner], call_site: StepDescription | None = None) -> bool | None:
    """Apply one rule of a group as a step, and record it: see `fire_one_of`. Return True, or None if this fails."""
    run.count_step(call_site)
    run.refusal = None
    found = fire_one_of(run, rules)
    if found is None:
        return None
    run.refusal = None
    run.record(found[0])
    run.record(found[1])
    return True


def apply_every_of(run: UnitRun, rules: Sequence[RuleRunner], call_site: StepDescription) -> bool | None:
    """Apply all rules of a group at all of their current matches. Return True if any was applied, else None."""
    run.count_step(call_site)
    run.refusal = None
    changed = None
    for rule, rows in [(rule, list(rule.all_rows())) for rule in rules]:
        changed = fire_every(run, rule, sorted(rows) if run.ordered else rows, call_site) or changed
    if changed:
        run.refusal = None
    return changed


def rows_bound_by(
    prepare: Callable[[tuple[str, ...]], Callable[..., Any]], names: Sequence[str], values: Sequence[Any]
) -> Any:
    """Return the matches that agree with all values that are set. `prepare` is that method, or `seek`, of a rule."""
    given = {name: value for name, value in zip(names, values, strict=True) if value is not UNSET}
    return prepare(tuple(given))(*given.values())


def is_applicable(run: UnitRun, rule: RuleRunner, values: Mapping[str, Any]) -> bool:
    """Return True if a rule is applicable at a match that agrees with the values that are set.

    Return False if a value is None or a deleted object.
    """
    given = {name: value for name, value in values.items() if value is not UNSET}
    for name, value in given.items():
        if value is None or (rule.shape.is_object(rule.shape.position(name)) and not rule.model.graph.alive(value)):
            return False
    rows = list(rule.rows_unchecked(given))
    return any(map(rule.is_applicable, sorted(rows) if run.ordered else rows))


# --- choices

Tier = tuple[tuple[Callable[..., Any], ...], tuple[float, ...]]
"""Alternatives of a choice with the same priority, and their weights."""


def run_one_of(run: UnitRun, tiers: Sequence[Tier], *arguments: Any) -> bool | None:
    """Try alternatives until one succeeds: tier by tier, and in each tier in random order by weight.

    Return the outcome of this alternative, or None if all fail. Then the first refusal is recorded as the reason.
    """
    refusal = None
    for alternatives, weights in tiers:
        left, heavy = list(alternatives), list(weights)
        while left:
            number = draw_weighted(run.rng, heavy) if len(left) > 1 else 0
            outcome: bool | None = left[number](run, *arguments)
            if outcome is not None:
                return outcome
            refusal = refusal or run.refusal
            del left[number], heavy[number]
    run.refusal = refusal
    return None


def draw_weighted(rng: Randomness, weights: Sequence[float]) -> int:
    """Return a random index, with probabilities proportional to the weights. For a single weight no number is drawn."""
    if len(weights) == 1:
        return 0
    if isinstance(rng, Branches):
        return rng.weigh(weights)
    point = rng.random() * fsum(weights)
    for number, weight in enumerate(weights):
        point -= weight
        if point < 0:
            return number
    return len(weights) - 1  # reached only by rounding errors


def largest_first(rows: Sequence[Row], value: Callable[[Row], Any], limit: int | None) -> list[Row]:
    """Return the rows with the largest values, largest first, at most `limit` if it is set. None values are left out.

    Rows with equal values keep their order.
    """
    valued = [(found, row) for row in rows if (found := value(row)) is not None]
    valued.sort(key=lambda pair: pair[0], reverse=True)  # the sort is stable even with `reverse`
    return [row for _, row in valued[:limit]]


def argument_value(
    expression: Expression,
    values: Mapping[str, Any],
    read: Callable[[int, str], Value | None],
    call_site: StepDescription,
) -> Value | None:
    """Return the value of an argument or bound, described by `call_site`, or None if a path in it has no value.

    Raises:
        EvaluationError: division by zero, overflow, or a function outside its domain.
    """
    if any(evaluate(path, values, read) is None for path in required_paths(expression)):
        return None
    try:
        return evaluate(expression, values, read)
    except EvaluationError as error:
        name, span = call_site
        found = explain_error(error, expression, values, read, span, "write `if check {} {{ .. }}` around it")
        raise EvaluationError(f"{name} has no value: {found.message}", found.span, found.hint) from None


def draw_rounds(run: UnitRun, lower: int, upper: int, span: Span | None) -> int:
    """Return a random number of rounds from `lower` to `upper`, two computed bounds.

    Raises:
        EvaluationError: the upper bound is below the lower bound, or the lower bound is below 0.
    """
    if not 0 <= lower <= upper:
        hint = "write the lower bound first; it must be at least 0"
        raise EvaluationError(f"cannot repeat {lower}..{upper} times", span, hint)
    return lower + (run.pick(upper - lower + 1) if upper > lower else 0)


def read_feature(model: Model, node: int, feature: str) -> Value | None:
    """Return the value or target of a single-valued feature; None if the object was deleted or lacks it."""
    if not model.graph.alive(node):
        return None
    found = model.metamodel.feature(model.graph.class_of(node), feature)
    if found is None:
        return None
    return model.graph.value(node, found) if isinstance(found, Attribute) else model.graph.target(node, found)
