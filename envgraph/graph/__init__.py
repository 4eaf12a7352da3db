"""The model: a typed attributed graph with change events, one undo log, transactions and versions.

>>> from envgraph.metamodel import Attribute, Class, Metamodel, Reference, Scalar
>>> room = Class("Room", features=(Attribute("label", Scalar.STRING), Reference("doors", "Room", 0, None)))
>>> model = Model(Metamodel("house", [room]), "home")
>>> hall = model.create("Room", label="hall", object_name="hall")
>>> model.create("Room", label="attic").doors.append(hall)
>>> empty = model.commit()
>>> hall.label = "entrance"
>>> renamed = model.commit()
>>> model.checkout(empty)
>>> hall, hall.label
(<Room#0 hall>, 'hall')
"""

from typing import TYPE_CHECKING

from envgraph.errors import later, shorten
from envgraph.graph import _copying  # noqa: F401, how models are copied
from envgraph.graph._conformance import Violation, check_conformance
from envgraph.graph._facts import ClassFact, Fact, LinkFact, Listener, ValueFact
from envgraph.graph._graph import Graph
from envgraph.graph._history import Savepoint, Shelf
from envgraph.graph._interrupts import deferred, guarded
from envgraph.graph._isomorphism import Shapes
from envgraph.graph._journal import EXCHANGE, IN, OUT, SET, IndexedSet
from envgraph.graph._model import Model
from envgraph.graph._node import Node, Targets, ValueList
from envgraph.graph._picture import PictureOptions
from envgraph.graph._query_features import Defined, first_with
from envgraph.graph._relation import Relation
from envgraph.graph._store import Store
from envgraph.graph._versions import Version

if TYPE_CHECKING:
    from envgraph.graph.interchange._json import (
        JsonPath,
        json_place,
        model_from_json,
        model_schema,
        model_to_json,
    )
    from envgraph.graph.interchange._networkx import from_networkx, to_networkx
    from envgraph.graph.interchange._xmi import arrange_targets, model_to_xmi, usual_value

__all__ = [
    "EXCHANGE",
    "IN",
    "OUT",
    "SET",
    "ClassFact",
    "Defined",
    "Fact",
    "Graph",
    "IndexedSet",
    "JsonPath",
    "LinkFact",
    "Listener",
    "Model",
    "Node",
    "PictureOptions",
    "Relation",
    "Savepoint",
    "Shapes",
    "Shelf",
    "Store",
    "Targets",
    "ValueFact",
    "ValueList",
    "Version",
    "Violation",
    "arrange_targets",
    "check_conformance",
    "deferred",
    "first_with",
    "from_networkx",
    "guarded",
    "json_place",
    "model_from_json",
    "model_schema",
    "model_to_json",
    "model_to_xmi",
    "to_networkx",
    "usual_value",
]

later(
    globals(),
    {
        "envgraph.graph.interchange._json": "JsonPath json_place model_from_json model_schema model_to_json",
        "envgraph.graph.interchange._networkx": "from_networkx to_networkx",
        "envgraph.graph.interchange._xmi": "arrange_targets model_to_xmi usual_value",
    },
)
shorten(globals(), __all__)
