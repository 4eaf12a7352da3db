"""Copy and pickle models by way of their JSON, without versions and views."""

from __future__ import annotations

import copyreg
from collections.abc import Callable

from envgraph.graph.model._model import Model
from envgraph.metamodel import Metamodel, Value


def reduce_model(model: Model) -> tuple[Callable[..., Model], tuple[object, ...]]:
    """Return the function and arguments from which `copy` and `pickle` rebuild a model without versions and views."""
    from envgraph.graph.interchange._model_json import (
        model_to_json,  # imported here because few programs need it
    )

    return _rebuild_model, (
        model_to_json(model),
        model.metamodel,
        model.graph.grid_positions,
        model.graph.decimal_texts,
    )


def _rebuild_model(
    text: str, metamodel: Metamodel, places: dict[str, int], digits: dict[tuple[int, int, Value], str]
) -> Model:
    from envgraph.graph.interchange._model_json import model_from_json

    model = model_from_json(text, metamodel)
    model.graph.grid_positions, model.graph.decimal_texts = places, digits
    return model


copyreg.pickle(Model, reduce_model)
