"""One run of a unit: its limits, what it leaves open, and what generated units call for what is seldom or long.

A step that is run gives None if it fails, else whether it has changed anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field
from math import fsum
from typing import Any, Final, NoReturn

from envgraph.code import dataclass
from envgraph.errors import RAISE_LIMIT, EvaluationError, RuleError, Span
from envgraph.graph import Model, Savepoint
from envgraph.metamodel import Attribute, Value
from envgraph.pattern import Expression, evaluate, explained, navigations
from envgraph.rewrite._branches import Branches
from envgraph.rewrite._match import Firing, Row
from envgraph.rewrite.run._runner import REFUSALS, Randomness, RuleRunner, others

STEP_LIMIT: Final = 100_000
"""How many calls and rounds one run may take, unless told otherwise."""

MOST_RUNNING: Final = 200
"""How deep the steps of a run may nest, those of called units included; Python's own stack ends beyond it."""

Environment = dict[str, Value]

Site = tuple[str, Span | None]
"""A step, for messages: what it is called, and where it is written."""

Unset = type("Unset", (), {"__slots__": (), "__repr__": lambda self: "UNSET"})
UNSET: Final = Unset()
"""Stands for an `out` parameter of a unit that has no value yet."""


@dataclass(slots=True)
class Run:
    """The state of one run of a unit.

    Attributes:
        steps: how many are left.
        trace: what was applied, in order: a rule, its match, a rule, its match ... Flat, because it may be long.
        refusal: why the model refused the last application that failed, if that is why the last step failed.
        failure: which step failed last and why, and where it is written.
        gaps: after so many applications something that was no rule changed the model: see `Trace`.
        opened: savepoints of the steps under way that leave nothing behind if they fail.
        ordered: whether matches are put in the order of what they stand for before one is drawn.
    """

    model: Model
    rng: Randomness
    steps: int
    limit: int
    trace: list[Any] = field(default_factory=list)
    refusal: RuleError | None = None
    failure: Site = "", None
    levels: int = 0
    gaps: list[int] = field(default_factory=list)
    opened: list[Savepoint] = field(default_factory=list)
    pick: Callable[[int], int] = field(init=False)
    put: Callable[[Any], None] = field(init=False)
    ordered: bool = field(init=False)

    def __post_init__(self) -> None:
        self.ordered = isinstance(self.rng, Branches) and self.rng.ordered
        self.put = self.trace.append
        self.pick = _picker(self.rng)

    @property
    def firings(self) -> list[Firing]:
        """What was applied, in order."""
        return firings(self.trace)

    def count(self, site: Site | None = None) -> None:
        """One more step; `site` says which.

        Raises:
            EvaluationError: that is one too many.
        """
        self.steps -= 1
        if self.steps < 0:
            spent(self, site)

    def whole(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Run a step that leaves nothing behind if it fails."""
        savepoint, length, gaps = self.model.graph.history.savepoint(), len(self.trace), len(self.gaps)
        self.opened.append(savepoint)
        outcome = function(self, *arguments)
        # Not in a `finally`: what an exception leaves open is closed by `abandon`, where the stack is not exhausted.
        self.opened.pop()
        if outcome is None:
            self.model.graph.history.rollback(savepoint)
            del self.trace[length:], self.gaps[gaps:]
        else:
            self.model.graph.history.release(savepoint)
        return outcome

    def abandon(self) -> None:
        """Take back what every open step has done, after an exception."""
        if self.opened:
            interrupted = self.model.graph.store.interrupted
            interrupted.append(self.opened[0])
            interrupted.repair()
            self.opened.clear()


def at(span: Span | None) -> str:
    """Return where something is written, if it is."""
    return f" ({span})" if span else ""


def firings(trace: Sequence[Any]) -> list[Firing]:
    """The applications of a flat trace."""
    items = iter(trace)
    return [Firing(rule.name, row) for rule, row in zip(items, items, strict=True)]


def _picker(rng: Randomness) -> Callable[[int], int]:
    if isinstance(rng, Branches):
        return rng.choose
    random = rng.random
    return lambda count: int(random() * count)


def spent(run: Run, site: Site | None) -> NoReturn:
    """The step limit is reached; `site` is the loop or the call that took the last step.

    Raises:
        EvaluationError: always.
    """
    name, span = site or ("", None)
    where = f"; it was in {name}" if name else ""
    message = f"the run took more than {run.limit} steps{where}: it may never end"
    raise EvaluationError(message, span, f"else set `step_limit` of the engine; {RAISE_LIMIT}")


def note_refusal(run: Run, error: RuleError) -> None:
    """The model has refused an application; anything else ends the run."""
    if error.reason not in REFUSALS:
        raise error
    run.refusal = error


# --- calls


def fire_one(run: Run, rule: RuleRunner, rows: Sequence[Row]) -> tuple[Row, Sequence[Any]] | None:
    """Apply a rule at one of the rows, drawn uniformly; if that is refused, at one of the others."""
    if not rows:
        return None
    number = run.pick(len(rows)) if len(rows) > 1 else 0
    row = rows[number]
    try:
        result = rule.fire(row)
    except RuleError as error:
        return _go_on(run, rule, others(rows, number, run.pick), error)
    return row, result


def _go_on(
    run: Run, rule: RuleRunner, rows: Iterable[Row], error: RuleError
) -> tuple[Row, Sequence[Any]] | None:
    """A rule was refused: apply it at the first of these rows at which it is not."""
    try:
        return rule.fire_next(rows, error)
    except RuleError as refused:
        note_refusal(run, refused)
        return None


def call_rule(
    run: Run, rule: RuleRunner, rows: Sequence[Row], missing: Site, refused: Site
) -> Sequence[Any] | None:
    """A call of a rule at one of its matches: `fire_one`, written out because calls are many."""
    if not rows:
        return _called(run, rule, None, missing)
    number = run.pick(len(rows)) if len(rows) > 1 else 0
    row = rows[number]
    try:
        result = rule.fire(row)
    except RuleError as error:
        return _called(run, rule, _go_on(run, rule, others(rows, number, run.pick), error), refused)
    put = run.put
    put(rule)
    put(row)
    return result


def call_first(
    run: Run,
    rule: RuleRunner,
    row: Row | None,
    rows: Callable[[], Iterable[Row]],
    missing: Site,
    refused: Site,
) -> Sequence[Any] | None:
    """A call of a rule at the first of its matches, if there is one; `rows` lists them all, where that is refused."""
    if row is None:
        return _called(run, rule, None, missing)
    found: tuple[Row, Sequence[Any]] | None
    try:
        found = row, rule.fire(row)
    except RuleError as error:
        left = list(rows())
        found = _go_on(run, rule, left[left.index(row) + 1 :], error)
    return _called(run, rule, found, refused)


def _called(
    run: Run, rule: RuleRunner, found: tuple[Row, Sequence[Any]] | None, failure: Site
) -> Sequence[Any] | None:
    if found is None:
        run.failure = failure
        return None
    run.put(rule)
    run.put(found[0])
    return found[1]


def fire_every(run: Run, rule: RuleRunner, rows: Iterable[Row], site: Site) -> bool | None:
    """Apply a rule at each of the rows that still is a match when its turn comes and is not refused."""
    changed = None
    for row in rows:
        run.steps -= 1
        if run.steps < 0:
            spent(run, site)
        if rule.still_holds(row):
            try:
                rule.fire(row)
            except RuleError as error:
                note_refusal(run, error)
                continue
            run.put(rule)
            run.put(row)
            changed = True
    if changed:
        run.refusal = None
    return changed


def fire_one_of(run: Run, rules: Sequence[RuleRunner]) -> tuple[RuleRunner, Row, Sequence[Any]] | None:
    """Draw a rule by weight among those that match, and apply it at one of its matches; go on if that is refused."""
    left = [rule for rule in rules if rule.exists()]
    while left:
        rule = left[draw_weighted(run.rng, [rule.weight for rule in left])]
        rows = rule.live_rows()
        found = fire_one(run, rule, sorted(rows) if run.ordered else rows)
        if found is not None:
            return rule, *found
        left = [other for other in left if other is not rule]
    return None


def apply_one_of(run: Run, rules: Sequence[RuleRunner], site: Site | None = None) -> bool | None:
    """`fire_one_of` as a step."""
    run.count(site)
    run.refusal = None
    found = fire_one_of(run, rules)
    if found is None:
        return None
    run.refusal = None
    run.put(found[0])
    run.put(found[1])
    return True


def apply_every_of(run: Run, rules: Sequence[RuleRunner], site: Site) -> bool | None:
    """`fire_every` of the rules of a group, at the matches that all of them have now."""
    run.count(site)
    run.refusal = None
    changed = None
    for rule, rows in [(rule, list(rule.all_rows())) for rule in rules]:
        changed = fire_every(run, rule, sorted(rows) if run.ordered else rows, site) or changed
    if changed:
        run.refusal = None
    return changed


def rows_bound_by(
    prepare: Callable[[tuple[str, ...]], Callable[..., Any]], names: Sequence[str], values: Sequence[Any]
) -> Any:
    """The matches that agree with those of the values that are set, as `prepare` or `seek` of the rule gives them."""
    given = {name: value for name, value in zip(names, values, strict=True) if value is not UNSET}
    return prepare(tuple(given))(*given.values())


def is_applicable(rule: RuleRunner, values: Mapping[str, Any]) -> bool:
    """Return whether a rule is applicable at one of the matches that agree with those of the values that are set.

    What has no value, or was deleted, has no match.
    """
    given = {name: value for name, value in values.items() if value is not UNSET}
    for name, value in given.items():
        if value is None or (
            rule.shape.is_object(rule.shape.position(name)) and not rule.model.graph.alive(value)
        ):
            return False
    return any(map(rule.is_applicable, list(rule.rows_known(given))))


# --- choice

Tier = tuple[tuple[Callable[..., Any], ...], tuple[float, ...]]
"""Alternatives of one priority, and their weights."""


def run_one_of(run: Run, tiers: Sequence[Tier], *arguments: Any) -> bool | None:
    """Try alternatives until one succeeds, tier by tier, in a tier drawn by weight.

    The refusal of any of them is a reason for all of them to fail.
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
    """A number from 0, with probabilities in proportion to the weights; without a choice nothing is drawn."""
    if len(weights) == 1:
        return 0
    if isinstance(rng, Branches):
        return rng.weigh(weights)
    point = rng.random() * fsum(weights)
    for number, weight in enumerate(weights):
        point -= weight
        if point < 0:
            return number
    return len(weights) - 1  # rounding


def best(rows: Sequence[Row], value: Callable[[Row], Any], limit: int | None) -> list[Row]:
    """The rows with the largest values, in that order, ties as they come; rows without a value are left out."""
    valued = [(found, row) for row in rows if (found := value(row)) is not None]
    valued.sort(key=lambda pair: pair[0], reverse=True)  # stable, reversed or not
    return [row for _, row in valued[:limit]]


def argument_value(
    expression: Expression, values: Mapping[str, Any], read: Callable[[int, str], Value | None], site: Site
) -> Value | None:
    """The value of an argument or a bound, or None if a path in it has none; `site` is what it is, and where.

    Raises:
        EvaluationError: division by zero, overflow, a function outside its domain.
    """
    if any(evaluate(path, values, read) is None for path in navigations(expression)):
        return None
    try:
        return evaluate(expression, values, read)
    except EvaluationError as error:
        name, span = site
        found = explained(error, expression, values, read, span, "write `if check {} {{ .. }}` around it")
        raise EvaluationError(f"{name} has no value: {found.message}", found.span, found.hint) from None


def rounds(run: Run, lower: int, upper: int, span: Span | None) -> int:
    """A number of rounds between two bounds that were worked out.

    Raises:
        EvaluationError: the upper one is below the lower one, or the lower one below 0.
    """
    if not 0 <= lower <= upper:
        hint = "the lower bound comes first, and is at least 0"
        raise EvaluationError(f"cannot repeat {lower}..{upper} times", span, hint)
    return lower + (run.pick(upper - lower + 1) if upper > lower else 0)


def read_feature(model: Model, node: int, feature: str) -> Value | None:
    """A single-valued feature of an object, for `evaluate`; one that was deleted has none."""
    if not model.graph.alive(node):
        return None
    found = model.metamodel.feature(model.graph.class_of(node), feature)
    if found is None:
        return None
    return model.graph.value(node, found) if isinstance(found, Attribute) else model.graph.target(node, found)
