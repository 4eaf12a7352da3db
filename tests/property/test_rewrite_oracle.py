"""Rules against an independent implementation of DPO and SPO on sets, on random rules and graphs.

The oracle knows nothing of patterns, plans and journals: it tries every assignment of nodes to variables, and builds
the new graph as a set of facts.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

from hypothesis import assume, given, settings, strategies as st

from envgraph.errors import RuleError
from envgraph.graph import Model
from envgraph.match import ViewMatcher
from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
from envgraph.pattern import (
    CreateAction,
    DeleteEdge,
    DeleteNode,
    LeftSide,
    Modification,
    RetypeAction,
    RightSide,
    Rule,
    RuleBlock,
    RuleEdge,
    RuleNode,
    Variable,
)
from envgraph.rewrite import Engine
from tests.oracle.naive._naive import NaiveMatcher
from tests.profile import examples

METAMODEL = Metamodel(
    "oracle",
    (
        Class(
            "A",
            features=(
                Attribute("n", Scalar.INT),
                Reference("next", "A", 0, 1, opposite="prev"),
                Reference("prev", "A", 0, 1, opposite="next"),
                Reference("links", "A", 0, None),
                Reference("pair", "A", 0, 2),
                Reference("friends", "A", 0, None, opposite="friends"),
            ),
        ),
        Class("B", supertypes=("A",), features=(Reference("own", "A", 0, 1),)),
    ),
)
REFERENCES = ("next", "prev", "links", "pair", "friends")
UPPER = {"next": 1, "prev": 1, "pair": 2, "own": 1}
OPPOSITE = {"next": "prev", "prev": "next", "friends": "friends"}

Link = tuple[str, int, int]
Arrow = tuple[str, str, str]


@dataclass
class Graph:
    """Classes of nodes, and links; opposites are both there."""

    classes: dict[int, str]
    links: set[Link]


@dataclass(frozen=True)
class Sketch:
    """A rule as the oracle reads it: classes and arrows of both sides, by name."""

    left: dict[str, str]
    arrows: tuple[Arrow, ...]
    forbidden: tuple[Arrow, ...]
    right: dict[str, str | None]
    after: tuple[Arrow, ...]
    injective: bool
    semantics: str


# --- the oracle


def closed(links: set[Link]) -> set[Link]:
    """With the opposite of every link."""
    return links | {(OPPOSITE[r], t, s) for r, s, t in links if r in OPPOSITE}


def canonical(arrow: tuple[str, object, object]) -> frozenset:
    reference, source, target = arrow
    if reference == "friends":
        return frozenset({(reference, source, target), (reference, target, source)})
    return frozenset({("next", target, source) if reference == "prev" else arrow})


def matches(graph: Graph, rule: Sketch) -> Iterator[dict[str, int]]:
    names = list(rule.left)
    for nodes in product(sorted(graph.classes), repeat=len(names)):
        found = dict(zip(names, nodes, strict=True))
        if rule.injective and len(set(nodes)) < len(nodes):
            continue
        typed = all(rule.left[v] == "A" or graph.classes[n] == "B" for v, n in found.items())
        linked = all((r, found[s], found[t]) in graph.links for r, s, t in rule.arrows)
        if typed and linked and not any(blocked(graph, rule, found, arrow) for arrow in rule.forbidden):
            yield found


def blocked(graph: Graph, rule: Sketch, found: dict[str, int], arrow: Arrow) -> bool:
    """Whether the arrow leads from its source to some other node."""
    reference, source, _ = arrow
    return any(
        r == reference and s == found[source] and not (rule.injective and t in found.values())
        for r, s, t in graph.links
    )


def rewritten(graph: Graph, rule: Sketch, found: dict[str, int], fresh: int) -> Graph | str:
    """The graph after the rule, or why it is refused."""
    deleted = {v for v in rule.left if v not in rule.right}
    kept_arrows = {canonical(a) for a in rule.after}
    gone = [a for a in rule.arrows if canonical(a) not in kept_arrows]
    if any(v in deleted and w != v and found[v] == found[w] for v in rule.left for w in rule.left):
        return "identification"
    image = {a: canonical((a[0], found[a[1]], found[a[2]])) for a in rule.arrows}
    if any(image[a] == image[b] for a in gone for b in rule.arrows if canonical(a) != canonical(b)):
        return "identification"
    retyped: dict[int, str] = {}
    for name, cls in rule.right.items():
        changed = name in rule.left and cls is not None and cls != rule.left[name]
        if changed and cls and retyped.setdefault(found[name], cls) != cls:
            return "ambiguous"
    links = graph.links - closed({(r, found[s], found[t]) for r, s, t in gone})
    nodes = {found[v] for v in deleted}
    dangling = {link for link in links if nodes & {link[1], link[2]}}
    if dangling and rule.semantics == "dpo":
        return "dangling"
    links -= dangling
    classes = {node: cls for node, cls in graph.classes.items() if node not in nodes}
    for node, cls in retyped.items():
        lost = {link for link in links if cls == "A" and link[0] == "own" and link[1] == node}
        if lost and rule.semantics == "dpo":
            return "lost-link"
        links -= lost
        classes[node] = cls
    places = dict(found)
    for name, cls in rule.right.items():
        if name not in rule.left:
            assert cls is not None
            places[name] = fresh
            classes[fresh] = cls
            fresh += 1
    links |= closed({(r, places[s], places[t]) for r, s, t in rule.after})
    counts = Counter((r, s) for r, s, _ in links)
    if any(count > UPPER.get(reference, count) for (reference, _), count in counts.items()):
        return "full"
    return Graph(classes, links)


# --- what is tested


def as_rule(sketch: Sketch, modify: bool) -> Rule:
    """The rule in one of the two notations."""
    left = LeftSide(
        tuple(RuleNode(name, cls) for name, cls in sketch.left.items()),
        tuple(RuleEdge(s, r, t) for r, s, t in sketch.arrows),
    )
    blocks = tuple(
        RuleBlock("not", LeftSide(edges=(RuleEdge(s, r, f"other{i}"),))) for i, (r, s, _) in enumerate(sketch.forbidden)
    )
    right = RightSide(
        tuple(RuleNode(name, cls) for name, cls in sketch.right.items()),
        tuple(RuleEdge(s, r, t) for r, s, t in sketch.after),
    )
    return Rule(
        "r",
        left=left,
        blocks=blocks,
        right=modification(sketch) if modify else right,
        semantics="dpo" if sketch.semantics == "dpo" else "spo",
        injective=sketch.injective,
    )


def modification(sketch: Sketch) -> Modification:
    """The same changes as actions."""
    new = tuple(RuleNode(name, cls) for name, cls in sketch.right.items() if name not in sketch.left)
    before, after = {canonical(a) for a in sketch.arrows}, {canonical(a) for a in sketch.after}
    edges = tuple(RuleEdge(s, r, t) for r, s, t in sketch.after if canonical((r, s, t)) not in before)
    return Modification(
        (
            *(DeleteEdge(RuleEdge(s, r, t)) for r, s, t in sketch.arrows if canonical((r, s, t)) not in after),
            *(DeleteNode(Variable(name)) for name in sketch.left if name not in sketch.right),
            *(
                RetypeAction(Variable(name), cls)
                for name, cls in sketch.right.items()
                if name in sketch.left and cls is not None and cls != sketch.left[name]
            ),
            CreateAction(new, edges),
        )
    )


def as_model(graph: Graph) -> Model:
    model = Model(METAMODEL)
    for node in sorted(graph.classes):
        assert model.graph.new(graph.classes[node]) == node
    for reference, source, target in sorted(graph.links):
        feature = METAMODEL.feature("B", reference)
        assert isinstance(feature, Reference)
        model.graph.link(source, feature, target)
    return model


def as_graph(model: Model) -> Graph:
    nodes = list(model.graph.extent("A"))
    links = {
        (reference.name, node, target)
        for reference in METAMODEL.references
        for node in nodes
        for target in model.graph.targets(node, reference)
    }
    return Graph({node: model.graph.class_of(node) for node in nodes}, links)


@st.composite
def graphs(draw: st.DrawFn) -> Graph:
    size = draw(st.integers(1, 6))
    classes = {node: draw(st.sampled_from("AB")) for node in range(size)}
    ends = st.tuples(st.sampled_from((*REFERENCES, "own")), st.integers(0, size - 1), st.integers(0, size - 1))
    links: set[Link] = set()
    for reference, source, target in draw(st.lists(ends, max_size=10)):
        more = links | closed({(reference, source, target)})
        counts = Counter((r, s) for r, s, _ in more)
        fits = all(count <= UPPER.get(r, count) for (r, _), count in counts.items())
        if fits and (reference != "own" or classes[source] == "B"):
            links = more
    return Graph(classes, links)


@st.composite
def sketches(draw: st.DrawFn) -> Sketch:
    left = {name: draw(st.sampled_from("AAB")) for name in "xyz"[: draw(st.integers(1, 3))]}
    reference = st.sampled_from(REFERENCES)

    def arrows(names: list[str], most: int) -> tuple[Arrow, ...]:
        if not names:
            return ()
        found = draw(st.lists(st.tuples(reference, st.sampled_from(names), st.sampled_from(names)), max_size=most))
        return tuple(found)

    before = arrows(list(left), 3)
    right: dict[str, str | None] = {}
    for name, cls in left.items():
        if draw(st.integers(0, 3)):
            right[name] = draw(st.sampled_from((None, None, cls, "A", "B")))
    kept = tuple(a for a in before if a[1] in right and a[2] in right and draw(st.integers(0, 2)))
    for name in "uv"[: draw(st.integers(0, 2))]:
        right[name] = draw(st.sampled_from("AB"))
    after = kept + arrows(list(right), 2)
    forbidden = arrows(list(left), 1)
    return Sketch(left, before, forbidden, right, after, draw(st.booleans()), draw(st.sampled_from(("dpo", "spo"))))


def equal(one: Graph, other: Graph) -> bool:
    return one.classes == other.classes and one.links == other.links


@settings(max_examples=examples(70))
@given(graphs(), sketches(), st.booleans())
def test_rule_applications_equal_the_oracle(graph: Graph, sketch: Sketch, modify: bool) -> None:
    model = as_model(graph)
    engine = Engine(model, matcher=ViewMatcher if modify else NaiveMatcher)
    engine.add(as_rule(sketch, modify))
    names = list(sketch.left)
    expected = list(matches(graph, sketch))
    found = engine.matches("r")
    assert {match.row for match in found} == {tuple(m[name] for name in names) for m in expected}
    assert len(found) == len(expected)
    assume(found)
    for match in found[:12]:
        result = rewritten(graph, sketch, dict(zip(names, map(int, match.row), strict=True)), len(graph.classes))
        savepoint = model.graph.history.savepoint()
        try:
            application = engine.apply("r", match)
        except RuleError as error:
            assert error.reason == result
            assert equal(as_graph(model), graph)
        else:
            assert not isinstance(result, str) and application is not None
            assert equal(as_graph(model), result)
            model.check_integrity()
        model.graph.history.rollback(savepoint)
        assert equal(as_graph(model), graph)


@settings(max_examples=examples(40))
@given(graphs(), sketches(), sketches(), st.integers(0, 2**32 - 1))
def test_rhs_and_modify_notations_give_the_same_state_and_order(
    graph: Graph, first: Sketch, second: Sketch, seed: int
) -> None:
    states = []
    for modify in (False, True):
        model = as_model(graph)
        engine = Engine(model, seed=seed)
        for number, sketch in enumerate((first, second)):
            rule = as_rule(sketch, modify)
            engine.add(Rule(f"r{number}", (), rule.left, rule.blocks, rule.right, semantics=rule.semantics))
        trace: list[object] = []
        for _ in range(6):
            chosen = engine.choose(["r0", "r1"])
            if chosen is not None:
                try:
                    trace.extend(engine.fire(*chosen))
                except RuleError as error:
                    trace.append(error.reason)
        links = [[list(model.graph.targets(n, r)) for r in METAMODEL.references] for n in model.graph.extent("A")]
        states.append((trace, list(model.graph.extent("A")), links, model.state_hash()))
    assert states[0] == states[1]
