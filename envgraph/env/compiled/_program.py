"""A behaviour compiled: text, compiled with numba or run by Python, and the data of a family."""

from __future__ import annotations

import importlib.util
import inspect
import sys
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from types import ModuleType
from typing import Any, Final, Literal
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from envgraph import code
from envgraph.behaviour import Behaviour
from envgraph.code import dataclass
from envgraph.env._agents import named_agents
from envgraph.env._keys import KeyIndex, indexed_classes
from envgraph.env._simulator import Simulator
from envgraph.env.compiled import _kernels, _learning, _listing
from envgraph.env.compiled._behaviour import Text, written
from envgraph.env.compiled._layout import Arrays, Layout
from envgraph.env.compiled._member import Member, strings_of
from envgraph.env.compiled._refused import Misfit, NotCompiled
from envgraph.env.compiled._twin import Twin
from envgraph.files import cache_directory, replace_file
from envgraph.rewrite import Engine

Purpose = Literal["step", "list", "learn"]

PURPOSES: Final[Mapping[Purpose, tuple[Sequence[ModuleType], Sequence[str]]]] = {
    "step": ((_kernels,), ("reset_all", "step_all")),
    "list": ((_kernels, _listing), ("visit_starts", "visit", "hash_all")),
    "learn": ((_kernels, _learning), ("learn", "follow", "hash_all")),
}
"""The texts that a program has besides its own, and the functions that are called from outside."""


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """A compiled behaviour with a family.

    Attributes:
        source: the text of the program, without what all programs have.
        arrays: the data of the members.
        action_names: of the actions.
        observation_shape: sizes of the components of an observation.
        members: as data.
        layout: what is where.
        levels, width: how many stretches of rows there are, and how many columns.
        native: whether numba has compiled it.
    """

    source: str
    arrays: Arrays
    action_names: tuple[str, ...]
    observation_shape: tuple[int, ...]
    members: tuple[Member, ...]
    layout: Layout
    behaviour: Behaviour
    keys: KeyIndex
    levels: int
    width: int
    native: bool

    def functions(self, purpose: Purpose) -> Mapping[str, Callable[..., Any]]:
        """The functions for a purpose; compiled when they are first asked for."""
        return _functions(self.source, self.native, purpose)

    def __deepcopy__(self, _: object) -> Program:
        return self

    def over(self, engine: Engine, keys: KeyIndex) -> Program:
        """The program with another model as its only member.

        Args:
            engine: its model is the member.
            keys: the indices of its objects.

        Raises:
            Misfit: it was written for other members; `program_of` writes another.
        """
        if keys != self.keys:
            raise Misfit("keys")
        strings = _numbered(strings_of(engine), self.layout)
        member = Member(engine, keys, strings, engine.library)
        arrays = self.layout.arrays([member], len(member.objects), strings)
        return replace(self, arrays=arrays, members=(member,))

    def agent_names(self, number: int) -> tuple[str, ...]:
        """The names of a member's agents, in the order of their turns; () for a behaviour without agents."""
        member = self.members[number]
        return tuple(name for name, _ in named_agents(self.behaviour, member.model, self.keys))

    def twin(self, number: int) -> Twin:
        """The live engine of a member, put into states."""
        member = self.members[number]
        simulator = Simulator(member.engine, self.behaviour, self.keys)
        return Twin(simulator, member, self.layout, self.arrays.offsets)


def program_of(
    engine: Engine,
    behaviour: Behaviour,
    members: Iterable[Engine] | None = None,
    keys: KeyIndex | None = None,
    *,
    native: bool | None = None,
    broken: Iterable[Hashable] = (),
) -> Program:
    """Compile a behaviour.

    Args:
        engine: of the domain: has the patterns and rules; plans go by the sizes of its model.
        behaviour: free of errors.
        members: an engine for each member of the family, in its initial state; that one alone if None.
        keys: the indices of objects over the family; those of the first engine's model alone if None.
        native: whether to compile it with numba; None: if that is installed.
        broken: assumptions that are not made, because other members do not meet them.

    Raises:
        NotCompiled: something in it only the live engine has.
    """
    behaviour = engine.library.resolved(behaviour)
    keys = keys or KeyIndex.of(engine.model, indexed_classes(behaviour, engine.model.metamodel))
    engines = [engine] if members is None else list(members)
    for each in engines:
        _check_agents(behaviour, each)
    unmet = {*broken}
    known = {text for each in engines for text in strings_of(each)}
    while True:
        layout = Layout(unmet)
        text = written(engine, behaviour, keys, layout)
        strings = _numbered(known, layout)
        data = [Member(each, keys, strings, engine.library) for each in engines]
        try:
            arrays = layout.arrays(data, max(len(each.objects) for each in data), strings)
        except Misfit as misfit:
            unmet.add(misfit.assumption)
            continue
        return _compiled(text, arrays, native, data, behaviour, keys)


