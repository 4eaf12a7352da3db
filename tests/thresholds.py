"""Sizes at which the engine changes its method. Tests lower them, so that small models meet every method."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import pytest

from envgraph.code import _body_builder
from envgraph.graph import Store
from envgraph.graph.history import _version_tree
from envgraph.match._match_costs import DemandCosts, PlanCosts, ViewCosts
from envgraph.match.views.delta import _value_views
from envgraph.match.views.watch import _watched_views

PLACES: Final[Mapping[str, tuple[object, str]]] = {
    # The journal: more targets have an index, and longer changes between versions are reduced to their net effect.
    "crowd of targets": (Store, "crowd"),
    "long change between versions": (_version_tree, "_LONG"),
    # Closures on demand: after so many searches the answer is computed for all nodes, and kept while there is room.
    "few nodes visited": (DemandCosts, "few_visited"),
    "times all nodes visited": (DemandCosts, "times"),
    "few nodes reached": (DemandCosts, "few_reached"),
    "most reached nodes kept": (DemandCosts, "most_reached"),
    "largest condensation": (DemandCosts, "most_bytes"),
    # Aggregates over closures: class by class, or object by object.
    "cost of a class": (DemandCosts, "class_cost"),
    "most classes": (DemandCosts, "most_classes"),
    "dense set": (DemandCosts, "dense"),
    # Recursion on demand: after so many questions all rows with a value are computed, and kept while there is room.
    "few rows of questions": (DemandCosts, "few_rows"),
    "few questions": (DemandCosts, "few_times"),
    "most rows kept": (DemandCosts, "most_rows"),
    # Plans: equal partial matches are dropped, and long functions are split.
    "few partial matches": (PlanCosts, "few_rows"),
    "most loops of a function": (_body_builder, "MAX_LOOP_DEPTH"),
    # Views: a model that grows so much has its views built anew, a long log is shortened, and large groups are updated.
    "growth of the model": (_watched_views, "GROWTH"),
    "least growth of the model": (_watched_views, "LEAST"),
    "long log": (ViewCosts, "long_log"),
    "large group": (ViewCosts, "large"),
    "few starts of a closure": (ViewCosts, "few_starts"),
    # Views are read, or have an index, where a search would cost more.
    "expensive search for a change": (ViewCosts, "min_indexed_cost"),
    "expensive search for a question": (ViewCosts, "expensive"),
    "cost of reading a row": (ViewCosts, "read"),
    # Attributes have an index by value where many objects have different values.
    "many objects": (ViewCosts, "many"),
    "different values": (ViewCosts, "different"),
    "value given by another goal": (_value_views, "_is_bound_elsewhere"),
    "attributes tested in a loop": (_value_views, "_tested_attributes"),
    # Loops of units: patterns are watched after so many rows.
    "long loop": (ViewCosts, "long_loop"),
    "cost of sorting a row": (ViewCosts, "sorted"),
}
"""Where the engine keeps each threshold. A value set in a class with slots hides the field of its only instance."""

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
