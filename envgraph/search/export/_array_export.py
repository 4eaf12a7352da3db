"""Write the transition tables of a family as one `.npz` file, or its members as maps of Gymnasium's FrozenLake."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from envgraph.env import Tabular, frozen_lake_arguments
from envgraph.errors import InvalidArgument, escape_unprintable
from envgraph.search.families._member_family import Family

_ARRAY_NAMES = (
    "next_state",
    "probability",
    "reward",
    "terminated",
    "observation",
    "start_states",
    "start_probability",
)


def write_tables(tables: Mapping[str, Tabular]) -> bytes:
    """Return the bytes of an `.npz` file without pickled objects. Equal tables give equal bytes.

    The arrays are `members`, `action_names` (texts) and `observation_shape`. For each member there are the arrays of
    its `Tabular`, such as "E1/next_state". If agents take turns, there are also "E1/turn" and "E1/agent_names".

    Args:
        tables: the tables by name of the member; all have the same actions and observations.
    """
    for name in tables:
        if "\0" in name or ".." in name.replace("\\", "/").split("/") or name[:1] in ("", "/"):
            raise InvalidArgument(f"`{escape_unprintable(name)}` is not a valid array name; rename the member")
    first = next(iter(tables.values()))
    arrays: dict[str, Any] = {
        "members": _text_array(tables),
        "action_names": _text_array(first.action_names),
        "observation_shape": np.array(first.observation_shape, dtype=np.int64),
    }
    for name, table in tables.items():
        arrays |= {f"{name}/{array}": getattr(table, array) for array in _ARRAY_NAMES}
        if table.turn is not None:
            arrays |= {f"{name}/turn": table.turn, f"{name}/agent_names": _text_array(table.agent_names)}
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def write_frozen_lake(family: Family) -> str:
    """Return the arguments of `gymnasium.make("FrozenLake-v1", ..)` for each member, by its name, as JSON text.

    Raises:
        InvalidArgument: a member cannot be expressed as a map of FrozenLake.
        EvaluationError: there are too many states.
    """
    if family.behaviour.agents:
        raise InvalidArgument(f"family `{family.name}` has `agent` blocks, but FrozenLake has a single agent")
    found = {}
    for member in family.members:
        try:
            found[member.name] = frozen_lake_arguments(family.explored(member, pictures=True), family.limit)
        except InvalidArgument as error:
            raise InvalidArgument(f"{member.name}: {error.message}", error.hint) from None
    return json.dumps(found, indent=1) + "\n"


def _text_array(names: Any) -> Any:
    return np.array([*names], dtype=np.str_)
