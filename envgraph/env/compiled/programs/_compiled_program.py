"""Compile a behaviour and a family to a program: source text, run with numba or by Python, and the members' data."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from envgraph import code
from envgraph.behaviour import Behaviour, KeyIndex, indexed_classes, unbound_names
from envgraph.code import dataclass
from envgraph.env._agent_order import named_agents
from envgraph.env._joint_steps import check_all_agents_exist
from envgraph.env._simulator import Simulator
from envgraph.env.compiled.kernels import (
    _episodes,
    _learning_kernels,
    _mask_kernels,
    _policy_network,
    _scripted_choices,
    _visit_kernels,
    step_kernels,
    values,
)
from envgraph.env.compiled.kernels._loading import has_numba, load_functions
from envgraph.env.compiled.layout._batch_arrays import FamilyArrays
from envgraph.env.compiled.layout._compiled_costs import COSTS
from envgraph.env.compiled.layout._member_data import NO_OBJECT, MemberEngines, ProgramMembers, strings_in_model
from envgraph.env.compiled.layout._not_compiled import AssumptionViolated
from envgraph.env.compiled.layout._program_layout import ProgramLayout
from envgraph.env.compiled.programs._live_counterpart import LiveCounterpart
from envgraph.env.compiled.steps._program_text import emit_program
from envgraph.errors import ResolutionError
from envgraph.rewrite import Engine

Purpose = Literal["step", "mask", "list", "learn", "play"]

PURPOSE_FUNCTIONS: Final[Mapping[Purpose, tuple[tuple[ModuleType, ...], tuple[str, ...]]]] = {
    "step": ((step_kernels,), ("advance",)),
    "mask": ((step_kernels, _scripted_choices, _mask_kernels), ("masks",)),
    "list": ((step_kernels, _scripted_choices, _visit_kernels), ("visit", "forget_last", "hash_all")),
    "learn": ((step_kernels, values, _learning_kernels, _episodes), ("learn", "follow", "hash_all")),
    "play": ((step_kernels, values, _policy_network, _episodes), ("follow",)),
}
"""For each purpose the fixed modules that precede a program's own text, and the functions that Python calls."""


@dataclass(frozen=True, slots=True, eq=False)
class CompiledProgram:
    """A compiled behaviour, with the data of the members of a family.

    Attributes:
        source: the program's own text, without the text that all programs share.
        arrays: the data of the members.
        action_names: the names of the actions, by number.
        observation_shape, observation_names: the sizes and names of the components of an observation.
        members: the members as numbers.
        layout: the offsets of tables and columns.
        row_regions, row_width: the number of regions of the row buffers, and the number of columns of a row.
        native: True if numba compiles the program.
        acting_agents: the number of agents that act in the same step, 1 if agents take turns.
    """

    source: str
    arrays: FamilyArrays
    action_names: tuple[str, ...]
    observation_shape: tuple[int, ...]
    observation_names: tuple[str, ...]
    members: ProgramMembers
    layout: ProgramLayout
    behaviour: Behaviour
    row_regions: int
    row_width: int
    native: bool
    acting_agents: int

    def functions_for(self, purpose: Purpose) -> Mapping[str, Callable[..., Any]]:
        """Return the functions for a purpose, by name; they are compiled at the first request."""
        modules, called = PURPOSE_FUNCTIONS[purpose]
        return load_functions(self.source, modules, called, native=self.native)

    @property
    def row_buffer_shape(self) -> tuple[int, int]:
        """Return the number of rows and columns of the row buffers that the program needs."""
        return self.region_size * self.row_regions, self.row_width

    @property
    def region_size(self) -> int:
        """Return the number of rows of a region of the row buffers: enough for all matches, and for a saved state."""
        sizes: Sequence[int] = (self.arrays.ints.shape[1], self.arrays.floats.shape[1])
        return max(step_kernels.CAPACITY, *sizes)

    def __deepcopy__(self, _: object) -> CompiledProgram:
        return self

    def with_model(self, engine: Engine, keys: KeyIndex) -> CompiledProgram:
        """Return a copy of the program whose only member is the engine's current model.

        Args:
            engine: the engine whose model becomes the member.
            keys: the indices of the model's objects.

        Raises:
            Misfit: the program does not fit the model; `compile_for_model` compiles another program.
        """
        if keys != self.members.keys:
            raise AssumptionViolated("keys")
        _joint_agents(self.behaviour, engine, keys)
        strings, created = self.layout.number_strings(strings_in_model(engine)), self.layout.created_classes
        members = ProgramMembers(MemberEngines.of_list([engine]), engine, keys, strings, created, self.members.spare)
        arrays = self.layout.fill_arrays(members, members[0].reserved_numbers.stop)
        if NO_OBJECT in strings.values():
            raise AssumptionViolated("strings")
        return replace(self, arrays=arrays, members=members)

    def agent_names(self, number: int) -> tuple[str, ...]:
        """Return the names of a member's agents in the order of their turns; () if agents do not take turns."""
        if not self.behaviour.agents or self.behaviour.together:
            return ()
        model = self.members[number].model
        return tuple(name for name, _ in named_agents(self.behaviour, model, self.members.keys))

    def live_counterpart(self, number: int) -> LiveCounterpart:
        """Return a live engine of a member, which can be put into states of the program."""
        simulator = Simulator(self.members.engines.make(number), self.behaviour, self.members.keys)
        return LiveCounterpart(simulator, self.members[number], self.layout, self.arrays.offsets)


