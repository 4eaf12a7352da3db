"""The generator of the Train Benchmark draws as Java does, and makes the models whose sizes are published."""

from __future__ import annotations

import doctest

import pytest

from benchmarks import _railway, _railway_edits
from benchmarks._railway import JavaRandom, build, generate, workspace
from envgraph.graph import check_conformance


def test_numbers_are_those_of_java_util_random() -> None:
    """Printed by OpenJDK 17: powers of two, rejections (2^30 + 1), and the largest bound among them."""
    random = JavaRandom(19871053)
    bounds = (8, 19, 1000, 2**30 + 1, 2**30 + 1, 2**30 + 1, 1, 1024, 2**31 - 1, 100)
    drawn = [random.next_int(bound) for bound in bounds]
    assert drawn == [4, 0, 59, 657367334, 234000460, 592151438, 0, 753, 371315828, 94]


def test_many_numbers_are_those_of_java_util_random() -> None:
    """h = 31 h + nextInt(10007 i) in 64 bits, for i below 20,000; printed by OpenJDK 17."""
    random, mixed = JavaRandom(7), 0
    for i in range(1, 20_000):
        mixed = (31 * mixed + random.next_int(10_007 * i)) % 2**64
    assert mixed == 7259924984724946614 % 2**64


def test_shuffling_is_that_of_java_util_collections() -> None:
    items = list(range(1, 13))
    JavaRandom(42).shuffle(items)
    assert items == [1, 2, 7, 8, 4, 6, 11, 12, 10, 9, 5, 3]


@pytest.mark.parametrize(
    ("scenario", "size", "nodes", "edges"),
    [
        ("batch", 1, 737, 2_131),
        ("repair", 1, 741, 2_100),
        ("repair", 8, 11_499, 32_782),
        ("repair", 64, 107_352, 306_126),
    ],
)
def test_node_and_edge_counts_agree_with_the_published_counts(scenario: str, size: int, nodes: int, edges: int) -> None:
    railway = generate(scenario, size)
    assert (railway.node_count, railway.edge_count) == (nodes, edges)


@pytest.mark.parametrize("scenario", ["batch", "repair", "inject"])
def test_the_model_contains_the_generated_objects_values_and_links(scenario: str) -> None:
    railway = generate(scenario, 1)
    model = build(railway, workspace().metamodel)
    model.check_integrity()
    assert [node.cls for node in sorted(model, key=lambda node: node.id)[1:]] == railway.classes
    assert all(node["id"] == node.id for node in model.nodes("RailwayElement"))
    for name, values in railway.values.items():
        assert all(model.node(element)[name] == value for element, value in values)
    for name, edges in railway.edges.items():
        reference = _railway.reference(model.metamodel, name)
        assert all(model.graph.has_link(source, reference, target) for source, target in edges)
        assert sum(len(model.graph.targets(node.id, reference)) for node in model.nodes(reference.owner)) == len(edges)


def test_a_railway_without_mistakes_conforms_to_its_metamodel() -> None:
    assert check_conformance(build(generate("batch", 1), workspace().metamodel)) == []


@pytest.mark.parametrize("module", [_railway, _railway_edits])
def test_doctests_of_the_railway_modules_pass(module: object) -> None:
    failed, tried = doctest.testmod(module, optionflags=doctest.ELLIPSIS)  # type: ignore[arg-type]
    assert tried > 0
    assert failed == 0
