"""Check a behaviour against a metamodel, patterns and rules, independently of any model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

from envgraph.behaviour._behaviour import Action, Agent, Behaviour, Domain, Effect, OnFind, OnRefused
from envgraph.behaviour._clause_checks import Scope, type_names
from envgraph.behaviour._helper_patterns import condition_helper, is_bound_by_match, names_after_condition
from envgraph.behaviour._key_bindings import NAMED_KEYS, key_code
from envgraph.behaviour._key_index import ranged_classes
from envgraph.behaviour._lost_objects import loss_warnings
from envgraph.behaviour._observation_checks import ViewChecks
from envgraph.behaviour._parameter_domains import domain_size, domain_type
from envgraph.behaviour._rule_call_checks import CallChecks
from envgraph.errors import (
    LIMITS,
    Diagnostic,
    Note,
    Severity,
    Span,
    did_you_mean,
    duplicate_diagnostics,
    has_errors,
    name_hint,
    scaled_limit,
    sort_diagnostics,
)
from envgraph.metamodel import Scalar
from envgraph.pattern import Constant, ObjectType, Parameter, PatternCall, StaticType, Variable, static_type
from envgraph.rewrite import Engine


def check_behaviour(behaviour: Behaviour, engine: Engine) -> list[Diagnostic]:
    """Return all errors and warnings of a behaviour, in the order of its text; one for each mistake.

    Args:
        behaviour: the behaviour as parsed.
        engine: provides metamodel, patterns and rules. Its model is ignored, and the engine is not changed.
    """
    behaviour = engine.library.with_functions_resolved(behaviour)
    checker = _BehaviourChecker(engine, [])
    checker.check(behaviour)
    if not has_errors(checker.problems):
        checker.problems += loss_warnings(behaviour, engine)
    unknown = {problem.subject for problem in checker.problems if problem.code == "unknown-variable"}
    once = [problem for problem in checker.problems if problem.code != "used-once" or problem.subject not in unknown]
    return sort_diagnostics([_add_agent_hint(problem, behaviour) for problem in once])


def _add_agent_hint(problem: Diagnostic, behaviour: Behaviour) -> Diagnostic:
    """Return the problem with a better hint if an agent's variable is used outside of its block."""
    for agent in behaviour.agents:
        if problem.code == "unknown-variable" and problem.subject == (agent.variable,):
            return replace(problem, hint=f"use `{agent.variable}` only in its `agent` block")
    return problem


