"""Find observations and rewards that read from objects which rules may delete, merge or retype during an episode.

A rule or condition that needs a deleted object just has no match, which is no error. But a path of an observation or
reward must begin at an existing object. Only in the last state of an episode may an observation lack its object.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from envgraph.behaviour._clauses import mentioned
from envgraph.behaviour._data import (
    Action,
    Agent,
    Behaviour,
    EachStep,
    Effect,
    ObserveFind,
    ObserveObject,
    OnFind,
    RuleCall,
)
from envgraph.behaviour._signatures import signature_of
from envgraph.code import dataclass
from envgraph.errors import SHOWN, Diagnostic, EvaluationError, Note, Severity, Span, listed
from envgraph.graph import Model
from envgraph.pattern import Expression, Navigation, Negation, Variable, children
from envgraph.rewrite import Engine, Loss

HERE = {"delete": "deletes", "merge": "merges", "retype": "retypes"}
PAST = {"delete": "deleted", "merge": "merged away", "retype": "retyped"}


@dataclass(frozen=True, slots=True)
class Caller:
    """A call of a rule, with its position in a step.

    Attributes:
        early: True if it is executed before the step's conditions are evaluated and its rewards are summed.
        ends: True if it is executed only when the episode ends.
    """

    call: RuleCall
    early: bool = False
    ends: bool = False


@dataclass(frozen=True, slots=True)
class Reading:
    """A read of an object's features by an observation or reward.

    Attributes:
        name: the name in the behaviour that stands for the object.
        what: "observation" or "reward".
        cls: the class that the name is declared with.
        always: True if the clause may be evaluated in any step; False if only after a rule matched the object.
        callers: the calls after which the clause may be evaluated in the same episode.
    """

    name: str
    cls: str
    what: str
    span: Span | None
    always: bool
    callers: tuple[Caller, ...]


def roots(expression: Expression) -> Iterator[Variable]:
    """Yield the variables whose features an expression reads, in the order of the text."""
    if isinstance(expression, Navigation) and isinstance(expression.object, Variable):
        yield expression.object
    for part in children(expression):
        yield from roots(part)


def root_of(path: Expression) -> Variable:
    """Return the variable at the beginning of a path."""
    while isinstance(path, Navigation):
        path = path.object
    assert isinstance(path, Variable)
    return path


def is_gone(model: Model, node: object, cls: str | None) -> bool:
    """Return True if an object is deleted, or is no longer an instance of `cls`."""
    if not isinstance(node, int) or not model.graph.alive(node):
        return True
    return cls is not None and not model.metamodel.is_a(model.graph.class_of(node), cls)


# --- reads, and the calls before them


def readings(behaviour: Behaviour) -> list[Reading]:
    """Return all reads of observations and rewards from parameters, agents and parameters of actions."""
    shared = _callers(behaviour)
    resets = tuple(Caller(branch.call) for reset in behaviour.resets for branch in reset.apply)
    everywhere = (*resets, *shared, *(one for agent in behaviour.agents for one in _callers(agent)))
    classes = {parameter.name: parameter.type or "" for parameter in behaviour.parameters}
    ending = _ending(behaviour)
    found: list[Reading] = []
    owners: tuple[Behaviour | Agent, ...] = (behaviour, *behaviour.agents)
    for owner in owners:
        turn = (shared, _callers(owner)) if isinstance(owner, Agent) else (shared,)
        early = tuple(one for callers in turn for one in callers if one.early)
        own = {owner.variable: owner.cls} if isinstance(owner, Agent) else {}
        scope = _Scope(classes, own, everywhere, early, ending)
        found += scope.observed(owner)
        for effect in owner.effects:
            found += scope.rewarded_effect(effect)
        steps = [effect for effect in (*behaviour.effects, *owner.effects) if isinstance(effect, EachStep)]
        by_itself = tuple(Caller(branch.call, early=True) for step in steps for branch in step.apply)
        for action in owner.actions:
            found += scope.rewarded_action(action, by_itself)
    return found


def _callers(owner: Behaviour | Agent) -> tuple[Caller, ...]:
    found = [Caller(branch.call, early=True) for action in owner.actions for branch in action.branches]
    for effect in owner.effects:
        early = isinstance(effect, EachStep)
        ends = isinstance(effect, OnFind) and effect.end is not None
        found += [Caller(branch.call, early=early, ends=ends) for branch in effect.apply]
    return tuple(found)


def _ending(behaviour: Behaviour) -> set[str]:
    """Return the parameters whose loss ends the episode, because `on neg find p(x) terminate ..` names them."""
    return {
        name
        for effect in behaviour.effects
        if isinstance(effect, OnFind) and effect.end and isinstance(effect.condition, Negation)
        for name in mentioned(effect.condition)
    }


@dataclass(frozen=True, slots=True)
class _Scope:
    """A block (environment or agent): the classes of its names, all rule calls, and the calls before its rewards."""

    classes: Mapping[str, str]
    own: Mapping[str, str]
    everywhere: Sequence[Caller]
    early: Sequence[Caller]
    ending: set[str]

    def observed(self, owner: Behaviour | Agent) -> Iterator[Reading]:
        """Yield the reads of observations from parameters.

        Leave out `or none` observations, which have a value for a deleted object. Reads from the agent are left out
        too, because the observations of a deleted agent are not evaluated.
        """
        for observation in owner.observations:
            if isinstance(observation, ObserveFind):
                continue
            if isinstance(observation, ObserveObject) and observation.or_none:
                continue
            root = root_of(observation.path)
            if root.name in self.classes:
                callers = [c for c in self._going_on() if not (c.early and root.name in self.ending)]
                yield self._reading(root, "observation", observation.path.span, callers)

    def rewarded_effect(self, effect: Effect) -> Iterator[Reading]:
        """Yield the reads of an effect's reward, except from objects in the match of its condition, which exist."""
        sure: Collection[str] = ()
        if isinstance(effect, OnFind) and not isinstance(effect.condition, Negation):
            sure = mentioned(effect.condition)
        yield from self._reward(effect.reward, sure)

    def rewarded_action(self, action: Action, by_itself: Sequence[Caller]) -> Iterator[Reading]:
        """Yield the reads of an action's `reward` (a rule matched) and `else_reward` (no rule matched).

        Args:
            by_itself: the calls of the `each step` clauses, which also precede the rewards of a step.
        """
        calls = [branch.call for branch in action.branches]
        narrow = (*(Caller(call, early=True) for call in calls), *by_itself)
        given = [{a.name for a in call.arguments if isinstance(a, Variable)} for call in calls]
        matched = set.intersection(*given) if given else set()
        yield from self._reward(action.reward, (), matched, narrow)
        yield from self._reward(action.else_reward, ())
        domains = {name: domain.cls for name, domain in action.parameters if domain.cls}
        for root in roots(action.reward) if action.reward is not None else ():
            if root.name in domains:
                yield Reading(root.name, domains[root.name], "reward", root.span, False, narrow)

    def _reward(
        self,
        reward: Expression | None,
        safe: Collection[str],
        matched: Collection[str] = (),
        narrow: Sequence[Caller] = (),
    ) -> Iterator[Reading]:
        for root in roots(reward) if reward is not None else ():
            if root.name in safe:
                continue
            if root.name in matched and root.name in {**self.classes, **self.own}:
                yield self._reading(root, "reward", root.span, narrow, always=False)
            elif root.name in self.classes:
                yield self._reading(root, "reward", root.span, self._going_on())
            elif root.name in self.own:  # A deleted agent has no turn.
                yield self._reading(root, "reward", root.span, self.early, always=False)

    def _going_on(self) -> list[Caller]:
        return [caller for caller in self.everywhere if not caller.ends]

    def _reading(
        self, root: Variable, what: str, span: Span | None, callers: Iterable[Caller], always: bool = True
    ) -> Reading:
        cls = {**self.classes, **self.own}[root.name]
        return Reading(root.name, cls, what, span, always, tuple(callers))


