"""Read and write enumerated environments as files: NumPy's `.npz` with the arrays, and JSON for the rest; no pickle.

Equal environments give equal files.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from envgraph.env._enumeration import ExploredEnvironment
from envgraph.env._tabular import Tabular
from envgraph.env.scene._scene import Edge, GraphScene, GridScene, Mark, Scene
from envgraph.errors import LIMITS, InvalidArgument
from envgraph.metamodel import Glyph

_ARRAYS = {
    "next_state": np.int32,
    "probability": np.float64,
    "reward": np.float64,
    "terminated": np.int8,
    "observation": np.int64,
    "start_states": np.int32,
    "start_probability": np.float64,
}
_OPTIONAL = {"turn": np.int32, "allowed": np.bool_}
_NAMES = ("n_observations", "observation_shape", "observation_names", "action_names", "agent_names")
_DATA = {cls.__name__: cls for cls in (GridScene, GraphScene, Mark, Edge, Glyph)}
_DAMAGE_ERRORS = (
    OSError,
    ValueError,
    LookupError,
    TypeError,
    EOFError,
    RuntimeError,
    MemoryError,
    zipfile.BadZipFile,
    zlib.error,
)


def write_explored(explored: ExploredEnvironment, file: IO[bytes]) -> None:
    """Write an environment to a file that is open for writing."""
    tabular = explored.tabular
    arrays: dict[str, Any] = {name: getattr(tabular, name) for name in _ARRAYS}
    for name in _OPTIONAL:
        if getattr(tabular, name) is not None:
            arrays[name] = getattr(tabular, name)
    numbers: dict[Scene, int] = {}
    scene = [numbers.setdefault(picture, len(numbers)) for picture in explored.pictures]
    facts = {name: getattr(tabular, name) for name in _NAMES}
    text = json.dumps({**facts, "scenes": _to_json(tuple(numbers))}, ensure_ascii=False)
    arrays["scene"] = np.array(scene, dtype=np.int32)
    arrays["facts"] = np.frombuffer(text.encode("utf-8"), dtype=np.uint8)
    np.savez_compressed(file, **arrays)


def read_explored(path: Path) -> ExploredEnvironment:
    """Read an environment from a file of `write_explored`.

    Raises:
        InvalidArgument: the file does not exist, is damaged, or was written by another version.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(part.file_size for part in archive.infolist()) > LIMITS["table bytes"]:
                raise ValueError(f"its arrays have more than {LIMITS['table bytes']:,} bytes")
            bad = archive.testzip()  # before any damaged size is used
        if bad is not None:
            raise ValueError(f"`{bad}` is damaged")
        with np.load(path, allow_pickle=False) as found:
            return _parse_explored(found)
    except _DAMAGE_ERRORS as error:
        raise InvalidArgument(f"{path} is not a readable table of states: {error}") from error


def _parse_explored(found: Mapping[str, NDArray[Any]]) -> ExploredEnvironment:
    facts = json.loads(found["facts"].tobytes())
    arrays: dict[str, Any] = {name: found[name].astype(kind, copy=False) for name, kind in _ARRAYS.items()}
    names: dict[str, Any] = {name: _from_json(facts[name]) for name in _NAMES}
    for name, kind in _OPTIONAL.items():
        if name in found:
            arrays[name] = found[name].astype(kind, copy=False)
    tabular = Tabular(**arrays, **names)
    tabular.check()
    scenes = _from_json(facts["scenes"])
    return ExploredEnvironment(tabular, tuple(scenes[number] for number in found["scene"].tolist()))


def _to_json(value: Any) -> Any:
    """Return a value as data for JSON: tuples become lists, bytes and dataclasses become dicts."""
    if isinstance(value, tuple):
        return [_to_json(one) for one in value]
    if isinstance(value, bytes):
        return {"bytes": value.hex()}
    if is_dataclass(value):
        return {
            "is": type(value).__name__,
            **{one.name: _to_json(getattr(value, one.name)) for one in fields(value)},
        }
    return value


def _from_json(value: Any) -> Any:
    """Return the value that `_to_json` has converted to data for JSON."""
    if isinstance(value, list):
        return tuple(_from_json(one) for one in value)
    if not isinstance(value, dict):
        return value
    if "bytes" in value:
        return bytes.fromhex(value["bytes"])
    return _DATA[value["is"]](**{name: _from_json(one) for name, one in value.items() if name != "is"})
