"""Models as networkx graphs."""

import networkx as nx
import pytest

from envgraph.errors import InvalidArgument, RuleError, TypeMismatch
from envgraph.graph import Model, from_networkx, to_networkx
from envgraph.metamodel import Attribute, Class, Metamodel, Scalar
from tests.unit.graph.domain import FOREST, PEOPLE, forest


def graph(*nodes, edges=()):
    """A graph of nodes with a class each, labelled by themselves."""
    made = nx.MultiDiGraph()
    for label, attributes in nodes:
        made.add_node(label, **attributes)
    made.add_edges_from(edges)
    return made


def test_nodes_have_class_name_and_values():
    made = to_networkx(forest(2))
    assert made.nodes[1] == {"class": "RoadTile", "object_name": "t00", "x": 0, "y": 0}
    assert made.graph == {"name": "square", "metamodel": "burning_forest"}


def test_edges_have_the_reference_as_key():
    made = to_networkx(forest(2))
    assert set(made.edges(1, keys=True)) == {(1, 2, "right"), (1, 3, "down")}
    assert set(made.in_edges(1, keys=True)) == {
        (0, 1, "states"), (2, 1, "left"), (3, 1, "up"), (5, 1, "currentState"),
    }  # fmt: skip


def test_networkx_algorithms_apply():
    model = forest()
    made = to_networkx(model)
    ways = made.edge_subgraph(edge for edge in made.edges(keys=True) if edge[2] in ("right", "down"))
    path = nx.shortest_path(ways, model["t00"].id, model["t22"].id)
    assert len(path) == 5


def test_networkx_round_trips_restore_the_model():
    model = forest()
    model["t00"].x = None
    again = from_networkx(to_networkx(model), FOREST)
    assert again.state_hash() == model.state_hash()
    assert again["truck"].currentState == again["t00"]
    again.check_integrity()


def test_labels_of_any_kind_are_numbered_in_their_order():
    made = graph(("a", {"class": "Person", "nick": "A"}), ("b", {"class": "Person"}), edges=[("a", "b", "likes")])
    model = from_networkx(made, PEOPLE)
    assert model.node(0).nick == "A"
    assert model.node(0).likes == [model.node(1)]
    assert model.node(1).nick is None


@pytest.mark.parametrize(
    ("made", "error", "text"),
    [
        ([], InvalidArgument, "MultiDiGraph"),
        (nx.DiGraph(), InvalidArgument, "MultiDiGraph"),
        (nx.MultiGraph(), InvalidArgument, "MultiDiGraph"),
        (graph(("a", {})), InvalidArgument, "node 'a': 'class' must be the name of a class, not None"),
        (graph(("a", {"class": "Dgo"})), TypeMismatch, "node 'a': unknown class `Dgo`; did you mean `Dog`?"),
        (graph((1, {"class": "Dog", "object_name": 3})), InvalidArgument, "the name 3, which is not a string"),
        (
            graph((1, {"class": "Person", "nik": "a"})),
            InvalidArgument,
            "node 1: `Person` has no attribute `nik`; did you mean `nick`?",
        ),
        (graph((1, {"class": "Person", "nick": 1})), TypeMismatch, "node 1: `Person.nick` takes string"),
        (
            graph((1, {"class": "Person"}), edges=[(1, 1, "nick")]),
            InvalidArgument,
            "an edge from node 1 has the key 'nick', which is not a reference of `Person`",
        ),
        (graph((1, {"class": "Dog"}), edges=[(1, 1)]), InvalidArgument, "has the key 0"),
        (graph((1, {"class": "Dog"}), edges=[(1, 1, "owner")]), TypeMismatch, "leads to `Person`"),
        (
            graph(
                (0, {"class": "Group"}), (1, {"class": "Group"}), (2, {"class": "Dog"}),
                edges=[(0, 2, "pet"), (1, 2, "pet")],
            ),
            RuleError,
            "`Dog#2` has two containers",
        ),
    ],
)  # fmt: skip
def test_networkx_graphs_that_violate_the_metamodel_are_refused(made, error, text):
    with pytest.raises(error) as caught:
        from_networkx(made, PEOPLE)
    assert text in str(caught.value)


def test_attributes_that_clash_with_the_format_are_refused():
    metamodel = Metamodel("m", [Class("A", features=(Attribute("class", Scalar.INT),))])
    with pytest.raises(InvalidArgument, match=r"`A.class` has the name of a node attribute"):
        to_networkx(Model(metamodel))
