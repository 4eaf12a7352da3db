"""The model: a typed attributed graph with one undo log, transactions and versions.

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

from envgraph.code import export_lazily
from envgraph.graph.interchange import _copying  # noqa: F401, how models are copied

if TYPE_CHECKING:
    from envgraph.graph.compare._described_changes import ModelSnapshot as ModelSnapshot
    from envgraph.graph.compare._isomorphism import IsomorphismClasses as IsomorphismClasses
    from envgraph.graph.history._delayed_interrupts import (
        defer_interrupts as defer_interrupts,
        guarded_contextmanager as guarded_contextmanager,
    )
    from envgraph.graph.history._history import Savepoint as Savepoint, UndoneChanges as UndoneChanges
    from envgraph.graph.history._version_tree import Version as Version
    from envgraph.graph.interchange._model_json import (
        JsonPath as JsonPath,
        json_place as json_place,
        model_from_json as model_from_json,
        model_schema as model_schema,
        model_to_json as model_to_json,
    )
    from envgraph.graph.interchange._model_xmi import (
        arrange_targets as arrange_targets,
        ecore_default as ecore_default,
        model_to_xmi as model_to_xmi,
    )
    from envgraph.graph.interchange._networkx import (
        from_networkx as from_networkx,
        to_networkx as to_networkx,
    )
    from envgraph.graph.model._graph import Graph as Graph
    from envgraph.graph.model._handles import Node as Node, Targets as Targets, ValueList as ValueList
    from envgraph.graph.model._model import Model as Model
    from envgraph.graph.model._model_picture import PictureOptions as PictureOptions
    from envgraph.graph.model._multiplicities import (
        Violation as Violation,
        check_conformance as check_conformance,
    )
    from envgraph.graph.model._query_features import (
        FeatureDefinition as FeatureDefinition,
        first_object_with_value as first_object_with_value,
    )
    from envgraph.graph.model._value_texts import object_text as object_text, value_text as value_text
    from envgraph.graph.store._followers import Follower as Follower
    from envgraph.graph.store._relation import ReferenceStorage as ReferenceStorage
    from envgraph.graph.store._store import Store as Store
    from envgraph.graph.store._undo_log import (
        ADDED as ADDED,
        ASSIGNED as ASSIGNED,
        OVERWRITTEN as OVERWRITTEN,
        REMOVED as REMOVED,
        IndexedSet as IndexedSet,
        state_before_overwriting as state_before_overwriting,
    )

export_lazily(globals())
