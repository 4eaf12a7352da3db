"""Exploration against one that copies the model for every state; isomorphism against networkx."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from random import Random

import networkx as nx
from hypothesis import given, settings, strategies as st

from envgraph.errors import EvaluationError, RuleError
from envgraph.graph import IsomorphismClasses, Model, to_networkx
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.rewrite import Engine, Exploration, Firing
from tests.profile import examples
from tests.property.test_rewrite_rollback import RULES
from tests.unit.rewrite.explorations import compiling
from tests.unit.rewrite.graphs import METAMODEL, definitions, snapshot

DEFINITIONS = definitions(RULES)
NAMES = (
    "grow", "drop", "dropSafely", "chainUp", "link", "befriend", "adopt", "kind", "special", "merge", "redirect",
    "both", "prune",
)  # fmt: skip
MOST = 14

Facts = frozenset[object]
Same = Callable[[Model, Model], bool]


def engine_on(model: Model) -> Engine:
    made = Engine(model)
    made.add(*DEFINITIONS)
    return made


def facts(model: Model) -> Facts:
    """A state by identity, without orders."""
    found: list[object] = [(node, model.graph.class_of(node)) for node in model.graph.extent("Thing")]
    found += [
        (attribute, node, model.graph.value(node, attribute))
        for attribute in model.metamodel.attributes
        for node in model.graph.extent(attribute.owner)
    ]
    found += [
        (reference, node, target)
        for reference in model.metamodel.references
        for node in model.graph.extent(reference.owner)
        for target in model.graph.targets(node, reference)
    ]
    return frozenset(found)


def same_facts(left: Model, right: Model) -> bool:
    return facts(left) == facts(right)


def isomorphic(left: Model, right: Model) -> bool:
    """As networkx sees it."""
    return bool(
        nx.is_isomorphic(
            to_networkx(left),
            to_networkx(right),
            node_match=lambda a, b: a == b,
            edge_match=lambda a, b: set(a) == set(b),
        )
    )


def explore_by_copying(
    start: Model, names: list[str], same: Same, limit: int
) -> tuple[list[Model], list[tuple[int, int, str, object]], bool]:
    """States, transitions, and whether there are more than the limit: breadth first, a copy for every state."""
    states, edges = [start.copy()], list[tuple[int, int, str, object]]()
    for source, model in enumerate(states):  # grows
        made = engine_on(model)
        for name in names:
            for row in sorted(made.prepare(name).all_rows()):
                mark = model.graph.history.savepoint()
                try:
                    made.fire(name, row)
                except RuleError:
                    model.graph.history.rollback(mark)
                    continue
                known = [number for number, other in enumerate(states) if other is not model and same(other, model)]
                changed = model.copy()
                model.graph.history.rollback(mark)
                if not known and same(changed, model):
                    known = [source]
                if not known and len(states) == limit:
                    return states, edges, True
                states += [] if known else [changed]
                edges.append((source, min(known, default=len(states) - 1), name, row))
    return states, edges, False


def start(size: int) -> Model:
    model = Model(METAMODEL)
    for number in range(size):
        model.create("Special" if number % 3 == 2 else "Item", n=number % 2)
    return model


@given(
    size=st.integers(1, 3),
    names=st.lists(st.sampled_from(NAMES), min_size=1, max_size=3, unique=True),
    up_to=st.sampled_from(["identity", "isomorphism"]),
    watched=st.booleans(),
    keep=st.booleans(),
    after=st.sampled_from([0, 3, inf]),
)
@settings(max_examples=examples(20))
def test_explored_states_equal_those_reached_by_copying_models(
    size: int, names: list[str], up_to: str, watched: bool, keep: bool, after: float
) -> None:
    made = engine_on(start(size))
    if watched:
        made.watch(*names)
    before = snapshot(made.model)
    with compiling(after):
        found = made.explore(names, limit=MOST, up_to=up_to, keep=keep)  # type: ignore[arg-type]
    assert snapshot(made.model) == before
    made.check_integrity()
    states, edges, more = explore_by_copying(
        start(size), names, same_facts if up_to == "identity" else isomorphic, MOST
    )
    assert found.complete is not more and len(found) == len(states)
    assert [(t.source, t.target, t.name, t.firings[0].values) for t in found.transitions] == edges
    other = engine_on(start(size))
    for state, model in zip(found.states, states, strict=True):
        mark = other.model.graph.history.savepoint()
        other.replay(found.path(state.number))
        assert snapshot(other.model) == snapshot(model)
        other.model.graph.history.rollback(mark)
        if state.version is not None:
            made.checkout(state.version)
            assert snapshot(made.model) == snapshot(model)


@given(
    size=st.integers(1, 3),
    names=st.lists(st.sampled_from([*NAMES, "tidy", "spree"]), min_size=1, max_size=3, unique=True),
    up_to=st.sampled_from(["identity", "isomorphism"]),
    seed=st.integers(0, 10),
)
@settings(max_examples=examples(20))
def test_exploration_strategies_find_the_same_states_and_leave_the_model_unchanged(
    size: int, names: list[str], up_to: str, seed: int
) -> None:
    made = engine_on(start(size))
    made.step_limit = 40
    random = Random(seed)
    with made.transaction():
        for _ in range(seed):
            made.apply(random.choice(["chainUp", "befriend", "grow"]))
        before, generator = snapshot(made.model), made.rng.bit_generator.state
        results = [explored(made, names, strategy, up_to) for strategy in ("breadth", "depth")]
        assert snapshot(made.model) == before and made.rng.bit_generator.state == generator
        for result in filter(None, results):
            for state in result.states[:8]:
                assert_reached(made, result.path(state.number), before)
    first, second = results
    if first and second and first.complete and second.complete:
        assert len(first) == len(second) and len(first.transitions) == len(second.transitions)
        assert first.statistics.depth <= second.statistics.depth


def explored(made: Engine, names: list[str], strategy: str, up_to: str) -> Exploration | None:
    """None if a unit never ends."""
    try:
        return made.explore(names, limit=60, strategy=strategy, up_to=up_to)  # type: ignore[arg-type]
    except EvaluationError:
        return None


def assert_reached(made: Engine, path: list[Firing], before: object) -> None:
    mark = made.model.graph.history.savepoint()
    made.replay(path)
    made.model.graph.history.rollback(mark)
    assert snapshot(made.model) == before


# --- isomorphism

GRAPHS = Metamodel(
    "graphs",
    [
        Class(
            "N",
            features=(
                Attribute("v", Scalar.INT),
                Reference("to", "N", 0, None),
                Reference("other", "N", 0, None),
                Reference("even", "N", 0, None, opposite="even"),
            ),
        ),
        Class("M", supertypes=("N",)),
    ],
)


def random_graph(random: Random, size: int) -> Model:
    """Small and regular, so that many pairs are hard to tell apart."""
    model = Model(GRAPHS)
    nodes = [model.create("M" if random.random() < 0.1 else "N", v=int(random.random() < 0.1)) for _ in range(size)]
    to, other, even = (model.metamodel.feature("N", name) for name in ("to", "other", "even"))
    for shift in random.sample(range(size), min(2, size)):
        order = random.sample(range(size), size)
        reference = random.choice([to, to, other, even])
        for place in range(size):
            model.graph.link(nodes[order[place]].id, reference, nodes[order[(place + shift) % size]].id)  # type: ignore[arg-type]
    return model


def shuffled(model: Model, random: Random) -> Model:
    """An isomorphic model with other ids and orders."""
    ids = {node.id: number for number, node in enumerate(random.sample(model.nodes(), len(model)))}
    found = Model(GRAPHS)
    for node in sorted(model.nodes(), key=lambda node: ids[node.id]):
        found.create(node.cls, v=node.v)
    pairs = [
        (node, reference, target)
        for reference in GRAPHS.references
        for node in ids
        for target in model.graph.targets(node, reference)
    ]
    for node, reference, target in random.sample(pairs, len(pairs)):
        found.graph.link(ids[node], reference, ids[target])
    return found


@given(seed=st.integers(0, 10**6), size=st.integers(0, 8))
@settings(max_examples=examples(50))
def test_shapes_are_numbered_up_to_isomorphism(seed: int, size: int) -> None:
    random, shapes = Random(seed), IsomorphismClasses()
    models = [random_graph(random, size) for _ in range(4)]
    models += [shuffled(model, random) for model in models]
    numbers = [shapes.class_number(model.graph.store) for model in models]
    for one, left in zip(numbers, models, strict=True):
        for other, right in zip(numbers, models, strict=True):
            assert (one == other) == isomorphic(left, right)
    assert [shapes.class_number(model.graph.store) for model in models] == numbers
