"""Find observations and rewards that read from objects which rules may delete, merge or retype during an episode.

A rule or condition that needs a deleted object just has no match, which is no error. But a path of an observation or
reward must begin at an existing object. Only in the last state of an episode may an observation lack its object.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from envgraph.behaviour._behaviour import (
    Action,
    Agent,
    Behaviour,
    EachStep,
    Effect,
    ObserveObject,
    ObservePath,
    OnFind,
    RuleCall,
)
from envgraph.behaviour._helper_patterns import mentioned_names
from envgraph.behaviour._rule_call_checks import signature_of
from envgraph.code import dataclass
from envgraph.errors import SHOWN, Diagnostic, EvaluationError, Note, Severity, Span, list_names
from envgraph.graph import Model
from envgraph.pattern import Expression, Navigation, Negation, Variable, base_of, children
from envgraph.rewrite import Engine, Loss

PRESENT_VERBS = {"delete": "deletes", "merge": "merges", "retype": "retypes"}
PAST_VERBS = {"delete": "deleted", "merge": "merged away", "retype": "retyped"}


@dataclass(frozen=True, slots=True)
class StepCall:
    """A call of a rule, with its position in a step.

    Attributes:
        is_before_rewards: True if it is executed before the step's conditions are evaluated and its rewards are summed.
        ends_episode: True if it is executed only when the episode ends.
    """

    call: RuleCall
    is_before_rewards: bool = False
    ends_episode: bool = False


@dataclass(frozen=True, slots=True)
class ObjectRead:
    """A read of an object's features by an observation or reward.

    Attributes:
        name: the name in the behaviour that stands for the object.
        what: "observation" or "reward".
        cls: the class that the name is declared with.
        is_always_evaluated: True if the clause may be evaluated in any step; False if only after a rule matched the
            object.
        callers: the calls after which the clause may be evaluated in the same episode.
    """

    name: str
    cls: str
    what: str
    span: Span | None
    is_always_evaluated: bool
    callers: tuple[StepCall, ...]


def read_variables(expression: Expression) -> Iterator[Variable]:
    """Yield the variables whose features an expression reads, in the order of the text."""
    if isinstance(expression, Navigation) and isinstance(expression.object, Variable):
        yield expression.object
    for part in children(expression):
        yield from read_variables(part)


def path_root(path: Expression) -> Variable:
    """Return the variable at the beginning of a path."""
    root = base_of(path)[0]
    assert isinstance(root, Variable)
    return root


def is_lost(model: Model, node: object, cls: str | None) -> bool:
    """Return True if an object is deleted, or is no longer an instance of `cls`."""
    if not isinstance(node, int) or not model.graph.alive(node):
        return True
    return cls is not None and not model.metamodel.is_a(model.graph.class_of(node), cls)


# --- reads, and the calls before them


def object_reads(behaviour: Behaviour) -> list[ObjectRead]:
    """Return all reads of observations and rewards from parameters, agents and parameters of actions."""
    shared = _step_calls(behaviour)
    resets = tuple(StepCall(branch.call) for reset in behaviour.resets for branch in reset.apply)
    everywhere = (*resets, *shared, *(one for agent in behaviour.agents for one in _step_calls(agent)))
    classes = {parameter.name: parameter.type or "" for parameter in behaviour.parameters}
    ending = _ending_parameters(behaviour)
    found: list[ObjectRead] = []
    owners: tuple[Behaviour | Agent, ...] = (behaviour, *behaviour.agents)
    for owner in owners:
        turn = (shared, _step_calls(owner)) if isinstance(owner, Agent) else (shared,)
        early = tuple(one for callers in turn for one in callers if one.is_before_rewards)
        own = {owner.variable: owner.cls} if isinstance(owner, Agent) else {}
        scope = _BlockScope(classes, own, everywhere, early, ending)
        found += scope.observed_reads(owner)
        for effect in owner.effects:
            found += scope.effect_reads(effect)
        steps = [effect for effect in (*behaviour.effects, *owner.effects) if isinstance(effect, EachStep)]
        by_itself = tuple(StepCall(branch.call, is_before_rewards=True) for step in steps for branch in step.apply)
        for action in owner.actions:
            found += scope.action_reads(action, by_itself)
    return found


def _step_calls(owner: Behaviour | Agent) -> tuple[StepCall, ...]:
    found = [StepCall(branch.call, is_before_rewards=True) for action in owner.actions for branch in action.branches]
    for effect in owner.effects:
        early = isinstance(effect, EachStep)
        ends = isinstance(effect, OnFind) and effect.end is not None
        found += [StepCall(branch.call, is_before_rewards=early, ends_episode=ends) for branch in effect.apply]
    return tuple(found)


def _ending_parameters(behaviour: Behaviour) -> set[str]:
    """Return the parameters whose loss ends the episode, because `on neg find p(x) terminate ..` names them."""
    return {
        name
        for effect in behaviour.effects
        if isinstance(effect, OnFind) and effect.end and isinstance(effect.condition, Negation)
        for name in mentioned_names(effect.condition)
    }


@dataclass(frozen=True, slots=True)
class _BlockScope:
    """A block (environment or agent): the classes of its names, all rule calls, and the calls before its rewards."""

    classes: Mapping[str, str]
    agent_class: Mapping[str, str]
    all_calls: Sequence[StepCall]
    early_calls: Sequence[StepCall]
    ending_parameters: set[str]

    def observed_reads(self, owner: Behaviour | Agent) -> Iterator[ObjectRead]:
        """Yield the reads of observations from parameters.

        Leave out `or none` observations, which have a value for a deleted object. Reads from the agent are left out
        too, because the observations of a deleted agent are not evaluated.
        """
        for observation in owner.observations:
            if not isinstance(observation, ObservePath):
                continue
            if isinstance(observation, ObserveObject) and observation.or_none:
                continue
            root = path_root(observation.path)
            if root.name in self.classes:
                callers = [
                    c
                    for c in self._non_ending_calls()
                    if not (c.is_before_rewards and root.name in self.ending_parameters)
                ]
                yield self._make_read(root, "observation", observation.path.span, callers)

    def effect_reads(self, effect: Effect) -> Iterator[ObjectRead]:
        """Yield the reads of an effect's reward, except from objects in the match of its condition, which exist."""
        sure: Collection[str] = ()
        if isinstance(effect, OnFind) and not isinstance(effect.condition, Negation):
            sure = mentioned_names(effect.condition)
        yield from self._reward_reads(effect.reward, sure)

    def action_reads(self, action: Action, each_step_calls: Sequence[StepCall]) -> Iterator[ObjectRead]:
        """Yield the reads of an action's `reward` (a rule matched) and `else_reward` (no rule matched).

        Args:
            each_step_calls: the calls of the `each step` clauses, which also precede the rewards of a step.
        """
        calls = [branch.call for branch in action.branches]
        narrow = (*(StepCall(call, is_before_rewards=True) for call in calls), *each_step_calls)
        given = [{a.name for a in call.arguments if isinstance(a, Variable)} for call in calls]
        matched = set.intersection(*given) if given else set()
        yield from self._reward_reads(action.reward, (), matched, narrow)
        yield from self._reward_reads(action.else_reward, ())
        domains = {name: domain.cls for name, domain in action.parameters if domain.cls}
        for root in read_variables(action.reward) if action.reward is not None else ():
            if root.name in domains:
                yield ObjectRead(root.name, domains[root.name], "reward", root.span, False, narrow)

    def _reward_reads(
        self,
        reward: Expression | None,
        safe_names: Collection[str],
        matched: Collection[str] = (),
        calls: Sequence[StepCall] = (),
    ) -> Iterator[ObjectRead]:
        for root in read_variables(reward) if reward is not None else ():
            if root.name in safe_names:
                continue
            if root.name in matched and root.name in {**self.classes, **self.agent_class}:
                yield self._make_read(root, "reward", root.span, calls, always=False)
            elif root.name in self.classes:
                yield self._make_read(root, "reward", root.span, self._non_ending_calls())
            elif root.name in self.agent_class:  # A deleted agent has no turn.
                yield self._make_read(root, "reward", root.span, self.early_calls, always=False)

    def _non_ending_calls(self) -> list[StepCall]:
        return [caller for caller in self.all_calls if not caller.ends_episode]

    def _make_read(
        self, root: Variable, what: str, span: Span | None, callers: Iterable[StepCall], always: bool = True
    ) -> ObjectRead:
        cls = {**self.classes, **self.agent_class}[root.name]
        return ObjectRead(root.name, cls, what, span, always, tuple(callers))


