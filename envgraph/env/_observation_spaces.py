"""Convert the components of an observation to an observation in a Gymnasium space.

`observation="index"` is one number, "multi" the components, "flat" the components as concatenated one-hot vectors,
"dict" the components by name. A float is an entry of its own in "flat" and "dict", and in no other of these.
Observations of the whole model are in `_model_views`.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from decimal import Decimal
from math import prod
from typing import Any, Final, Literal, get_args

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from envgraph.env._flat_observations import FlatLayout
from envgraph.env._float_ranges import FloatRange
from envgraph.errors import LARGEST_INT, InvalidArgument, check_known

ObservationKind = Literal["index", "multi", "flat", "dict", "image", "graph", "padded_graph", "text"]

OBSERVATION_KINDS: Final = get_args(ObservationKind)
MODEL_KINDS: Final = ("image", "graph", "padded_graph", "text")
"""The kinds that are computed from the model; tables do not support them."""

MAX_CACHED_OBSERVATIONS: Final = 2**14
"""Maximum number of cached observations; a full cache is cleared. Not measured: one takes some microseconds."""


def check_observation_kind(kind: object) -> None:
    """Raise an error if an observation kind is unknown; None, for the default, is known.

    Raises:
        InvalidArgument: the kind is unknown.
    """
    if kind is not None:
        check_known(kind, OBSERVATION_KINDS, f"unknown kind of observation {kind!r}")


class ObservationCache:
    """A cache of observations by the state or index that they are computed from.

    Args:
        arrays: the names of the arrays in observations "dict"; the other components are numbers.
    """

    def __init__(self, arrays: Iterable[str] = ()) -> None:
        self._known: dict[Hashable, Any] = {}
        self._arrays = tuple(arrays)

    def get(self, key: Hashable, compute: Callable[[], Any]) -> Any:
        """Return a copy of the cached observation for a key; if it is not cached, `compute` computes it."""
        found = self._known.get(key)
        if found is None:
            if len(self._known) >= MAX_CACHED_OBSERVATIONS:
                self._known.clear()
            found = self._known[key] = compute()
        if isinstance(found, str):
            return found
        if isinstance(found, dict):
            return found | {name: found[name].copy() for name in self._arrays}
        return spaces.GraphInstance(*map(np.copy, found)) if isinstance(found, tuple) else found.copy()


class ComponentView:
    """A conversion of observation components to observations in a Gymnasium space.

    Args:
        kind: "index", "multi", "flat" or "dict". None: "flat" if a component is a float, otherwise "index".
        shape: sizes of the components; the first varies fastest in an index. If empty, there is one of size 1.
        names: the names of the components; if empty, these are numbers from 1.

    Raises:
        InvalidArgument: another kind, a float with "index" or "multi", or more observations than "index" can number.

    Attributes:
        space: the space of the observations.
        is_one_hot: True for "flat" without floats.
    """

    def __init__(self, kind: ObservationKind | None, shape: Sequence[int], names: Sequence[str]) -> None:
        check_observation_kind(kind)
        kind = kind or ("flat" if any(isinstance(size, FloatRange) for size in shape) else "index")
        if kind in MODEL_KINDS:
            hint = 'make the environment with `engine="compiled"` or `"live"`'
            raise InvalidArgument(
                f'an observation "{kind}" is computed from the model, which a table does not have', hint
            )
        self._layout = FlatLayout(tuple(shape) or (1,))
        self._floats = {names[place]: (place, FlatLayout([shape[place]])) for place in self._layout.floats}
        if kind in ("index", "multi") and self._floats:
            message = f'the float `{next(iter(self._floats))}` has no index, which an observation "{kind}" needs'
            raise InvalidArgument(message, 'use `observation="flat"` or "dict"')
        if kind == "index" and prod(shape) > LARGEST_INT:
            message = f"{Decimal(prod(shape)):.3g} observations cannot be numbered: the maximum is {LARGEST_INT:,}"
            hint = 'observe less, or use `observation="flat"`, "multi", "dict", "image", "graph" or "text"'
            raise InvalidArgument(message, hint)
        self.kind: ObservationKind = kind
        self.is_one_hot = kind == "flat" and not self._floats
        self._shape = tuple(shape) or (1,)
        self._names = tuple(names) or tuple(str(place) for place in range(1, len(self._shape) + 1))
        self._memory = ObservationCache(self._floats)
        self.space = self._space()

    def _space(self) -> spaces.Space[Any]:
        match self.kind:
            case "index":
                return spaces.Discrete(int(np.prod(self._shape, dtype=object)))
            case "multi":
                return spaces.MultiDiscrete(list(self._shape))
            case "flat":
                return spaces.Box(*self._layout.bounds(), dtype=np.float32)
            case _:
                sizes = zip(self._names, map(int, self._shape), strict=True)
                found: dict[str, spaces.Space[Any]] = {name: spaces.Discrete(size) for name, size in sizes}
                found |= {name: spaces.Box(*one.bounds(), dtype=np.float32) for name, (_, one) in self._floats.items()}
                return spaces.Dict(found)

    def from_index(self, index: int) -> Any:
        """Return a copy of the observation with an index, which may be larger than int64 allows."""
        if self.kind == "index":
            return np.int64(index)
        return self._memory.get(index, lambda: self.from_components(split_index(index, self._shape)))

    def from_components_cached(self, parts: NDArray[np.int64]) -> Any:
        """Return the observation with these components, cached; not for "index"."""
        return self._memory.get(parts.tobytes(), lambda: self.from_components(parts.copy()))

    def from_components(self, parts: NDArray[np.int64]) -> Any:
        """Convert components, on the last axis of `parts`, to observations; not for "index"."""
        match self.kind:
            case "multi":
                return parts
            case "flat":
                return self._layout.encode(parts)
            case _:
                columns = np.moveaxis(parts, -1, 0)
                found: dict[str, NDArray[Any]] = {name: columns[place] for place, name in enumerate(self._names)}
                floats = self._floats.items()
                return found | {name: one.encode(parts[..., place : place + 1]) for name, (place, one) in floats}

    def __reduce__(self) -> tuple[type[ComponentView], tuple[Any, ...]]:
        return ComponentView, (self.kind, self._shape, self._names)


def split_index(observation: NDArray[np.int64] | int, shape: Sequence[int]) -> NDArray[np.int64]:
    """Return the components of observations given by index, on a new last axis; the first component varies fastest."""
    if isinstance(observation, int):
        found = []
        for size in shape or (1,):
            observation, part = divmod(observation, size)
            found.append(part)
        return np.array(found, dtype=np.int64)
    parts = np.unravel_index(observation, tuple(shape) or (1,), order="F")
    return np.stack([np.asarray(part, dtype=np.int64) for part in parts], axis=-1)
