"""Export an environment as a map of Gymnasium's FrozenLake: a grid with holes and one walker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeVar

import numpy as np
from gymnasium.envs.toy_text.frozen_lake import FrozenLakeEnv

from envgraph.env._enumeration import ExploredEnvironment
from envgraph.env._tabular import Tabular
from envgraph.env.scene._scene import GridScene
from envgraph.errors import TOLERANCE, InvalidArgument

Place = TypeVar("Place")
Position = tuple[int, int]
"""Column and row."""

Outcomes = Mapping[tuple[Position, float, bool], float]
"""The probability of each (position, reward, end) that an action may lead to."""

_MOVES: Final = ((-1, 0), (0, 1), (1, 0), (0, -1))
"""The moves of the actions of FrozenLake: left, down, right, up."""


def frozen_lake_arguments(explored: ExploredEnvironment, limit: int | None) -> dict[str, Any]:
    """Return the arguments of `gymnasium.make("FrozenLake-v1", ..)` that create an equal environment.

    Every transition of FrozenLake is compared with the table. Observations of FrozenLake are cell numbers, row by row.

    Args:
        explored: the enumerated environment; its pictures must show a grid with one token, the walker.
        limit: the number of steps after which an episode is truncated, or None.

    Returns:
        `desc`, `is_slippery`, `success_rate`, `reward_schedule` and `max_episode_steps` (-1 for none).

    Raises:
        InvalidArgument: no map of FrozenLake has these transitions; the message names a difference.
    """
    table, places = explored.tabular, _walker_positions(explored)
    if table.n_actions != len(_MOVES):
        raise _no_map_error(f"it has {table.n_actions} actions, but FrozenLake has 4: left, down, right, up")
    letters, rewards = _cell_letters(table, places)
    if np.ptp(table.start_probability) > TOLERANCE:
        raise _no_map_error("its start states are not equally likely")
    found: dict[str, Any] = {
        "desc": _map_rows(explored, places, letters),
        "is_slippery": not table.deterministic,
        "success_rate": _success_rate(table, places),
        "reward_schedule": [rewards.get(letter, 0.0) for letter in "GHF"],
    }
    _check_equal(table, places, letters, FrozenLakeEnv(**found))
    return {**found, "max_episode_steps": limit or -1}


def _walker_positions(explored: ExploredEnvironment) -> list[Position]:
    """Return the walker's position in each state.

    Raise InvalidArgument if a picture is not a grid with one token, or if two states have the same position.
    """
    places = []
    for scene in explored.pictures:
        if not isinstance(scene, GridScene) or len(scene.marks) != 1:
            raise _no_map_error("its `draw` clause does not draw a grid with exactly one token")
        places.append(scene.marks[0].place)
    if not places:
        raise _no_map_error("it has no pictures", "write `draw grid Class at (x, y) with walker at walker.at`")
    if len(set(places)) < len(places):
        twice = next(place for place in places if places.count(place) > 1)
        raise _no_map_error(f"several of its states have the walker at the same position, {_format_position(twice)}")
    return places


def action_outcomes(
    table: Tabular, places: Sequence[Place], state: int, action: int
) -> dict[tuple[Place, float, bool], float]:
    """Return the probability of each (place of the next state, reward, end) that an action may lead to."""
    found: dict[tuple[Place, float, bool], float] = {}
    for number in np.flatnonzero(table.probability[state, action]).tolist():
        at = state, action, number
        key = places[table.next_state[at]], float(table.reward[at]), bool(table.terminated[at])
        found[key] = found.get(key, 0.0) + float(table.probability[at])
    return found


def _cell_letters(table: Tabular, places: list[Position]) -> tuple[dict[Position, str], dict[str, float]]:
    """Return the letter (S, F, G, H) of each reached position, and the reward for entering a cell of each letter."""
    letters = dict.fromkeys(places, "F")
    letters |= dict.fromkeys((places[state] for state in table.start_states.tolist()), "S")
    for at in np.argwhere(table.terminated > 0).tolist():
        letters[places[table.next_state[*at]]] = "FGH"[table.terminated[*at]]
    rewards: dict[str, float] = {}
    for state, place in enumerate(places):
        for action in range(table.n_actions) if letters[place] in "SF" else ():
            for to, reward, _ in action_outcomes(table, places, state, action):
                rewards.setdefault(letters[to].replace("S", "F"), reward)
    return letters, rewards


def _map_rows(explored: ExploredEnvironment, places: list[Position], letters: Mapping[Position, str]) -> list[str]:
    """Return the rows of the map; a cell that is never reached is a hole if only reached holes look like it."""
    scene = explored.pictures[0]
    assert isinstance(scene, GridScene)

    def kind(place: Position) -> int:
        return scene.cells[place[1] * scene.width + place[0]]

    holes = {kind(place) for place in places if letters[place] == "H"}
    others = {kind(place) for place in places if letters[place] != "H"}

    def letter(place: Position) -> str:
        return letters.get(place, "H" if kind(place) in holes - others else "F")

    return ["".join(letter((x, y)) for x in range(scene.width)) for y in range(scene.height)]


def _success_rate(table: Tabular, places: list[Position]) -> float:
    """Return the probability of moving in the chosen direction, from an action with 3 next cells; otherwise 1/3."""
    for state, place in enumerate(places):
        for action, (dx, dy) in enumerate(_MOVES):
            outcomes = action_outcomes(table, places, state, action)
            chances = {to: chance for (to, _, _), chance in outcomes.items()}
            wanted = place[0] + dx, place[1] + dy
            if len(chances) == len(outcomes) == 3 and wanted in chances:
                return chances[wanted]
    return 1.0 / 3.0


def _check_equal(table: Tabular, places: list[Position], letters: Mapping[Position, str], lake: FrozenLakeEnv) -> None:
    """Raise InvalidArgument if an action outside holes and goals has other outcomes in the table than in FrozenLake."""
    width = lake.ncol
    for state, place in enumerate(places):
        for action, name in enumerate(table.action_names if letters[place] in "SF" else ()):
            ours = action_outcomes(table, places, state, action)
            theirs: dict[tuple[Position, float, bool], float] = {}
            for chance, to, reward, ended in lake.P[place[1] * width + place[0]][action]:
                key = (int(to) % width, int(to) // width), float(reward), bool(ended)
                theirs[key] = theirs.get(key, 0.0) + chance
            if not _nearly_equal(ours, theirs):
                where = f"`{name}` at {_format_position(place)}"
                raise _no_map_error(
                    f"{where} leads to {_format_outcomes(ours)}, but in FrozenLake to {_format_outcomes(theirs)}"
                )


def _nearly_equal(ours: Outcomes, theirs: Outcomes) -> bool:
    return ours.keys() == theirs.keys() and all(abs(chance - theirs[key]) <= TOLERANCE for key, chance in ours.items())


def _format_outcomes(outcomes: Outcomes) -> str:
    """Format the outcomes of an action for a message."""
    return " or ".join(
        f"{_format_position(place)} with reward {reward:g}{' and the end' * ended}" for place, reward, ended in outcomes
    )


def _format_position(place: Position) -> str:
    return f"column {place[0]}, row {place[1]}"


def _no_map_error(reason: str, hint: str | None = None) -> InvalidArgument:
    return InvalidArgument(f"this environment is not a map of FrozenLake: {reason}", hint)