# --- checks before a model is known


def loss_warnings(behaviour: Behaviour, engine: Engine) -> Iterator[Diagnostic]:
    """Yield a warning for each clause that may read from an object that a rule may delete, merge or retype.

    If several observations read from the same object, only the first one is reported.
    """
    reported: set[tuple[str, str, Span | None]] = set()
    for reading in object_reads(behaviour):
        key = reading.name, reading.what, None if reading.what == "observation" else reading.span
        if key in reported or reading.cls not in engine.model.metamodel.classes:
            continue
        calls = [caller.call for caller in reading.callers]
        found = _losses(engine, behaviour, reading.name, reading.cls, calls)
        if not found:
            continue
        reported.add(key)
        names = list(dict.fromkeys(loss.rule.rpartition(".")[2] for loss in found))
        rules = f"rule{'s' if len(names) > 1 else ''} {list_names(names)}"
        message = f"{rules} may delete, merge or retype `{reading.name}`, which this {reading.what} reads"
        yield Diagnostic(
            "lost-object",
            message,
            reading.span,
            _hint(behaviour, reading.name, reading.what),
            Severity.WARNING,
            tuple(Note(_loss_note(loss), loss.span) for loss in found[: SHOWN.notes]),
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


def _loss_note(loss: Loss) -> str:
    return f"`{loss.rule.rpartition('.')[2]}` {PRESENT_VERBS[loss.action]} here"


def _hint(behaviour: Behaviour, name: str, what: str) -> str:
    known = {one.name for one in behaviour.parameters} | {one.variable for one in behaviour.agents}
    if name not in known:
        return "return the value in an `out` parameter of the rule"
    instead = f"keep `{name}` and set a flag"
    if what == "observation":
        return f"{instead}, or end the episode in the same step: `on neg find p({name}) terminate failure`"
    return f"{instead}, or reward a match that contains it: `on find p({name}) reward ..`"


# --- errors in an episode


def lost_object_error(
    engine: Engine,
    behaviour: Behaviour,
    name: str,
    cls: str | None,
    what: str,
    span: Span | None,
    calls: Sequence[RuleCall],
) -> EvaluationError:
    """Return the error of a clause (`what`: observation or reward) that reads from a deleted object.

    The message names the rules, among those called in this step so far (`calls`), that may have deleted the object.
    """
    found = _losses(engine, behaviour, name, cls, calls)
    if found:
        deeds = " or ".join(dict.fromkeys(PAST_VERBS[loss.action] for loss in found))
        who = " or ".join(dict.fromkeys(f"`{loss.rule.rpartition('.')[2]}`" for loss in found))
        message = f"rule {who} has {deeds} `{name}`, which this {what} reads"
    else:
        called = [f"`{call.rule}`" for call in calls]
        after = f" after {' and '.join(called)}" if called else ""
        message = f"`{name}` no longer exists{after}, but this {what} reads it"
    notes = tuple(Note(_loss_note(loss), loss.span) for loss in found[: SHOWN.notes])
    return EvaluationError(message, span, _hint(behaviour, name, what), notes)