# --- checks before a model is known


def loss_warnings(behaviour: Behaviour, engine: Engine) -> Iterator[Diagnostic]:
    """Yield a warning for each clause that may read from an object that a rule may delete, merge or retype.

    If several observations read from the same object, only the first one is reported.
    """
    reported: set[tuple[str, str, Span | None]] = set()
    for reading in readings(behaviour):
        key = reading.name, reading.what, None if reading.what == "observation" else reading.span
        if key in reported or reading.cls not in engine.model.metamodel.classes:
            continue
        calls = [caller.call for caller in reading.callers]
        found = _losses(engine, behaviour, reading.name, reading.cls, calls)
        if not found:
            continue
        reported.add(key)
        rules = _rules(found)
        message = f"{rules} may delete, merge or retype `{reading.name}`, which this {reading.what} reads"
        yield Diagnostic(
            "lost-object",
            message,
            reading.span,
            _hint(behaviour, reading.name, reading.what),
            Severity.WARNING,
            tuple(Note(_deed(loss), loss.span) for loss in found[: SHOWN.notes]),
        )


def _losses(
    engine: Engine, behaviour: Behaviour, name: str, cls: str | None, calls: Iterable[RuleCall]
) -> tuple[Loss, ...]:
    """Return the actions of called rules that may delete, merge or retype the object called `name`, each once."""
    others = {parameter.name for parameter in behaviour.parameters} - {name}
    found: dict[Loss, None] = {}
    for call in calls:
        signature = signature_of(engine, call.rule) if call.rule is not None else None
        if call.rule is None or signature is None or len(signature.parameters) != len(call.arguments):
            continue
        known = {
            taken.name: argument.name == name
            for argument, taken in zip(call.arguments, signature.parameters, strict=True)
            if isinstance(argument, Variable) and argument.name in {name, *others}
        }
        found |= dict.fromkeys(engine.catalog.losses(call.rule, cls, known))
    return tuple(found)


