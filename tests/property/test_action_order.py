"""The order of the actions of a rule does not matter: nor for what is said about it, nor for what it does."""

from __future__ import annotations

import re
from contextlib import suppress

from hypothesis import given, strategies as st

from envgraph.errors import EvaluationError, RuleError, has_errors
from envgraph.graph import Model
from envgraph.metamodel import Attribute
from envgraph.rewrite import Engine
from tests.unit.rewrite.graphs import METAMODEL, definitions, snapshot

NAMES = ("a", "b", "c")
REFERENCES = ("next", "links", "pair", "friends", "kids")
TEMPLATES = (
    "delete {0};",
    "create {0} -{r}-> {1};",
    "delete {0} -{r}-> {1};",
    "redirect {0} -{r}-> {1} to {2};",
    "set {0}.next = {1};",
    "set {0}.next = none;",
    "set {0}.next = {1}.next;",
    "set {0}.prev = {1}.next;",
    "set {0}.parent = {1};",
    "set {0}.parent = none;",
    "set {0}.links = [{1}, {2}];",
    "set {0}.kids = [{1}];",
    "set {0}.links += {1};",
    "set {0}.kids += {1}.next;",
    "set {0}.kids -= {1};",
    "set {0}.n = {1}.n;",
    "set {0}.n += 2;",
    "set {0}.n -= {1}.next.n;",
    "retype {0} : Special;",
    "retype {0} : Box;",
    "move {0} to {1}.kids;",
    "move {0} to box.content;",
    "merge {0} <- {1};",
    "create x : Item {{ n = {0}.n, links = [{1}] }};",
    "create {0} -{r}-> x;",
    "move x to {0}.kids;",
)

names = st.sampled_from(NAMES)
actions = st.builds(
    lambda template, one, two, three, reference: template.format(one, two, three, r=reference),
    st.sampled_from(TEMPLATES),
    names,
    names,
    names,
    st.sampled_from(REFERENCES),
)
links = st.lists(st.tuples(st.sampled_from(REFERENCES), st.integers(0, 3), st.integers(0, 3)), max_size=8)
headers = st.sampled_from(("", "@match(homomorphic)", "@semantics(spo)", "@hom(a, b) @semantics(spo)"))
blocks = st.sampled_from(("", "forall", "optional"))


def model(edges: list[tuple[str, int, int]]) -> Model:
    """Three items, a special one and a box; of the links, those that there is room for."""
    made = Model(METAMODEL)
    items = [made.create("Item", n=number) for number in range(3)] + [made.create("Special")]
    made.create("Box")
    for reference, source, target in edges:
        feature = METAMODEL.feature("Item", reference)
        assert feature is not None and not isinstance(feature, Attribute)
        with suppress(RuleError):
            made.graph.link(items[source].id, feature, items[target].id)
    return made


def text(header: str, block: str, outer: list[str], inner: list[str]) -> str:
    inside = f"{block} {{ lhs {{ a -links-> c : Item; }} modify {{ {' '.join(inner)} }} }}" if block else ""
    left = "a : Item; b : Item; box : Box;" + ("" if block else " c : Item;")
    return f"{header} rule r {{ lhs {{ {left} }} {inside} modify {{ {' '.join(outer)} }} }}"


def facts(made: Model) -> set[object]:
    """What a model says, without the order of anything."""
    found: set[object] = set()
    for node in made.nodes():
        found.add((node.id, node.cls))
        for feature in METAMODEL.features(node.cls).values():
            if isinstance(feature, Attribute):
                found.add((node.id, feature.name, made.graph.value(node.id, feature)))
            else:
                found.update((node.id, feature.name, target) for target in made.graph.targets(node.id, feature))
    return found


def outcome(rule: str, edges: list[tuple[str, int, int]], number: int) -> object:
    """What comes of a rule: a mistake, no match, a refusal that leaves everything, or another model."""
    made = Engine(model(edges))
    if has_errors(made.check(*definitions(rule))):
        return "mistake"
    made.add(*definitions(rule))
    matches = sorted(made.matches("r"), key=lambda match: match.row)
    if not matches:
        return "no match"
    before = snapshot(made.model)
    try:
        made.apply("r", matches[number % len(matches)])
    except (RuleError, EvaluationError):
        assert snapshot(made.model) == before and not made.model.graph.history.savepoint_depth
        return "refused"
    made.model.check_integrity()
    return facts(made.model)


@given(
    headers,
    blocks,
    st.lists(actions, min_size=1, max_size=4),
    st.lists(actions, max_size=2),
    links,
    st.data(),
)
def test_the_order_of_actions_does_not_matter(
    header: str,
    block: str,
    outer: list[str],
    inner: list[str],
    edges: list[tuple[str, int, int]],
    data: st.DataObject,
) -> None:
    if block:
        outer = [re.sub(r"\bc\b", "b", action) for action in outer]  # `c` belongs to the block
    number = data.draw(st.integers(0, 50))
    expected = outcome(text(header, block, outer, inner), edges, number)
    other = data.draw(st.permutations(outer)), data.draw(st.permutations(inner))
    assert outcome(text(header, block, *other), edges, number) == expected
