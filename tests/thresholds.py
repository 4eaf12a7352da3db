"""Sizes at which the engine changes its method. Tests lower them, so that small models meet every method."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import pytest

from envgraph.code import _block
from envgraph.graph import Store
from envgraph.graph.history import _versions
from envgraph.match.demand import _closure_aggregates, _closures, _condensation, _recursion
from envgraph.match.plan import _distinct
from envgraph.match.views.delta import _delta, _joins
from envgraph.match.views.operators import _closure, _group_aggregates, _sets
from envgraph.match.views.watch import _kept, _loops, _partial_lookup

PLACES: Final[Mapping[str, tuple[object, str]]] = {
    # The journal: more targets have an index, and longer changes between versions are reduced to their net effect.
    "crowd of targets": (Store, "crowd"),
    "long change between versions": (_versions, "_LONG"),
    # Closures on demand: after so many searches the answer is computed for all nodes, and kept while there is room.
    "few nodes visited": (_closures, "FEW_VISITED"),
    "times all nodes visited": (_closures, "TIMES"),
    "few nodes reached": (_closures, "FEW_REACHED"),
    "most reached nodes kept": (_closures, "MOST_KEPT"),
    "largest condensation": (_condensation, "MOST_BYTES"),
    # Aggregates over closures: class by class, or object by object.
    "cost of a class": (_closure_aggregates, "CLASS"),
    "most classes": (_closure_aggregates, "MOST_CLASSES"),
    "dense set": (_closure_aggregates, "DENSE"),
    # Recursion on demand: after so many questions all rows with a value are computed, and kept while there is room.
    "few rows of questions": (_recursion, "FEW_ROWS"),
    "few questions": (_recursion, "FEW_TIMES"),
    "most rows kept": (_recursion, "MOST_KEPT"),
    # Plans: equal partial matches are dropped, and long functions are split.
    "few partial matches": (_distinct, "FEW"),
    "most loops of a function": (_block, "MOST_LOOPS"),
    # Views: a model that grows so much has its views built anew, a long log is shortened, and large groups are updated.
    "growth of the model": (_kept, "GROWTH"),
    "least growth of the model": (_kept, "LEAST"),
    "long log": (_sets, "LONG"),
    "large group": (_group_aggregates, "LARGE"),
    "few starts of a closure": (_closure, "FEW"),
    # Views are read, or have an index, where a search would cost more.
    "expensive search for a change": (_delta, "DEAR"),
    "expensive search for a question": (_partial_lookup, "EXPENSIVE"),
    "cost of reading a row": (_partial_lookup, "READ"),
    # Attributes have an index by value where many objects have different values.
    "many objects": (_joins, "MANY"),
    "different values": (_joins, "DIFFERENT"),
    "value given by another goal": (_joins, "_met_elsewhere"),
    "attributes tested in a loop": (_joins, "_told_apart"),
    # Loops of units: patterns are watched after so many rows.
    "long loop": (_loops, "LONG"),
    "cost of sorting a row": (_loops, "SORTED"),
}
"""Where the engine keeps each threshold."""

EAGER: Final[Mapping[str, object]] = {
    "crowd of targets": 2,
    "long log": 4,
    "growth of the model": 1,
    "least growth of the model": 2,
    "large group": 1,
    "few starts of a closure": 0,
    "expensive search for a change": -1.0,
    "expensive search for a question": 0.0,
    "cost of reading a row": 0.5,
    "many objects": -1.0,
    "different values": 0,
    "value given by another goal": lambda body, _: len(body.goals) > 1,
    "attributes tested in a loop": lambda *_: range(100),
}
"""Views of small models do what they otherwise do seldom, or in large models: every row and value has an index."""


def set_thresholds(patch: pytest.MonkeyPatch, values: Mapping[str, object]) -> None:
    """Give thresholds other values until the patch is undone."""
    for name, value in values.items():
        owner, constant = PLACES[name]
        patch.setattr(owner, constant, value)