def _numbered(texts: Iterable[str], layout: Layout) -> dict[str, int]:
    """The number of each string of a family and of its program."""
    return {text: number for number, text in enumerate(sorted({*texts, *layout.texts}))}


def has_numba() -> bool:
    """Whether programs can be compiled."""
    return importlib.util.find_spec("numba") is not None


def _check_agents(behaviour: Behaviour, engine: Engine) -> None:
    for agent in behaviour.agents:
        if not engine.model.extent(agent.cls):
            raise NotCompiled(f"agents that a model has none of (`{agent.cls}`)", agent.span)


def _compiled(
    text: Text,
    arrays: Arrays,
    native: bool | None,
    members: Sequence[Member],
    behaviour: Behaviour,
    keys: KeyIndex,
) -> Program:
    source = code.printed(text.functions).text
    native = has_numba() if native is None else native
    return Program(
        source,
        arrays,
        text.action_names,
        text.shape,
        tuple(members),
        text.layout,
        behaviour,
        keys,
        text.levels,
        text.width,
        native,
    )


@lru_cache(maxsize=64)
def _functions(source: str, native: bool, purpose: Purpose) -> Mapping[str, Callable[..., Any]]:
    """The functions of a program that are called from outside; what several families share is compiled once."""
    modules, called = PURPOSES[purpose]
    text = "\n\n".join([*map(inspect.getsource, modules), source])
    namespace = _native(text, called) if native else _interpreted(text)
    quiet: Any = (lambda function: function) if native else np.errstate(all="ignore")
    return {name: quiet(namespace[name]) for name in called}


def _interpreted(source: str) -> dict[str, Any]:
    """The functions of a text, run by Python."""
    namespace: dict[str, Any] = {"__name__": "program"}
    code.define_text(source, "<program of envgraph>", namespace)
    namespace.update(
        uniform=_uniform,
        hash_row=_hash_row,
        at=int,
        count_bits=lambda word: int(word).bit_count(),
        arrays_at=lambda arrays: arrays,
    )
    return namespace


def _native(source: str, called: Sequence[str]) -> dict[str, Any]:
    """The functions of a text, compiled by numba; it caches them beside a file with the text, named by its hash."""
    import numba

    from envgraph.env.compiled import _addresses

    known = numba.__version__, inspect.getsource(_addresses), source
    digest = sha256("\n".join(known).encode()).hexdigest()[:32]
    path = Path("programs") / f"program_{digest}.py"
    folder, kept = cache_directory(), False
    if folder is not None:
        path = folder / path
        with suppress(OSError):  # a directory that cannot be written keeps nothing
            path.parent.mkdir(parents=True, exist_ok=True)
            if not path.exists():
                replace_file(path, source)
            kept = True
    module = ModuleType(path.stem)
    sys.modules[path.stem] = module  # numba looks there for the functions of what it has cached
    namespace = vars(module)
    code.define_text(source, str(path), namespace)
    options: Any = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}
    inside: Any = {**options, "forceinline": True, "no_cpython_wrapper": True}
    inner, outer = numba.njit(**inside), numba.njit(nogil=True, cache=kept, **options)
    for name, value in list(namespace.items()):
        if inspect.isfunction(value) and value.__module__ == path.stem:
            namespace[name] = (outer if name in called else inner)(value)
    namespace["arrays_at"] = inner(_addresses.arrays_at)
    return namespace


def _uniform(states: Any, row: int) -> float:
    """NumPy's PCG64, with Python's ints."""
    lo, hi, inc_lo, inc_hi = (int(part) for part in states[row])
    state = (hi << 64 | lo) * 0x2360ED051FC65DA44385DF649FCCF645 + (inc_hi << 64 | inc_lo)
    lo, hi = state & _WORD, state >> 64 & _WORD
    states[row, 0], states[row, 1] = lo, hi
    mixed, turns = hi ^ lo, hi >> 58
    mixed = (mixed >> turns | mixed << (-turns & 63)) & _WORD
    return (mixed >> 11) * 2.0**-53


_WORD: Final = 2**64 - 1


def _hash_row(states: Any, floats: Any, row: int) -> Any:
    """A hash of a state, where whole numbers are Python's."""
    return np.uint64(crc32(states[row].tobytes() + floats[row].tobytes()))


def streams(generators: Sequence[np.random.Generator]) -> np.ndarray[Any, np.dtype[np.uint64]]:
    """The states of NumPy's generators, a row each."""
    rows = []
    for generator in generators:
        state: Any = generator.bit_generator.state["state"]
        rows.append([state["state"] & _WORD, state["state"] >> 64, state["inc"] & _WORD, state["inc"] >> 64])
    return np.array(rows, dtype=np.uint64).reshape(len(rows), 4)


def set_stream(generator: np.random.Generator, row: NDArray[np.uint64]) -> None:
    """Put a generator where a row of `streams` is."""
    state: Any = generator.bit_generator.state
    state["state"]["state"] = int(row[1]) << 64 | int(row[0])
    state.update(has_uint32=0, uinteger=0)
    generator.bit_generator.state = state
