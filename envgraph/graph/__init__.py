"""The model: a typed attributed graph with change events, one undo log, transactions and versions.

>>> from envgraph.graph import Model
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

from envgraph.code import later
from envgraph.graph.interchange import _copying  # noqa: F401, how models are copied

if TYPE_CHECKING:
    from envgraph.graph.compare._isomorphism import Shapes as Shapes
    from envgraph.graph.history._history import Savepoint as Savepoint, Shelf as Shelf
    from envgraph.graph.history._interrupts import deferred as deferred, guarded as guarded
    from envgraph.graph.history._versions import Version as Version
    from envgraph.graph.interchange._json import (
        JsonPath as JsonPath,
        json_place as json_place,
        model_from_json as model_from_json,
        model_schema as model_schema,
        model_to_json as model_to_json,
    )
    from envgraph.graph.interchange._networkx import (
        from_networkx as from_networkx,
        to_networkx as to_networkx,
    )
    from envgraph.graph.interchange._xmi import (
        arrange_targets as arrange_targets,
        model_to_xmi as model_to_xmi,
        usual_value as usual_value,
    )
    from envgraph.graph.model._conformance import (
        Violation as Violation,
        check_conformance as check_conformance,
    )
    from envgraph.graph.model._graph import Graph as Graph
    from envgraph.graph.model._model import Model as Model
    from envgraph.graph.model._node import Node as Node, Targets as Targets, ValueList as ValueList
    from envgraph.graph.model._picture import PictureOptions as PictureOptions
    from envgraph.graph.model._query_features import Defined as Defined, first_with as first_with
    from envgraph.graph.store._journal import (
        EXCHANGE as EXCHANGE,
        IN as IN,
        OUT as OUT,
        SET as SET,
        IndexedSet as IndexedSet,
    )
    from envgraph.graph.store._relation import Relation as Relation
    from envgraph.graph.store._store import Store as Store

later(globals())
