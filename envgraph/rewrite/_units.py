"""Control units, made into functions.

A step *fails* or *succeeds*; a step that succeeds may have changed the model or not. Where Henshin has a unit for it,
the meaning is Henshin's with `strict` and without `rollback`; `atomic` and `try` are where a failure takes things back.

- A call of a rule applies it at one of its matches, drawn uniformly. If the model refuses the application there (a
  dangling link, a full reference ...), the other matches are tried in random order; the call fails if none is left. A
  call of a group draws a rule by weight among those that match, and goes on with the others likewise.
- `a; b;` runs the steps in order and fails at the first that fails; what was done before stays.
- `a | b` tries the alternatives, those of the highest `@priority` first, among equals drawn by `@weight`, until one
  succeeds; an alternative that fails leaves nothing behind. It fails if all do.
- `alap` repeats its body as long as that succeeds and changes something; the last, failing round leaves nothing
  behind. It never fails.
- `repeat n..m` draws a number of rounds. The first that fails ends it and leaves nothing behind; the step fails if
  fewer than n have succeeded then.
- `try` never fails by itself: a body that fails is taken back, and `else` runs, which may fail.
- `if` runs one branch; without a branch to run it succeeds.
- `atomic` takes everything back if its body fails, and fails then.
- `all rule` applies the rule at each of its matches of now that still is one when its turn comes and is not refused;
  it fails if there is none.
- A failed evaluation, a conflict between the matches of a `forall`, an exception in a Python rule, more steps than
  the limit: these end the whole run with the exception, and everything is taken back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from envgraph.errors import EvaluationError, RuleError
from envgraph.graph import Model, Savepoint
from envgraph.match import Matcher
from envgraph.metamodel import Attribute, Value
from envgraph.pattern import (
    Alap,
    Atomic,
    Call,
    Check,
    Choice,
    Expression,
    If,
    Repeat,
    Step,
    Try,
    Variable,
    evaluate,
    holds,
)
from envgraph.pattern import (
    Sequence as Steps,
)
from envgraph.rewrite._match import Firing, Row
from envgraph.rewrite._names import Signature
from envgraph.rewrite._runner import GraphRule, Randomness, RuleRunner, draw
from envgraph.rewrite._unit_check import CheckedUnit, depth

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


@dataclass(frozen=True, slots=True)
class UnitProgram:
    """A unit that is ready to run: its parameters are given in `environment`, where its `out` ones are found then."""

    name: str
    signature: Signature
    weight: float
    priority: int
    levels: int
    action: Action

    def run(self, run: Run, environment: Environment) -> bool | None:
        """Run it inside of a run."""
        run.count()
        run.levels += self.levels
        if run.levels > MOST_LEVELS:
            raise EvaluationError(
                f"more than {MOST_LEVELS} steps inside each other; `{self.name}` is one that calls on"
            )
        outcome = self.action(run, environment)
        run.levels -= self.levels
        return outcome


class UnitBuilder:
    """Makes functions of the steps of one checked unit.

    Args:
        checked: a unit without errors.
        rules, units: everything that can be called, by qualified name; units may be added until the first run.
        group: the members of a group.
    """

    def __init__(
        self,
        checked: CheckedUnit,
        rules: Mapping[str, RuleRunner],
        units: Mapping[str, UnitProgram],
        group: Callable[[str], tuple[str, ...]],
        model: Model,
        matcher: Matcher,
    ) -> None:
        self.checked = checked
        self.rules = rules
        self.units = units
        self.group = group
        self.model = model
        self.matcher = matcher

    def build(self, signature: Signature) -> UnitProgram:
        """The unit as a program."""
        unit = self.checked.unit
        action = self._action(unit.body)
        return UnitProgram(signature.name, signature, unit.weight, unit.priority, depth(unit.body), action)

    def _action(self, step: Step) -> Action:
        match step:
            case Call():
                return self._call(step)
            case Steps(steps):
                return _sequence([self._action(inner) for inner in steps])
            case Choice(alternatives):
                weights = [self._preference(inner) for inner in alternatives]
                return _choice([self._whole(inner) for inner in alternatives], weights)
            case Alap(body):
                return _alap(self._whole(body))
            case Repeat(lower, upper, body):
                return _repeat(lower, upper, self._whole(body))
            case Try(body, otherwise):
                return _try(self._whole(body), self._action(otherwise) if otherwise else None)
            case If(_, then, otherwise):
                test = self._test(step)
                return _if(test, self._action(then), self._action(otherwise) if otherwise else None)
            case Atomic(body):
                return self._whole(body)

    def _whole(self, step: Step) -> Action:
        """The step, so that it leaves nothing behind if it fails; a rule never does."""
        action = self._action(step)
        while isinstance(step, Steps) and len(step.steps) == 1:
            step = step.steps[0]
        if isinstance(step, Atomic) or (
            isinstance(step, Call) and self.checked.calls[id(step)].kind != "unit"
        ):
            return action
        return lambda run, environment: run.whole(action, environment)

    def _preference(self, step: Step) -> tuple[int, float]:
        if isinstance(step, Call):
            callee = self.checked.calls[id(step)]
            return callee.priority, callee.weight
        return 0, 1.0

    # --- calls

    def _call(self, call: Call) -> Action:
        callee = self.checked.calls[id(call)]
        arguments, outputs = self._bindings(call, callee)
        if callee.kind == "unit":
            return self._call_unit(callee.name, arguments, outputs)
        if callee.kind == "group":
            members = [self.rules[name] for name in self.group(callee.name)]
            if call.every:
                return _sequence_of_all([_every(rule, {}) for rule in members])
            return lambda run, environment: apply_one_of(run, members)
        rule = self.rules[callee.name]
        return _every(rule, arguments) if call.every else _apply(rule, arguments, outputs)

    def _bindings(self, call: Call, callee: Signature) -> tuple[dict[str, _Evaluate], dict[str, str]]:
        """What each parameter gets; and the variable that each `out` parameter may give a value to."""
        arguments: dict[str, _Evaluate] = {}
        outputs: dict[str, str] = {}
        for argument, parameter in zip(call.arguments, callee.parameters, strict=False):
            if isinstance(argument, Variable) and argument.name.startswith("_"):
                continue
            if isinstance(argument, Variable) and parameter.output:
                outputs[parameter.name] = argument.name
            else:
                arguments[parameter.name] = self._evaluate(argument)
        return arguments, outputs

    def _evaluate(self, expression: Expression) -> _Evaluate:
        if isinstance(expression, Variable):
            name = expression.name
            return lambda environment: environment[name]
        return lambda environment: evaluate(expression, environment, self._read)

    def _read(self, node: int, feature: str) -> Value | None:
        return read_feature(self.model, node, feature)

    def _call_unit(self, name: str, arguments: Mapping[str, _Evaluate], outputs: Mapping[str, str]) -> Action:
        def call(run: Run, environment: Environment) -> bool | None:
            inner = _evaluated(arguments, environment)
            outcome = None if inner is None else self.units[name].run(run, inner)
            if outcome is not None and inner is not None:
                environment.update({own: inner[theirs] for theirs, own in outputs.items() if theirs in inner})
            return outcome

        return call

    # --- conditions

    def _test(self, step: If) -> Callable[[Environment], bool]:
        if isinstance(step.condition, Check):
            expression = step.condition.expression
            return lambda environment: holds(expression, environment, self._read)
        condition = self.checked.conditions[id(step)]
        exists, name = self.matcher.exists, condition.pattern.qualified_name
        names, wanted = condition.arguments, not condition.negated
        return lambda environment: exists(name, tuple(environment[name] for name in names)) is wanted


_Evaluate = Callable[[Environment], "Value | None"]


def read_feature(model: Model, node: int, feature: str) -> Value | None:
    """A single-valued feature of an object, for `evaluate`."""
    found = model.metamodel.feature(model.class_of(node), feature)
    if found is None:
        return None
    return model.value(node, found) if isinstance(found, Attribute) else model.target(node, found)


def _evaluated(arguments: Mapping[str, _Evaluate], environment: Environment) -> Environment | None:
    """The arguments of a call; None if one has no value: then nothing matches."""
    values: Environment = {}
    for name, value_of in arguments.items():
        value = value_of(environment)
        if value is None:
            return None
        values[name] = value
    return values


# --- applying rules


def apply_one(run: Run, rule: RuleRunner, rows: Sequence[Row]) -> tuple[Row, Sequence[object]] | None:
    """Apply a rule at one of the rows, drawn uniformly; if that is refused, at one of the others."""
    left = list(rows) if len(rows) > 1 else rows
    while left:
        number = draw(run.rng, len(left))
        row = left[number]
        try:
            result = rule.fire(row)
        except RuleError as error:
            _note_refusal(run, error)
            left = [*left[:number], *left[number + 1 :]]
            continue
        run.refusal = None
        run.trace.append(Firing(rule.name, row))
        return row, result
    return None


def _note_refusal(run: Run, error: RuleError) -> None:
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
        if apply_one(run, rule, rule.all_rows()) is not None:
            return True
        left = [other for other in left if other is not rule]
    return None


def draw_weighted(rng: Randomness, weights: Sequence[float]) -> int:
    """A number from 0, with probabilities in proportion to the weights; without a choice nothing is drawn."""
    if len(weights) == 1:
        return 0
    point = rng.random() * sum(weights)
    for number, weight in enumerate(weights):
        point -= weight
        if point < 0:
            return number
    return len(weights) - 1  # rounding


def _apply(rule: RuleRunner, arguments: Mapping[str, _Evaluate], outputs: Mapping[str, str]) -> Action:
    slots = dict(rule.plan.outputs) if isinstance(rule, GraphRule) else {}
    names = tuple(arguments)
    find = rule.prepare(names) if not outputs else None
    alive = rule.model.alive
    objects = _objects(rule, names)

    def apply(run: Run, environment: Environment) -> bool | None:
        run.count()
        run.refusal = None
        if find is not None and not names:
            rows = find()
        else:
            bound = _evaluated(arguments, environment)
            if bound is None or not all(alive(bound[name]) for name in objects):  # type: ignore[arg-type]
                return None
            # An `out` argument that has a value already is a condition.
            bound.update({theirs: environment[own] for theirs, own in outputs.items() if own in environment})
            rows = find(*bound.values()) if find else rule.prepare(tuple(bound))(*bound.values())
        found = apply_one(run, rule, rows)
        if found is None:
            return None
        for theirs, own in outputs.items():
            environment[own] = found[1][slots[theirs]]  # type: ignore[assignment]
        return True

    return apply


def _objects(rule: RuleRunner, names: Sequence[str]) -> tuple[str, ...]:
    """Those of the variables that stand for objects: one that was deleted has no match."""
    return tuple(name for name in names if rule.shape.is_object(rule.shape.position(name)))


def _every(rule: RuleRunner, arguments: Mapping[str, _Evaluate]) -> Action:
    names = tuple(arguments)
    find = rule.prepare(names)
    alive = rule.model.alive
    objects = _objects(rule, names)

    def apply(run: Run, environment: Environment) -> bool | None:
        run.count()
        run.refusal = None
        bound = _evaluated(arguments, environment)
        if bound is None or not all(alive(bound[name]) for name in objects):  # type: ignore[arg-type]
            return None
        changed = None
        for row in list(find(*bound.values())):
            run.count()
            if rule.is_match(row):
                try:
                    rule.fire(row)
                except RuleError as error:
                    _note_refusal(run, error)
                    continue
                run.trace.append(Firing(rule.name, row))
                changed = True
        if changed:
            run.refusal = None
        return changed

    return apply


# --- control


def _sequence(actions: Sequence[Action]) -> Action:
    if len(actions) == 1:
        return actions[0]

    def sequence(run: Run, environment: Environment) -> bool | None:
        changed = False
        for action in actions:
            outcome = action(run, environment)
            if outcome is None:
                return None
            changed |= outcome
        return changed

    return sequence


def _sequence_of_all(actions: Sequence[Action]) -> Action:
    def every(run: Run, environment: Environment) -> bool | None:
        outcomes = [action(run, environment) for action in actions]
        return True if any(outcomes) else None

    return every


def _choice(actions: Sequence[Action], preferences: Sequence[tuple[int, float]]) -> Action:
    def choice(run: Run, environment: Environment) -> bool | None:
        left = list(range(len(actions)))
        while left:
            highest = max(preferences[number][0] for number in left)
            best = [number for number in left if preferences[number][0] == highest]
            chosen = best[draw_weighted(run.rng, [preferences[number][1] for number in best])]
            outcome = actions[chosen](run, dict(environment))
            if outcome is not None:
                return outcome
            left.remove(chosen)
        return None

    return choice


def _alap(action: Action) -> Action:
    def alap(run: Run, environment: Environment) -> bool | None:
        changed = False
        while True:
            run.count()
            outcome = action(run, dict(environment))
            if not outcome:
                run.refusal = None
                return changed
            changed = True

    return alap


def _repeat(lower: int, upper: int, action: Action) -> Action:
    def repeat(run: Run, environment: Environment) -> bool | None:
        changed = False
        for done in range(lower + draw(run.rng, upper - lower + 1)):
            run.count()
            outcome = action(run, dict(environment))
            if outcome is None:
                return None if done < lower else changed
            changed |= outcome
        return changed

    return repeat


def _try(action: Action, otherwise: Action | None) -> Action:
    def attempt(run: Run, environment: Environment) -> bool | None:
        outcome = action(run, dict(environment))
        if outcome is not None:
            return outcome
        run.refusal = None
        return False if otherwise is None else otherwise(run, dict(environment))

    return attempt


def _if(test: Callable[[Environment], bool], then: Action, otherwise: Action | None) -> Action:
    def branch(run: Run, environment: Environment) -> bool | None:
        if test(environment):
            return then(run, dict(environment))
        return False if otherwise is None else otherwise(run, dict(environment))

    return branch
