"""Copies of models, and models on the way to a worker process: made from their JSON, without versions and listeners."""

from __future__ import annotations

import copyreg
from collections.abc import Callable

from envgraph.graph._model import Model


def reduced(model: Model) -> tuple[Callable[..., Model], tuple[object, ...], dict[str, object]]:
    """Return what `copy` and `pickle` make a model from."""
    from envgraph.graph.interchange._json import model_from_json, model_to_json  # few programs need it

    return (
        model_from_json,
        (model_to_json(model), model.metamodel),
        {"places": model.places, "digits": model.digits},
    )


copyreg.pickle(Model, reduced)
