"""Rules with one part less: to mend random ones that are refused, and to find the reason of a disagreement."""

from __future__ import annotations

from dataclasses import replace

from envgraph.errors import Severity
from envgraph.pattern import (
    CreateAction,
    LeftSide,
    Modification,
    RightSide,
    Rule,
    RuleBlock,
)
from envgraph.rewrite import Engine


def errors(engine: Engine, rule: Rule) -> list[str]:
    return [str(one) for one in engine.check(rule) if one.severity is Severity.ERROR]


def without_refused_parts(engine: Engine, rule: Rule, dropped: list[str] | None = None) -> Rule | None:
    """The rule without the parts that are refused when it is registered; None if nothing is left."""
    problems = errors(engine, rule)
    while problems:
        if dropped is not None:
            dropped += problems
        smaller = [one for one in parts_left_out(rule)]
        if not smaller:
            return None
        counts = [(len(errors(engine, one)), number) for number, one in enumerate(smaller)]
        best, number = min(counts)
        if best >= len(problems):
            return None
        rule = smaller[number]
        problems = errors(engine, rule)
    return rule


def parts_left_out(rule: Rule) -> list[Rule]:
    """The rules that have one part less: an action, a block, an arrow, a constraint."""
    found = [replace(rule, homomorphic=())] if rule.homomorphic else []
    found += [replace(rule, right=one) for one in smaller_rights(rule.right)]
    found += [replace(rule, left=one) for one in smaller_lefts(rule.left)]
    found += [replace(rule, blocks=one) for one in smaller_blocks(rule.blocks)]
    for i in range(len(rule.parameters)):
        found.append(replace(rule, parameters=rule.parameters[:i] + rule.parameters[i + 1 :]))
    return found


def smaller_blocks(blocks: tuple[RuleBlock, ...]) -> list[tuple[RuleBlock, ...]]:
    found = [blocks[:i] + blocks[i + 1 :] for i in range(len(blocks))]
    for i, block in enumerate(blocks):
        inner = [replace(block, right=one) for one in smaller_rights(block.right)]
        inner += [replace(block, left=one) for one in smaller_lefts(block.left)]
        inner += [replace(block, blocks=one) for one in smaller_blocks(block.blocks)]
        found += [(*blocks[:i], one, *blocks[i + 1 :]) for one in inner]
    return found


def smaller_lefts(left: LeftSide) -> list[LeftSide]:
    found = [replace(left, constraints=without(left.constraints, i)) for i in range(len(left.constraints))]
    found += [replace(left, edges=without(left.edges, i)) for i in range(len(left.edges))]
    return found + [replace(left, nodes=without(left.nodes, i)) for i in range(len(left.nodes))]


def smaller_rights(right: RightSide | Modification | None) -> list[RightSide | Modification | None]:
    if right is None:
        return []
    found: list[RightSide | Modification | None] = [None]
    found += [replace(right, actions=without(right.actions, i)) for i in range(len(right.actions))]
    for i, one in enumerate(right.actions):
        if isinstance(one, CreateAction):
            smaller = [replace(one, edges=without(one.edges, j)) for j in range(len(one.edges))]
            smaller += [
                replace(one, nodes=tuple(replace(n, assignments=without(n.assignments, j)) for n in one.nodes))
                for node in one.nodes
                for j in range(len(node.assignments))
            ]
            found += [replace(right, actions=(*right.actions[:i], each, *right.actions[i + 1 :])) for each in smaller]
    if isinstance(right, RightSide):
        found += [replace(right, edges=without(right.edges, i)) for i in range(len(right.edges))]
        for i, node in enumerate(right.nodes):
            found.append(replace(right, nodes=without(right.nodes, i)))
            for j in range(len(node.assignments)):
                less = replace(node, assignments=without(node.assignments, j))
                found.append(replace(right, nodes=(*right.nodes[:i], less, *right.nodes[i + 1 :])))
            if node.type:
                found.append(replace(right, nodes=(*right.nodes[:i], replace(node, type=None), *right.nodes[i + 1 :])))
    return found


def without(items: tuple, index: int) -> tuple:  # type: ignore[type-arg]
    return items[:index] + items[index + 1 :]
