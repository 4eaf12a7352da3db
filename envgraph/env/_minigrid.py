"""Read levels of MiniGrid as data for `envgraph adopt`, and check that a domain steps as the level does."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np

from envgraph.code import dataclass
from envgraph.env._observation_spaces import split_index
from envgraph.env._simulator import Simulator
from envgraph.env._tabular import Tabular
from envgraph.errors import TOLERANCE, InvalidArgument
from envgraph.metamodel import LARGEST_INT

_ACTIONS: Final = 7
"""Actions of every level of MiniGrid; a level with others is refused."""
_DIRECTIONS: Final = ("east", "south", "west", "north")
_TILES: Final = MappingProxyType({"wall": "#", "lava": "~", "floor": "_", "goal": "G"})
_THINGS: Final = MappingProxyType({"key": "Key", "ball": "Ball", "box": "Box"})
_DOORS: Final = "DABCEFHIJKLMNOPQRSTUVWXYZ"

SuccessKind = Literal["goal", "held", "opened"]
"""The kind of success: to stand on a goal, to hold the target object, or to have opened the door."""

_Place = tuple[int, int]
_State = tuple[tuple[Any, ...], _Place, int, Any, tuple[tuple[bool, bool], ...]]
"""The contents of the cells, the agent's position, direction and carried object; for each door (is open, is locked)."""


@dataclass(frozen=True, slots=True)
class LevelDoor:
    """A kind of door of a level, and its letter in the rows; `lock` is "open", "closed" or "locked"."""

    letter: str
    colour: str
    lock: str


@dataclass(frozen=True, slots=True)
class LevelObject:
    """A "Key", "Ball" or "Box" on a cell or in a box; `inside` is the name of the object that this box contains."""

    name: str
    cls: str
    colour: str
    place: _Place | None = None
    inside: str | None = None