class _BehaviourChecker(CallChecks, ViewChecks):
    """A checker of a whole behaviour, which collects diagnostics in `problems`."""

    def check(self, behaviour: Behaviour) -> None:
        """Check all clauses of the behaviour."""
        scope: Scope = {**dict.fromkeys(behaviour.unread), **self._check_parameters(behaviour.parameters)}
        first: dict[str, Span | None] = {}
        self._keyed_actions: dict[int, str] = {}
        self.float_ranges = {}
        self.counted = [one for one in ranged_classes(behaviour, self.metamodel) if one in self.metamodel.classes]
        self.draw, handled = behaviour.draw, any(isinstance(effect, OnRefused) for effect in behaviour.effects)
        self.handles_refusals = handled
        self._check_clauses(behaviour, scope, first)
        for reset in behaviour.resets:
            self._check_effect(reset.as_effect, scope)
        for agent in behaviour.agents:
            self.handles_refusals = handled or any(isinstance(effect, OnRefused) for effect in agent.effects)
            self._check_agent(agent, scope, first)
        self._check_agents_disjoint(behaviour.agents)
        if not behaviour.together:  # else an observation has a part for each agent
            self.check_float_places(behaviour)
        if not behaviour.unread:
            self._check_completeness(behaviour)
        if behaviour.draw is not None:
            self.check_drawing(behaviour.draw, scope)

    # --- the whole and its parts

    def _check_completeness(self, behaviour: Behaviour) -> None:
        span = behaviour.span
        if behaviour.together and not behaviour.agents:
            place, hint = (behaviour.together_span or span, "write `agent name : Class { .. }`, or leave it out")
            self.report("no-agents", "`agents together` needs `agent` blocks, but there are none", place, hint)
        agents = behaviour.agents or (None,)
        for agent in agents:
            if not (behaviour.actions or (agent and agent.actions)):
                who, place = self._name_and_span(behaviour, agent)
                hint = "write `action name = rule(..)`"
                self.report("no-actions", f"{who} has no actions", place, hint)
        if not behaviour.can_succeed:
            message = f"environment `{behaviour.name}` never ends in success"
            hint = "write `on find .. terminate success`"
            self.report("no-success", message, span, hint, Severity.WARNING)
        for agent in agents:
            if not (behaviour.observations or (agent and agent.observations)):
                who, place = self._name_and_span(behaviour, agent)
                message = f"{who if agent else f'the agent of `{behaviour.name}`'} observes nothing"
                self.report("no-observation", message, place, "write `observe ..`", Severity.WARNING)
        most = scaled_limit("attempts")
        if behaviour.limit is not None and not 1 <= behaviour.limit <= most:
            message = f"`limit` is {behaviour.limit} steps, but must be from 1 to {most:,}"
            hint = "write fewer, or set ENVGRAPH_LIMITS=10" if behaviour.limit else "write 1 or more"
            self.report("empty-range", message, behaviour.limit_span or span, hint)

    @staticmethod
    def _name_and_span(behaviour: Behaviour, agent: Agent | None) -> tuple[str, Span | None]:
        """Return name and span of an agent for messages; those of the behaviour if `agent` is None."""
        if agent is None:
            return f"environment `{behaviour.name}`", behaviour.span
        return f"agent `{agent.variable}`", agent.span

    def _check_parameters(self, parameters: Iterable[Parameter]) -> Scope:
        scope: Scope = {}
        named = ((one.name, one.span) for one in parameters)
        self.problems += duplicate_diagnostics(named, "parameter `{}` is defined twice")
        for parameter in parameters:
            if parameter.name not in scope:
                scope[parameter.name] = self.parameter_class(parameter)
        return scope

    def _check_agent(self, agent: Agent, outer: Scope, shared: Mapping[str, Span | None]) -> None:
        scope = dict(outer)
        if scope.get(agent.variable) is not None:
            self.report(
                "duplicate-definition", f"`{agent.variable}` is already a parameter", agent.span, "choose another name"
            )
        scope[agent.variable] = self.check_class(agent.cls, agent.cls_span or agent.span)
        self._check_clauses(agent, scope, dict(shared))

    def _check_agents_disjoint(self, agents: Sequence[Agent]) -> None:
        """Report agent blocks of the same name or with overlapping classes: an object may belong to one block only."""
        named = ((agent.variable, agent.span) for agent in agents)
        self.problems += duplicate_diagnostics(named, "agent `{}` is defined twice")
        for other, agent in combinations(agents, 2):
            known = {agent.cls, other.cls} <= set(self.metamodel.classes)
            if known and agent.variable != other.variable and self.metamodel.may_overlap(agent.cls, other.cls):
                message = f"an object of `{agent.cls}` may already be the agent `{other.variable}`"
                notes = (Note("the first one is here", other.cls_span or other.span),)
                span = agent.cls_span or agent.span
                hint = "put the clauses into one block: an object can be only one agent"
                self.report("duplicate-agent", message, span, hint, notes=notes)

    def _check_clauses(self, owner: Behaviour | Agent, scope: Scope, first_actions: dict[str, Span | None]) -> None:
        """Check the clauses of a behaviour or agent, and add its actions with their spans to `first_actions`."""
        total = 0
        named = [(action.name, action.span) for action in owner.actions]
        self.problems += duplicate_diagnostics(named, "action `{}` is defined twice", first=first_actions)
        first_actions |= {name: span for name, span in reversed(named) if name not in first_actions}
        for action in owner.actions:
            total += self._check_action(action, scope)
        if total > LIMITS["actions"]:
            message = f"there are {total} actions, but at most {LIMITS['actions']} are possible"
            self.report("too-many-actions", message, owner.span, "give its actions fewer parameters, or smaller ranges")
        for effect in owner.effects:
            self._check_effect(effect, scope)
        for observation in {one.span or id(one): one for one in owner.observations}.values():  # one for all literals
            self.check_observation(observation, scope)

    # --- actions

    def _check_action(self, action: Action, outer: Scope) -> int:
        """Check an action; return the number of actions that it expands to, as far as known without a model."""
        scope = dict(outer)
        count = 1
        spans: Sequence[Span | None] = action.parameter_spans or [action.span] * len(action.parameters)
        names = [name for name, _ in action.parameters]
        self.problems += duplicate_diagnostics(zip(names, spans, strict=True), "parameter `{}` is defined twice")
        for number, ((name, domain), span) in enumerate(zip(action.parameters, spans, strict=True)):
            if name not in names[:number] and outer.get(name) is not None:
                hint = "choose another name for the parameter of the action"
                self.report("duplicate-definition", f"`{name}` is a parameter of the environment", span, hint)
            type_ = self._check_domain(domain)
            scope[name] = None if name in outer else type_
            count *= domain_size(domain, self.metamodel)
        self.action = action
        outputs = self.check_branches(action.branches, scope)
        self.action = None
        self.check_rewards(action, scope, outputs)
        self._check_keys(action, count)
        return count

    def _check_keys(self, action: Action, count: int) -> None:
        """Report keys that are unknown or used twice, and a number of keys that does not fit `count` actions."""
        types = [domain_type(domain, self.metamodel) for _, domain in action.parameters]
        is_open, number = any(isinstance(one, ObjectType) for one in types), len(action.keys)
        if action.keys_span and (number == 0 or (number % max(count, 1) and not is_open)):
            wanted = "1 or more" if count == 1 else f"{count}, or a multiple of it"
            message = f"the number of keys is {number}, but must be {wanted}: one for each action of `{action.name}`"
            self.report("bad-annotation", message, action.keys_span, "write a key for each, in the order of the values")
        spans: Sequence[Span | None] = action.key_spans or [action.keys_span] * number
        for key, span in zip(action.keys, spans, strict=True):
            code = key_code(key)
            if code is None:
                names = f'write a character, such as "a" or " ", or one of {", ".join(NAMED_KEYS)}'
                hint = did_you_mean(key, NAMED_KEYS) or names
                self.report("bad-annotation", f"unknown key `{key}`", span, hint)
            elif code in self._keyed_actions:
                message = f"the key `{key}` is already a key of `{self._keyed_actions[code]}`"
                self.report("bad-annotation", message, span, "choose another key")
            else:
                self._keyed_actions[code] = action.name

    def _check_domain(self, domain: Domain) -> StaticType | None:
        name = domain.enum or domain.cls
        if name is None:
            if domain.low > domain.high:
                message = f"the range {domain.low}..{domain.high} is empty"
                self.report("empty-range", message, domain.span, f"write `{domain.high}..{domain.low}`")
            return Scalar.INT
        type_ = domain_type(domain, self.metamodel)
        if type_ is None:
            known = [*self.metamodel.enums, *self.metamodel.classes]
            scalar = static_type(name, self.metamodel)
            message = f"unknown enum or class `{name}`" if scalar is None else f"`{name}` is not an enum or class"
            hint = name_hint(name, known) if scalar is None else "write a range: `lo..hi`"
            self.report("unknown-type", message, domain.span, hint)
        return type_

    # --- effects

    def _check_effect(self, effect: Effect, scope: Scope) -> None:
        if isinstance(effect, OnFind):
            scope = {**scope, **self._check_condition(effect, scope)}
            self.check_reward(effect.weight, scope)
            if isinstance(effect.weight, Constant) and isinstance(low := effect.weight.value, int | float) and low < 0:
                hint = "write a number of at least 0; with `weight 1` all matches are equally likely"
                self.report("wrong-weight", f"the weight is {low}, which is below 0", effect.weight.span, hint)
        self.check_reward(effect.reward, scope)
        self.check_branches(effect.apply, scope)

    def _check_condition(self, effect: OnFind, scope: Scope) -> Scope:
        """Check a condition; return the types of the variables that its matches bind."""
        condition = effect.condition
        question = condition_helper("#check", condition, type_names(scope))
        sound = self.check_helper(question, condition, scope, names_after_condition(effect))
        return self._matched_types(condition, scope, sound) if isinstance(condition, PatternCall) else {}

    def _matched_types(self, call: PatternCall, scope: Scope, sound: bool) -> Scope:
        types: Sequence[StaticType | None] = [None] * len(call.arguments)
        called = self.library.resolve(call.pattern)
        if sound and called is not None:
            types = self.library.parameter_types(called.qualified_name)
        return {
            term.name: type_
            for term, type_ in zip(call.arguments, types, strict=True)
            if isinstance(term, Variable) and is_bound_by_match(term, scope)
        }
