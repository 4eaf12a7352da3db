"""KeyDoor written by hand for numba, by somebody who knows that it is a grid: a base for compiled behaviours."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from envgraph.env.compiled.kernels import step_kernels

ROWS = ("#######", "#..#..#", "#.r#.X#", "#..R..#", "#######")
"""The model `two_rooms`: a key and a door of one colour."""
WIDTH, START, LIMIT, HELD, USED = 7, 8, 100, -1, -2
WALL, FLOOR, EXIT, DOOR = range(4)
MOVES = np.array([-1, WIDTH, 1, -WIDTH])
"""How the place of the hero changes: west, south, east, north."""

uniform = njit(forceinline=True, error_model="numpy")(step_kernels.uniform)


class HandWritten:
    """Environments whose states are arrays of their own.

    Args:
        streams: the states of NumPy's generators, a row each.
    """

    def __init__(self, streams: np.ndarray[Any, Any]) -> None:
        n, text = len(streams), "".join(ROWS)
        self.kind = np.array([{"#": WALL, "X": EXIT, "R": DOOR}.get(one, FLOOR) for one in text])
        self.keys = np.array([place for place, one in enumerate(text) if one == "r"])
        self.doors = np.array([place for place, one in enumerate(text) if one == "R"])
        self.streams = streams
        self.at, self.key = np.full(n, START), np.tile(self.keys, (n, 1))
        self.open = np.zeros((n, len(self.doors)), dtype=np.bool_)
        self.steps, self.over, self.cut = (
            np.zeros(n, dtype=np.int64),
            np.zeros(n, np.bool_),
            np.zeros(n, np.bool_),
        )
        self.observation, self.ended = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        self.reward = np.zeros(n)
        for e in range(n):
            uniform(streams, e)

    def step(self, actions: np.ndarray[Any, Any]) -> None:
        """One step of each environment; those that are over begin anew instead."""
        _step_all(
            self.kind, self.keys, self.doors, self.streams, self.at, self.key, self.open, self.steps, self.over,
            self.cut, self.observation, self.ended, self.reward, actions,
        )  # fmt: skip


@njit(forceinline=True, error_model="numpy")
def _walk(kind, doors, at, opened, e, way):  # type: ignore[no-untyped-def]
    there = at[e] + MOVES[way]
    if kind[there] == WALL:
        return
    if kind[there] == DOOR:
        for door in range(len(doors)):
            if doors[door] == there and not opened[e, door]:
                return
    at[e] = there


@njit(forceinline=True, error_model="numpy")
def _unlock(kind, doors, at, key, opened, e, way):  # type: ignore[no-untyped-def]
    there = at[e] + MOVES[way]
    if kind[there] == DOOR:
        for door in range(len(doors)):
            if doors[door] == there and not opened[e, door]:
                for one in range(key.shape[1]):
                    if key[e, one] == HELD:
                        key[e, one] = USED
                        opened[e, door] = True
                        return True
    return False


@njit(error_model="numpy", nogil=True)
def _step_all(kind, keys, doors, streams, at, key, opened, steps, over, cut, observation, ended, reward, actions):  # type: ignore[no-untyped-def]
    for e in range(len(at)):
        uniform(streams, e)
        total, end = 0.0, 0
        if over[e]:
            at[e], steps[e], over[e], cut[e] = START, 0, False, False
            key[e, :], opened[e, :] = keys, False
        else:
            action = actions[e]
            if action < 4:
                _walk(kind, doors, at, opened, e, action)
            elif action < 8:
                total += 0.1 if _unlock(kind, doors, at, key, opened, e, action - 4) else -0.05
            else:
                for one in range(key.shape[1]):
                    if key[e, one] == at[e]:
                        key[e, one] = HELD
            total += -0.01
            if kind[at[e]] == EXIT:
                total += 1.0
                end = 1
            steps[e] += 1
            cut[e] = end == 0 and steps[e] >= LIMIT
            over[e] = end > 0 or cut[e]
        reward[e], ended[e] = total, end
        held = False
        for one in range(key.shape[1]):
            held |= key[e, one] == HELD
        index = at[e] + 35 * held + 70 * held
        weight = 210
        for door in range(len(doors)):
            index += weight * opened[e, door]
            weight *= 2
        observation[e] = index
