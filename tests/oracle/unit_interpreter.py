"""Units, step by step: what the generated functions of units are compared with.

It only asks what people can ask an engine (matches, applications at a match, transactions), copies the whole
environment for each block, and draws as the documentation says: nothing where there is no choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import fsum
from random import Random

from envgraph.errors import InvalidArgument, RuleError
from envgraph.graph import Node
from envgraph.metamodel import Value
from envgraph.pattern import (
    Alap,
    Applicable,
    AtomicStep,
    Check,
    Comparison,
    Constraint,
    Expression,
    IfStep,
    Negation,
    PatternCall,
    Repeat,
    Step,
    StepSequence as Steps,
    TryStep,
    TypeConstraint,
    Unit,
    UnitCall,
    UnitChoice,
    Variable,
    check_holds,
    evaluate,
    required_paths,
    value_of,
)
from envgraph.rewrite import Engine, Firing, Match

Names = dict[str, Value]
REFUSED = {"containment", "dangling", "full", "identification", "lost-link", "multiplicity"}


class Failure(Exception):
    """A step has failed."""


class Interpreter:
    """Runs units of an engine.

    Attributes:
        trace: what was applied.
    """

    def __init__(self, engine: Engine, seed: int) -> None:
        self.engine = engine
        self.random = Random(seed)
        self.trace: list[Firing] = []

    def run(self, unit: str, **arguments: Value) -> bool:
        """Run a unit; whether it succeeded."""
        try:
            self._unit(unit, dict(arguments))
        except Failure:
            return False
        return True

    def _unit(self, name: str, names: Names) -> bool:
        unit = self.engine.definition(name)
        assert isinstance(unit, Unit)
        return self._step(unit.body, names)

    def _step(self, step: Step, names: Names) -> bool:
        """Whether anything has changed.

        Raises:
            Failure: the step has failed.
        """
        match step:
            case Steps(steps):
                return any([self._step(inner, names) for inner in steps])
            case UnitCall():
                return self._call(step, names)
            case AtomicStep(body):
                return self._whole(body, names)
            case Alap(body):
                return self._alap(body, names)
            case Repeat():
                return self._repeat(step, names)
            case TryStep(body, otherwise):
                try:
                    return self._whole(body, dict(names))
                except Failure:
                    return otherwise is not None and self._step(otherwise, dict(names))
            case IfStep(condition, then, otherwise):
                if self._asked(condition, names):
                    return self._step(then, dict(names))
                return otherwise is not None and self._step(otherwise, dict(names))
            case UnitChoice(alternatives):
                return self._choice(alternatives, names)

    def _whole(self, step: Step, names: Names) -> bool:
        length = len(self.trace)
        try:
            with self.engine.transaction():
                return self._step(step, names)
        except Failure:
            del self.trace[length:]
            raise

    def _alap(self, body: Step, names: Names) -> bool:
        changed = False
        try:
            while self._whole(body, dict(names)):
                changed = True
        except Failure:
            pass
        return changed

    def _repeat(self, step: Repeat, names: Names) -> bool:
        changed = False
        lower, upper = self._bound(step.lower, names), self._bound(step.upper, names)
        for done in range(lower + self._draw(upper - lower + 1)):
            try:
                changed |= self._whole(step.body, dict(names))
            except Failure:
                if done < lower:
                    raise
                break
        return changed

    def _bound(self, bound: int | Expression, names: Names) -> int:
        return bound if isinstance(bound, int) else int(self._value(bound, names))

    def _value(self, expression: Expression, names: Names) -> Value:
        if any(evaluate(path, names, self._read) is None for path in required_paths(expression)):
            raise Failure
        value = evaluate(expression, names, self._read)
        if value is None:
            raise Failure
        return value

    def _choice(self, alternatives: Sequence[Step], names: Names) -> bool:
        left = [self._preferred(step) for step in alternatives]
        while left:
            highest = max(priority for priority, _, _ in left)
            best = [entry for entry in left if entry[0] == highest]
            chosen = best[self._weighted([weight for _, weight, _ in best])]
            try:
                return self._whole(chosen[2], dict(names))
            except Failure:
                left = [entry for entry in left if entry is not chosen]
        raise Failure

    def _preferred(self, step: Step) -> tuple[int, float, Step]:
        if isinstance(step, UnitCall):
            signature = self.engine.signature(step.name)
            return signature.priority, signature.weight, step
        return 0, 1.0, step

    # --- calls

    def _call(self, call: UnitCall, names: Names) -> bool:
        signature = self.engine.signature(call.name)
        given: Names = {}
        wanted: dict[str, str] = {}
        for argument, parameter in zip(call.arguments, signature.parameters, strict=False):
            if isinstance(argument, Variable):
                if argument.name in names:
                    given[parameter.name] = names[argument.name]
                elif not argument.name.startswith("_"):
                    wanted[argument.name] = parameter.name
            else:
                given[parameter.name] = self._value(argument, names)
        if signature.kind == "unit":
            changed = self._unit(call.name, given)
            names.update({own: given[theirs] for own, theirs in wanted.items()})
            return changed
        if signature.kind == "group":
            return self._group(call)
        matches = self._chosen(call, call.name, given, names)
        if call.every:
            return self._every(matches)
        done = self._one(matches, call.first)
        names.update({own: done[theirs] for own, theirs in wanted.items()})
        return True

    def _group(self, call: UnitCall) -> bool:
        members = self.engine.group(call.name)
        if call.every:
            return self._every([match for member in members for match in self.engine.matches(member)])
        left = [member for member in members if self.engine.exists(member)]
        while left:
            member = left[self._weighted([self.engine.signature(each).weight for each in left])]
            try:
                self._one(self.engine.matches(member), False)
            except Failure:
                left.remove(member)
            else:
                return True
        raise Failure

    def _chosen(self, call: UnitCall, rule: str, given: Names, names: Names) -> list[Match]:
        shape = self.engine.prepare(rule).shape
        for name, value in given.items():
            if name not in shape.names:
                return []
            if shape.is_object(shape.position(name)) and not self.engine.model.graph.alive(int(value)):
                return []
        found = self.engine.matches(rule, **given)
        for condition in call.where:
            found = [match for match in found if self._holds(condition, {**names, **_plain(match)})]
        if call.by is not None:
            values = [(match, value_of(call.by, {**names, **_plain(match)}, self._read)) for match in found]
            ranked = sorted((pair for pair in values if pair[1] is not None), key=lambda pair: -pair[1])
            found = [match for match, _ in ranked][: call.limit]
        return found

    def _one(self, matches: list[Match], first: bool) -> Names:
        while matches:
            match = matches.pop(0 if first else self._draw(len(matches)))
            done = self._apply(match)
            if done is not None:
                return done
        raise Failure

    def _every(self, matches: list[Match]) -> bool:
        changed = False
        for match in matches:
            if self.engine.prepare(match.definition).is_match(match.row):
                changed |= self._apply(match) is not None
        if not changed:
            raise Failure
        return True

    def _apply(self, match: Match) -> Names | None:
        try:
            done = self.engine.apply(match.definition, match)
        except RuleError as error:
            if error.reason in REFUSED:
                return None
            raise
        assert done is not None
        self.trace.append(done.firing)
        outputs = {name: value.id if isinstance(value, Node) else value for name, value in done.outputs.items()}
        return {**_plain(match), **outputs}

    # --- conditions and chance

    def _asked(self, condition: Constraint | Applicable, names: Names) -> bool:
        match condition:
            case Negation(TypeConstraint(rule, Variable() as term)) if rule in self.engine.rules:
                condition = Applicable(rule, (term,), True)
            case TypeConstraint(rule, Variable() as term) if rule in self.engine.rules:
                condition = Applicable(rule, (term,))
        if not isinstance(condition, Applicable):
            return self._holds(condition, names)
        signature = self.engine.signature(condition.name)
        given: Names = {}
        for argument, parameter in zip(condition.arguments, signature.parameters, strict=False):
            assert isinstance(argument, Variable)
            if argument.name in names:
                given[parameter.name] = names[argument.name]
        try:
            members = self.engine.group(condition.name)
            found = any(self.engine.exists(one, applicable=True, bound=given) for one in members)
        except InvalidArgument:  # an object that was deleted
            found = False
        return found is not condition.negated

    def _holds(self, condition: Constraint, names: Names) -> bool:
        if isinstance(condition, Check):
            return check_holds(condition.expression, names, self._read)
        if isinstance(condition, Negation):
            return not self._holds(condition.relation, names)
        if isinstance(condition, Comparison):
            left, right = (int(names[side.name]) for side in (condition.left, condition.right))  # type: ignore[union-attr]
            alive = self.engine.model.graph.alive(left) and self.engine.model.graph.alive(right)
            return alive and (left == right) is (condition.operator == "==")
        if isinstance(condition, TypeConstraint):
            node = int(names[condition.term.name])  # type: ignore[union-attr]
            return self.engine.model.graph.alive(node) and self.engine.model.graph.class_of(node) == condition.type
        assert isinstance(condition, PatternCall)
        _, parameters = self.engine.catalog.pattern_parameters(condition.pattern)
        bound = {
            parameter: names[argument.name]
            for parameter, argument in zip(parameters, condition.arguments, strict=True)
            if isinstance(argument, Variable) and argument.name in names
        }
        try:
            return self.engine.exists(condition.pattern, **bound)
        except InvalidArgument:  # an object that was deleted
            return False

    def _read(self, node: int, feature: str) -> Value | None:
        if not self.engine.model.graph.alive(node):
            return None
        value: object = self.engine.model.node(node)[feature]
        return value.id if isinstance(value, Node) else value  # type: ignore[return-value]

    def _draw(self, count: int) -> int:
        return int(self.random.random() * count) if count > 1 else 0

    def _weighted(self, weights: Sequence[float]) -> int:
        if len(weights) == 1:
            return 0
        point = self.random.random() * fsum(weights)
        for number, weight in enumerate(weights):
            point -= weight
            if point < 0:
                return number
        return len(weights) - 1


def _plain(match: Match) -> Names:
    return dict(zip(match.names, match.row, strict=True))