def program_of(
    engine: Engine,
    behaviour: Behaviour,
    members: Iterable[Engine] | MemberEngines | None = None,
    keys: KeyIndex | None = None,
    *,
    native: bool | None = None,
    broken: Iterable[Hashable] = (),
    spare: int = COSTS.spare,
) -> CompiledProgram:
    """Compile a behaviour for the members of a family.

    Args:
        engine: supplies the patterns and rules; the sizes of its model guide the match plans.
        behaviour: a behaviour without errors.
        members: an engine in its initial state for each member, or access to them; None: `engine` is the only one.
        keys: the indices of objects over the family; None: those of the first engine's model.
        native: compile the program with numba; None: if numba is installed.
        broken: assumptions that the program must not make, because other members violate them.
        spare: how many objects created by rules a state may contain.

    Raises:
        NotCompiled: the behaviour contains a construct that only the live engine supports.
        ResolutionError: a model has no agent.
    """
    behaviour = engine.library.with_functions_resolved(behaviour)
    keys = keys or KeyIndex.of_model(engine.model, indexed_classes(behaviour, engine.model.metamodel))
    engines = members if isinstance(members, MemberEngines) else MemberEngines.of_list([*(members or [engine])])
    alone = ProgramMembers(engines, engine, keys)
    known, largest = set[str](), 0
    for _, member in alone.read_all():
        known |= strings_in_model(member.engine)
        seats, largest = _joint_agents(behaviour, member.engine, keys), max(largest, len(member.object_ids))
    unmet = {*broken}
    while True:
        layout = ProgramLayout(unmet)
        text = emit_program(engine, behaviour, keys, layout, seats)
        strings = layout.number_strings(known)
        data = replace(alone, strings=strings, created=layout.created_classes, spare=spare)
        try:
            arrays = layout.fill_arrays(data, largest + (spare if data.created else 0))
        except AssumptionViolated as misfit:
            unmet.add(misfit.assumption)
            continue
        if NO_OBJECT in strings.values():  # queries on the models have computed strings
            known.update(strings)
            continue
        return CompiledProgram(
            code.print_source(text.functions).text,
            arrays,
            text.action_names,
            text.shape,
            text.observation_names,
            data,
            text.layout,
            behaviour,
            text.levels,
            text.width,
            has_numba() if native is None else native,
            len(seats) or 1,
        )


def compile_for_model(
    known: dict[Any, CompiledProgram], engine: Engine, behaviour: Behaviour, keys: KeyIndex
) -> CompiledProgram:
    """Return a program whose only member is the engine's current model; reuse the text of a known program that fits.

    Args:
        known: a cache of programs of the behaviour by object indices, most recently used last. The result is added;
            if the cache is full, the first program is removed.
        engine, behaviour, keys: see `program_of`.

    Raises:
        NotCompiled: the behaviour contains a construct that only the live engine supports.
    """
    indices = tuple(keys.keys.items())
    last = known.pop(indices, None) or next(reversed(known.values()), None)
    broken: Iterable[Hashable] = () if last is None else last.layout.broken_assumptions
    try:
        made = last and last.with_model(engine, keys)
    except AssumptionViolated as misfit:
        made, broken = None, {*broken, misfit.assumption}
    known[indices] = made or program_of(engine, behaviour, keys=keys, broken=broken)
    if len(known) > COSTS.programs:
        del known[next(iter(known))]
    return known[indices]


def _joint_agents(behaviour: Behaviour, engine: Engine, keys: KeyIndex) -> tuple[tuple[str, int], ...]:
    """Return the name and block number of each agent if all agents act together; otherwise ().

    Raises:
        ResolutionError: the model has no agent, or agents act together and one is missing.
    """
    if behaviour.together:
        check_all_agents_exist(behaviour, engine.model, keys)
    named = named_agents(behaviour, engine.model, keys)
    if behaviour.agents and not named:
        raise ResolutionError(unbound_names(behaviour, engine.model))
    return tuple((name, block) for name, (_, block) in named) if behaviour.together else ()


def set_generator_state(generator: np.random.Generator, row: NDArray[np.uint64]) -> None:
    """Set the state of a PCG64 generator from a row of `streams`."""
    state: Any = generator.bit_generator.state
    for name, (low, high) in zip(("state", "inc"), row.reshape(2, 2).tolist(), strict=True):
        state["state"][name] = high << 64 | low
    state.update(has_uint32=0, uinteger=0)
    generator.bit_generator.state = state
