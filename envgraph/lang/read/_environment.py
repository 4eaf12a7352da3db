"""Convert the syntax trees of `.environment` files to behaviours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lark import Token, Tree

from envgraph.behaviour import Action, Agent, Behaviour, Domain, Effect, Observation
from envgraph.lang.read._environment_clauses import (
    action_of,
    drawing_of,
    each_step_of,
    observation_of,
    on_find_of,
    on_reset_of,
)
from envgraph.lang.read._query import parameters_of, suppressions_in
from envgraph.lang.read._query_header import DefinitionsFile, name_of, read_definitions
from envgraph.lang.read._reading import Reading, TypeNames, type_of, type_span_of
from envgraph.lang.syntax._parsing import Parsed, tokens, trees
from envgraph.metamodel import Metamodel

_OUTSIDE = {
    "reset": "on reset",
    "agent": "agent",
    "together": "agents together",
    "limit": "limit",
    "draw_grid": "draw",
    "draw_graph": "draw",
}
"""Clauses that are not allowed in an `agent` block, with their keywords."""


_MISSING = "missing-environment", "the file defines no environment", "write `environment Name { ... }`"


def read_environment(parsed: Parsed, types: TypeNames | None = None) -> DefinitionsFile[Behaviour]:
    """Return the behaviours of a parsed `.environment` file, also incomplete ones, with its header and diagnostics."""
    return read_definitions(parsed, types, _behaviour, keep=True, missing=_MISSING)


def with_enums(behaviour: Behaviour, metamodel: Metamodel) -> Behaviour:
    """Return a copy of the behaviour where each action parameter that names an enum has `enum` set instead of `cls`."""

    def distinguished(actions: tuple[Action, ...]) -> tuple[Action, ...]:
        return tuple(
            replace(
                action,
                parameters=tuple(
                    (name, _distinguished(domain, metamodel)) for name, domain in action.parameters
                ),
            )
            for action in actions
        )

    agents = tuple(replace(agent, actions=distinguished(agent.actions)) for agent in behaviour.agents)
    return replace(behaviour, actions=distinguished(behaviour.actions), agents=agents)


def _distinguished(domain: Domain, metamodel: Metamodel) -> Domain:
    return replace(domain, cls=None, enum=domain.cls) if domain.cls in metamodel.enums else domain


def _behaviour(reading: Reading, _: str, tree: Tree[Token]) -> Behaviour:
    name = name_of(tree)
    clauses = _clauses(tree)
    drawing = reading.only("`draw`", trees(clauses, "draw_grid", "draw_graph"))
    limit = reading.only("`limit`", trees(clauses, "limit"))
    together = reading.only("`agents together`", trees(clauses, "together"))
    behaviour = Behaviour(
        name=str(name),
        parameters=parameters_of(reading, tree),
        actions=_actions(reading, clauses),
        effects=_effects(reading, clauses),
        resets=tuple(filter(None, (on_reset_of(reading, part) for part in trees(clauses, "reset")))),
        observations=_observations(reading, clauses),
        agents=tuple(_agent(reading, part) for part in trees(clauses, "agent")),
        together=together is not None,
        limit=int(tokens(limit.children)[0]) if limit else None,
        draw=drawing_of(reading, drawing) if drawing else None,
        annotations=suppressions_in(reading, tree),
        doc=reading.parsed.doc(tree),
        span=reading.span(name),
        limit_span=reading.span(limit) if limit else None,
        together_span=reading.span(together) if together else None,
    )
    return replace(behaviour, unread=reading.all_lost() | {str(name)}) if reading.broken(tree) else behaviour


def _agent(reading: Reading, tree: Tree[Token]) -> Agent:
    name = name_of(tree)
    type_ = trees(tree.children, "type")[0]
    clauses = _clauses(tree)
    for clause in trees(clauses, *_OUTSIDE):
        word = _OUTSIDE[str(clause.data)]
        hint = "move it out of the `agent` block"
        reading.error(
            "misplaced-clause",
            f"`{word}` applies to the whole environment, not to an agent",
            clause,
            hint,
        )
    return Agent(
        variable=str(name),
        cls=type_of(reading, type_),
        actions=_actions(reading, clauses),
        effects=_effects(reading, clauses),
        observations=_observations(reading, clauses),
        span=reading.span(name),
        cls_span=type_span_of(reading, type_),
    )


def _clauses(tree: Tree[Token]) -> list[Tree[Token]]:
    return trees(trees(tree.children, "clauses")[0].children)


def _actions(reading: Reading, clauses: Sequence[Tree[Token]]) -> tuple[Action, ...]:
    return tuple(action_of(reading, part) for part in trees(clauses, "action"))


def _effects(reading: Reading, clauses: Sequence[Tree[Token]]) -> tuple[Effect, ...]:
    """Parse the valid `each step` and `on find` clauses in the order of the text, in which rewards are summed."""
    read = (
        each_step_of(reading, part) if part.data == "each" else on_find_of(reading, part)
        for part in trees(clauses, "each", "on")
    )
    return tuple(effect for effect in read if effect is not None)


def _observations(reading: Reading, clauses: Sequence[Tree[Token]]) -> tuple[Observation, ...]:
    return tuple(observation_of(reading, part) for part in trees(clauses, "observation"))