class MiniGridLevel:
    """A level of MiniGrid after a reset; it stores its environment, to compare tables and domains with it step by step.

    Attributes:
        success_kind: the kind of success.
        mission: the instruction for the agent.
        rows: a letter for each cell: `#` a wall, `.` empty, `~` lava, `_` painted floor, `G` a goal, or a door's
            letter.
        doors: the kinds of doors; equal doors share one entry.
        objects: the objects that can be carried; the content of a box precedes the box.
        exit: the position (column, row) of the door to open, if opening it is the success; otherwise None.
        start, start_direction: the agent's position (column, row), and the direction it faces.
        limit: the maximum number of steps of an episode.
    """

    def __init__(self, inner: Any, end: SuccessKind) -> None:
        self.success_kind = end
        self.mission = str(inner.mission)
        self.limit: int = inner.max_steps
        self.start: _Place = int(inner.agent_pos[0]), int(inner.agent_pos[1])
        self.start_direction = _DIRECTIONS[inner.agent_dir]
        self.exit: _Place | None = None
        self.doors: list[LevelDoor] = []
        self.objects: list[LevelObject] = []
        self._inner = inner
        self._door_cells = [cell for cell in inner.grid.grid if cell is not None and cell.type == "door"]
        places = [[(x, y) for x in range(inner.width)] for y in range(inner.height)]
        self.rows = tuple("".join(map(self._cell_letter, row)) for row in places)
        self._start_state = self._current_state()
        values = inner.width * inner.height + 1
        if values ** (1 + len(self.objects)) * 3 ** len(self._door_cells) * 4 * (len(self.objects) + 1) > LARGEST_INT:
            message = f"a level of {values - 1} cells and {len(self.objects)} objects has too many observations"
            raise InvalidArgument(message, "choose a smaller level; at most 2**63 - 1 observations can be numbered")

    @classmethod
    def from_reset(cls, inner: Any, seed: int) -> MiniGridLevel:
        """Reset the environment with a seed and return the level; from now on, its steps return empty observations.

        Raises:
            InvalidArgument: its steps or rewards are not MiniGrid's own, or it contains unsupported objects.
        """
        base = minigrid_class(inner)
        inner.reset(seed=seed)
        inner.gen_obs = dict  # skips the observation, which takes most of the time of a step
        ends: tuple[SuccessKind, ...] = ("goal",) if type(inner).step is base.step else _success_kinds(inner)
        if not ends or type(inner)._reward is not base._reward or inner.action_space.n != _ACTIONS:
            hint = "choose a level with a goal, an object to pick up, or a door to open"
            raise InvalidArgument(
                f"`{type(inner).__name__}` changes the steps or rewards of MiniGrid in an unsupported way",
                hint,
            )
        return cls(inner, ends[0])

    def _cell_letter(self, place: _Place) -> str:
        cell = self._inner.grid.get(*place)
        if cell is None:
            return "."
        if cell.type in _TILES:
            return _TILES[cell.type]
        if cell.type == "door":
            if self.success_kind == "opened" and cell is self._inner.door:
                self.exit = place
            return self._door_letter(cell.color, "open" if cell.is_open else "locked" if cell.is_locked else "closed")
        self._add_object(cell, place)
        return "."

    def _door_letter(self, colour: str, lock: str) -> str:
        for door in self.doors:
            if (door.colour, door.lock) == (colour, lock):
                return door.letter
        self.doors.append(LevelDoor(_DOORS[len(self.doors)], colour, lock))
        return self.doors[-1].letter

    def _add_object(self, minigrid_object: Any, place: _Place | None) -> str:
        """Add a key, ball or box to `objects`, after the object inside it, and return its name; raise on other
        kinds.
        """
        if minigrid_object.type not in _THINGS:
            raise InvalidArgument(
                f"the level has a {minigrid_object.type} at {place}, which is not supported",
                f"choose a level whose objects are only {[*_THINGS]}",
            )
        inside = None if minigrid_object.contains is None else self._add_object(minigrid_object.contains, None)
        target = self.success_kind == "held" and minigrid_object is self._inner.obj
        name = "target" if target else f"thing{len(self.objects)}"
        self.objects.append(LevelObject(name, _THINGS[minigrid_object.type], minigrid_object.color, place, inside))
        return name

    def differences(self, table: Tabular) -> Iterator[str]:
        """Yield a text for each difference between the level and a table; nothing if both step equally.

        Every action is compared in every state; each state of the level must correspond to one state of the table.
        A random table, or one with several start states or without exactly 7 actions, yields only one text.
        """
        if len(table.start_states) != 1 or not table.deterministic or table.n_actions != _ACTIONS:
            yield "it has random outcomes or several start states, or not exactly 7 actions"
            return
        start = int(table.start_states[0])
        known, seen, todo = (
            {start: _state_key(self._start_state)},
            {_state_key(self._start_state)},
            [(start, self._start_state)],
        )
        while todo:
            state, before = todo.pop()
            for action in range(_ACTIONS):
                reported = self._step(before, action)
                here = state, action, 0
                to, over = int(table.next_state[here]), int(table.terminated[here])
                yield from _result_differences(action, reported, (float(table.reward[here]), over))
                after = self._current_state()
                if over or known.get(to) == _state_key(after):
                    continue
                if to in known or _state_key(after) in seen:
                    yield f"action {action} leads to another state"
                known[to] = _state_key(after)
                seen.add(known[to])
                todo.append((to, after))

    def shortest_sequences(self, max_states: int) -> tuple[list[list[int]], list[int]]:
        """Return shortest action sequences to new situations and to a success, by breadth-first search.

        A situation is the carried object, and which doors are open and locked. The search visits up to `max_states`
        states, and ends at the first success.

        Returns:
            The sequence to the first state of each situation, [] for the start; the sequence to a success, or [].
        """
        known = {hash(_state_key(self._start_state)): list[int]()}
        situations = {_state_key(self._start_state)[3:]: list[int]()}
        todo = deque([self._start_state])
        while todo and len(known) < max_states:
            before = todo.popleft()
            way = known[hash(_state_key(before))]
            for action in range(_ACTIONS):
                _, end = self._step(before, action)
                if end == 1:
                    return [*situations.values()], [*way, action]
                after = self._current_state()
                key = _state_key(after)
                if not end and hash(key) not in known:
                    known[hash(key)] = [*way, action]
                    situations.setdefault(key[3:], [*way, action])
                    todo.append(after)
        return [*situations.values()], []

    def compare_episode(
        self, simulator: Simulator, action_choices: Iterable[Sequence[int]], compared_states: set[Any]
    ) -> Iterator[str]:
        """Play an episode in a domain, and yield a text for each difference to the level in any visited state.

        In each state all actions are compared. The domain's first two components must be the agent's cell, row by row,
        and its direction.

        Args:
            simulator: a simulator of the domain.
            action_choices: for each step, the actions to choose from: the first one that leads to a state not in
                `compared_states`, or the first.
            compared_states: the states in which all actions were compared already; visited states are added.
        """
        rng = np.random.default_rng(0)
        simulator.reset(rng)
        state = self._start_state
        for actions in action_choices:
            if _state_key(state) not in compared_states:
                compared_states.add(_state_key(state))
                for other in range(_ACTIONS):
                    for _, reward, end in simulator.outcomes(other):
                        yield from self._compare_step(simulator, state, other, (reward, end))
            fresh = (one for one in actions if self._key_after(state, one) not in compared_states)
            action = int(next(fresh, actions[0]))
            reward, end = simulator.step_without_observation(action, rng)
            yield from self._compare_step(simulator, state, action, (reward, end))
            if end:
                return
            state = self._current_state()

    def _key_after(self, before: _State, action: int) -> Any:
        self._step(before, action)
        return _state_key(self._current_state())

    def _compare_step(
        self, simulator: Simulator, before: _State, action: int, domain_result: tuple[float, int]
    ) -> Iterator[str]:
        """Yield a text for each difference between an action in the level and in the domain.

        `domain_result` is the reward and end in the domain. Unless the episode is over, cell and direction are
        compared, too.
        """
        reported = self._step(before, action)
        yield from _result_differences(action, reported, domain_result)
        (x, y), way = self._current_state()[1:3]
        seen = split_index(simulator.observe(), simulator.observation_shape)[:2].tolist()
        if not reported[1] and seen != [y * self._inner.width + x, way]:
            yield f"action {action} leads to another cell or direction"

    def _step(self, before: _State, action: int) -> tuple[float, int]:
        """Do an action in the state `before`, and return its reward and end (0 goes on, 1 success, 2 failure).

        The environment stays in the next state. Unless the action succeeds, its reward is reduced by 0.9 / `limit`.
        """
        inner = self._inner
        cells, inner.agent_pos, inner.agent_dir, inner.carrying, locks = before
        inner.grid.grid, inner.step_count = [*cells], 0
        for door, lock in zip(self._door_cells, locks, strict=True):
            door.is_open, door.is_locked = lock
        _, paid, over, *_ = inner.step(action)
        success = over and paid > 0  # MiniGrid takes a share of 0.9 off the reward, by the time that success took
        return float(paid) - (0.0 if success else 0.9 / self.limit), (1 if success else 2) if over else 0

    def _current_state(self) -> _State:
        inner = self._inner
        place = int(inner.agent_pos[0]), int(inner.agent_pos[1])
        locks = tuple((door.is_open, door.is_locked) for door in self._door_cells)
        return tuple(inner.grid.grid), place, int(inner.agent_dir), inner.carrying, locks