def _rules(found: Iterable[Loss]) -> str:
    names = list(dict.fromkeys(loss.rule.rpartition(".")[2] for loss in found))
    return f"rule{'s' if len(names) > 1 else ''} {listed(names)}"


def _deed(loss: Loss) -> str:
    return f"`{loss.rule.rpartition('.')[2]}` {HERE[loss.deed]} here"


def _hint(behaviour: Behaviour, name: str, what: str) -> str:
    known = {one.name for one in behaviour.parameters} | {one.variable for one in behaviour.agents}
    if name not in known:
        return "return the value in an `out` parameter of the rule"
    instead = f"keep `{name}` and set a flag"
    if what == "observation":
        return f"{instead}, or end the episode in the same step: `on neg find p({name}) terminate failure`"
    return f"{instead}, or reward a match that contains it: `on find p({name}) reward ..`"


# --- errors in an episode


def lost(
    engine: Engine,
    behaviour: Behaviour,
    name: str,
    cls: str | None,
    what: str,
    span: Span | None,
    done: Sequence[RuleCall],
) -> EvaluationError:
    """Return the error of a clause (`what`: observation or reward) that reads from a deleted object.

    The message names the rules, among those called in this step so far (`done`), that may have deleted the object.
    """
    found = _losses(engine, behaviour, name, cls, done)
    if found:
        deeds = " or ".join(dict.fromkeys(PAST[loss.deed] for loss in found))
        who = " or ".join(dict.fromkeys(f"`{loss.rule.rpartition('.')[2]}`" for loss in found))
        message = f"rule {who} has {deeds} `{name}`, which this {what} reads"
    else:
        called = [f"`{call.rule}`" for call in done]
        after = f" after {' and '.join(called)}" if called else ""
        message = f"`{name}` no longer exists{after}, but this {what} reads it"
    notes = tuple(Note(_deed(loss), loss.span) for loss in found[: SHOWN.notes])
    return EvaluationError(message, span, _hint(behaviour, name, what), notes)
