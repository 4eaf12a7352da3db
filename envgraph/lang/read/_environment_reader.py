"""Convert the syntax trees of `.environment` files to behaviours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lark import Token, Tree

from envgraph.behaviour import Action, Agent, Behaviour, Domain, Effect, Observation
from envgraph.lang.read._environment_clauses import (
    parse_action,
    parse_drawing,
    parse_each_step,
    parse_observations,
    parse_on_find,
    parse_on_refused,
    parse_on_reset,
)
from envgraph.lang.read._file_reading import FileReading, TypeNames, resolve_type, type_name_span
from envgraph.lang.read._query_header import DefinitionsFile, name_token, read_definitions
from envgraph.lang.read._query_reader import parse_parameters, parse_suppressions
from envgraph.lang.syntax._parser import ParseResult, select_tokens, select_trees
from envgraph.metamodel import Metamodel

_ENVIRONMENT_CLAUSES = {
    "reset": "on reset",
    "agent": "agent",
    "together": "agents together",
    "limit": "limit",
    "draw_grid": "draw",
    "draw_graph": "draw",
}
"""Clauses that are not allowed in an `agent` block, with their keywords."""


_MISSING_ENVIRONMENT = (
    "missing-environment",
    "the file defines no environment",
    "write `environment Name { ... }`",
)


def read_environment(parsed: ParseResult, types: TypeNames | None = None) -> DefinitionsFile[Behaviour]:
    """Return the behaviours of a parsed `.environment` file, also incomplete ones, with its header and diagnostics."""
    return read_definitions(parsed, types, _parse_behaviour, keep_broken=True, missing=_MISSING_ENVIRONMENT)


def mark_enum_domains(behaviour: Behaviour, metamodel: Metamodel) -> Behaviour:
    """Return a copy of the behaviour where each action parameter that names an enum has `enum` set instead of `cls`."""

    def distinguished(actions: tuple[Action, ...]) -> tuple[Action, ...]:
        return tuple(
            replace(
                action,
                parameters=tuple((name, _mark_enum_domain(domain, metamodel)) for name, domain in action.parameters),
            )
            for action in actions
        )

    agents = tuple(replace(agent, actions=distinguished(agent.actions)) for agent in behaviour.agents)
    return replace(behaviour, actions=distinguished(behaviour.actions), agents=agents)


def _mark_enum_domain(domain: Domain, metamodel: Metamodel) -> Domain:
    return replace(domain, cls=None, enum=domain.cls) if domain.cls in metamodel.enums else domain


def _parse_behaviour(reading: FileReading, _: str, tree: Tree[Token]) -> Behaviour:
    name = name_token(tree)
    clauses = _clause_trees(tree)
    drawing = reading.first_or_report("`draw`", select_trees(clauses, "draw_grid", "draw_graph"))
    limit = reading.first_or_report("`limit`", select_trees(clauses, "limit"))
    together = reading.first_or_report("`agents together`", select_trees(clauses, "together"))
    behaviour = Behaviour(
        name=str(name),
        parameters=parse_parameters(reading, tree),
        actions=_parse_actions(reading, clauses),
        effects=_parse_effects(reading, clauses),
        resets=tuple(filter(None, (parse_on_reset(reading, part) for part in select_trees(clauses, "reset")))),
        observations=_parse_observations(reading, clauses),
        agents=tuple(_parse_agent(reading, part) for part in select_trees(clauses, "agent")),
        together=together is not None,
        limit=int(select_tokens(limit.children)[0]) if limit else None,
        draw=parse_drawing(reading, drawing) if drawing else None,
        annotations=parse_suppressions(reading, tree),
        doc=reading.parsed.doc_comment(tree),
        span=reading.span(name),
        limit_span=reading.span(limit) if limit else None,
        together_span=reading.span(together) if together else None,
    )
    return replace(behaviour, unread=reading.all_lost() | {str(name)}) if reading.has_gap(tree) else behaviour


def _parse_agent(reading: FileReading, tree: Tree[Token]) -> Agent:
    name = name_token(tree)
    type_ = select_trees(tree.children, "type")[0]
    clauses = _clause_trees(tree)
    for clause in select_trees(clauses, *_ENVIRONMENT_CLAUSES):
        word = _ENVIRONMENT_CLAUSES[str(clause.data)]
        hint = "move it out of the `agent` block"
        reading.error(
            "misplaced-clause",
            f"`{word}` applies to the whole environment, not to an agent",
            clause,
            hint,
        )
    return Agent(
        variable=str(name),
        cls=resolve_type(reading, type_),
        actions=_parse_actions(reading, clauses),
        effects=_parse_effects(reading, clauses),
        observations=_parse_observations(reading, clauses),
        span=reading.span(name),
        cls_span=type_name_span(reading, type_),
    )


def _clause_trees(tree: Tree[Token]) -> list[Tree[Token]]:
    return select_trees(select_trees(tree.children, "clauses")[0].children)


def _parse_actions(reading: FileReading, clauses: Sequence[Tree[Token]]) -> tuple[Action, ...]:
    return tuple(parse_action(reading, part) for part in select_trees(clauses, "action"))


def _parse_effects(reading: FileReading, clauses: Sequence[Tree[Token]]) -> tuple[Effect, ...]:
    """Parse the valid `each step` and `on` clauses in the order of the text, in which rewards are summed."""
    parsers = {"each": parse_each_step, "on": parse_on_find, "refused": parse_on_refused}
    read = (parsers[str(part.data)](reading, part) for part in select_trees(clauses, *parsers))
    return tuple(effect for effect in read if effect is not None)


def _parse_observations(reading: FileReading, clauses: Sequence[Tree[Token]]) -> tuple[Observation, ...]:
    trees = select_trees(clauses, "observation", "around")
    return tuple(one for part in trees for one in parse_observations(reading, part))
