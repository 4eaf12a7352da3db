"""Names of environments for `gymnasium.make`.

Gymnasium 1.x runs no plugins: an environment is known once `envgraph.env` has been imported, by an import of the user's
or by the prefix of `gymnasium.make("envgraph.env:envgraph/BurningForest-v0")`.

What is registered is the name of a function as text. Gymnasium imports it when an environment is made, so that this
package needs to know nothing of files, families and run stores, which are the business of later layers.
"""

from __future__ import annotations

from typing import Any

import gymnasium
from gymnasium.envs.registration import EnvSpec

from envgraph.errors import InvalidArgument

NAMESPACE = "envgraph"

MAKE_ENVIRONMENT = "envgraph.search:make_environment"
MAKE_VECTOR_ENVIRONMENT = "envgraph.search:make_vector_environment"

BUNDLED = (
    ("BurningForest", "burning_forest", 200, False),
    ("KeyDoor", "keydoor", 100, False),
    ("Routing", "network", 64, True),
    ("Warehouse", "warehouse", 300, True),
)
"""Name, folder under `rules/`, time limit, and whether there are too many states for a table, of every bundled one."""


def register(
    name: str,
    /,
    *,
    entry_point: str = MAKE_ENVIRONMENT,
    vector_entry_point: str | None = None,
    limit: int | None = None,
    **kwargs: Any,
) -> str:
    """Register an environment as `envgraph/<name>-v0`; the same again changes nothing.

    Args:
        name: letters, digits, `_`, `.` and `-`.
        entry_point: "module:function"; the function is called with `kwargs` and those of `gymnasium.make`.
        vector_entry_point: the same for `gymnasium.make_vec`; without it that steps copies one after the other.
        limit: steps after which Gymnasium truncates an episode.
        **kwargs: ready for JSON.

    Returns:
        The id.

    Raises:
        InvalidArgument: the id stands for something else already, or is malformed.
    """
    id_ = f"{NAMESPACE}/{name}-v0"
    try:
        wanted = EnvSpec(
            id_,
            entry_point=entry_point,
            vector_entry_point=vector_entry_point,
            max_episode_steps=limit,
            kwargs=kwargs,
        )
    except gymnasium.error.Error as error:
        raise InvalidArgument(f"`{name}` cannot name an environment: {error}") from None
    known = gymnasium.registry.get(id_)
    if known is None:
        gymnasium.register(
            id_,
            entry_point=entry_point,
            vector_entry_point=vector_entry_point,
            max_episode_steps=limit,
            kwargs=kwargs,
        )
    elif known != wanted:
        raise InvalidArgument(f"`{id_}` is registered already, for something else")
    return id_


def register_entry_point() -> None:
    """Register the bundled environments; `envgraph.env` does so when it is imported."""
    for name, domain, limit, live in BUNDLED:
        if live:
            register(name, limit=limit, domain=domain, live=True)
        else:
            register(name, limit=limit, vector_entry_point=MAKE_VECTOR_ENVIRONMENT, domain=domain)
