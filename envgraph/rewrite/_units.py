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
from dataclasses import dataclass

from envgraph.errors import EvaluationError, RuleError
from envgraph.graph import Model
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
from envgraph.rewrite._control import alap, attempt, branch, choice, every, repeat, sequence
from envgraph.rewrite._match import Firing
from envgraph.rewrite._names import Signature
from envgraph.rewrite._run import MOST_LEVELS, Action, Environment, Run, apply_one, apply_one_of, note_refusal
from envgraph.rewrite._runner import GraphRule, RuleRunner
from envgraph.rewrite._unit_check import CheckedUnit, depth


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
                return sequence([self._action(inner) for inner in steps])
            case Choice(alternatives):
                weights = [self._preference(inner) for inner in alternatives]
                return choice([self._whole(inner) for inner in alternatives], weights)
            case Alap(body):
                return alap(self._whole(body))
            case Repeat(lower, upper, body):
                return repeat(lower, upper, self._whole(body))
            case Try(body, otherwise):
                return attempt(self._whole(body), self._action(otherwise) if otherwise else None)
            case If(_, then, otherwise):
                test = self._test(step)
                return branch(test, self._action(then), self._action(otherwise) if otherwise else None)
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
                return every([_every(rule, {}) for rule in members])
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
            rows = rule.live_rows()
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
            if rule.still_holds(row):
                try:
                    rule.fire(row)
                except RuleError as error:
                    note_refusal(run, error)
                    continue
                run.trace.append(Firing(rule.name, row))
                changed = True
        if changed:
            run.refusal = None
        return changed

    return apply
