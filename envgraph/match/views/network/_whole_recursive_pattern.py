"""Compute all rows of a recursive pattern on demand, with a view network that is recomputed after model changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from envgraph.match._matcher import Row
from envgraph.match.generate._symbols import ResultMode
from envgraph.match.views.network._view_network import Network
from envgraph.match.views.operators._materialized_view import unrecorded

if TYPE_CHECKING:
    from envgraph.match.demand._compiled_functions import CompiledProgram


def make_whole_pattern_lister(program: CompiledProgram, pattern: str) -> Callable[[], list[Row]] | None:
    """Return a function that lists all rows of a recursive pattern in ascending order; None without delta functions.

    The rows are cached until the model changes. The list must not be changed.
    """
    store = program.model.graph.store
    network = Network(
        store,
        program.library,
        program.calls,
        lambda source: program.build(source, network.operator_value),
        lambda name: program.query_function(name, (), ResultMode.ROWS),
    )
    with unrecorded(store):  # its relations belong to no version
        view = network.recursive(pattern)
    if view is None:
        return None
    held = view.rows
    answer: list[Row] = []
    revision = -1

    def rows() -> list[Row]:
        nonlocal answer, revision
        if revision != store.revision:
            network.recompute_unrecorded()
            answer = sorted(held)
            revision = store.revision
        return answer

    return rows