def minigrid_class(inner: Any) -> Any:
    """Return the class `MiniGridEnv` if the environment is derived from it, else None, without importing MiniGrid."""
    named = (cls for cls in type(inner).__mro__ if cls.__name__ == "MiniGridEnv")
    return next((cls for cls in named if cls.__module__.startswith("minigrid.")), None)


def _success_kinds(inner: Any) -> tuple[SuccessKind, ...]:
    """Return the possible kinds of success of a level whose `step` extends MiniGrid's; () if none is supported."""
    ends: list[SuccessKind] = []
    if getattr(inner, "obj", None) is not None and inner.obj in inner.grid.grid:
        ends.append("held")
    if getattr(getattr(inner, "door", None), "type", None) == "door":
        ends.append("opened")
    return tuple(ends)


def _state_key(state: _State) -> Any:
    """Return a hashable key of a state; objects are compared by identity."""
    cells, place, way, carried, locks = state
    return tuple(map(id, cells)), place, way, id(carried), locks


def _result_differences(action: int, expected: tuple[float, int], domain_result: tuple[float, int]) -> Iterator[str]:
    if expected[1] != domain_result[1] or abs(expected[0] - domain_result[0]) > TOLERANCE:
        yield (
            f"action {action} gives reward {domain_result[0]:g} and end {domain_result[1]}, not "
            f"{expected[0]:g} and {expected[1]}"
        )
