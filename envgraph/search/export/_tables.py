"""The tables of a family as one `.npz` file, or as maps of Gymnasium's FrozenLake."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from envgraph.env import Tabular, frozen_lake
from envgraph.errors import InvalidArgument, visible
from envgraph.search.families._family import Family

_ARRAYS = (
    "next_state",
    "probability",
    "reward",
    "terminated",
    "observation",
    "start_states",
    "start_probability",
)


def write_tables(tables: Mapping[str, Tabular]) -> bytes:
    """The bytes of an `.npz` file, without pickle; equal tables give equal bytes.

    Args:
        tables: by the name of the member; all have the same actions and observations.

    Returns:
        `members`, `action_names` (texts) and `observation_shape`; and for each member, "E1/next_state" and so on, the
        arrays of its `Tabular`, and where agents take turns "E1/turn" and "E1/agent_names".
    """
    for name in tables:
        if "\0" in name or ".." in name.replace("\\", "/").split("/") or name[:1] in ("", "/"):
            raise InvalidArgument(f"`{visible(name)}` is not a valid name of an array; rename the member")
    first = next(iter(tables.values()))
    arrays: dict[str, Any] = {
        "members": _texts(tables),
        "action_names": _texts(first.action_names),
        "observation_shape": np.array(first.observation_shape, dtype=np.int64),
    }
    for name, table in tables.items():
        arrays |= {f"{name}/{array}": getattr(table, array) for array in _ARRAYS}
        if table.turn is not None:
            arrays |= {f"{name}/turn": table.turn, f"{name}/agent_names": _texts(table.agent_names)}
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def write_frozen_lake(family: Family) -> str:
    """The arguments of `gymnasium.make("FrozenLake-v1", ..)` for each member, by its name, as JSON.

    Raises:
        InvalidArgument: a member is no map of FrozenLake.
        EvaluationError: there are too many states.
    """
    if family.behaviour.agents:
        raise InvalidArgument(f"family `{family.name}` has `agent` blocks: FrozenLake has one walker")
    found = {}
    for member in family.members:
        try:
            found[member.name] = frozen_lake(family.explored(member, pictures=True), family.limit)
        except InvalidArgument as error:
            raise InvalidArgument(f"{member.name}: {error.message}", error.hint) from None
    return json.dumps(found, indent=1) + "\n"


def _texts(names: Any) -> Any:
    return np.array([*names], dtype=np.str_)
