"""Levels for tests: corridors in which the exit lies on the right, and some from which nothing leads there."""

import numpy as np

from envgraph.learn.audit import (
    AuditSettings,
)
from envgraph.learn.audit._audit_levels import (
    AuditLevels,
)
from envgraph.solve.learning import LevelTables, PolicySettings

POLICY = PolicySettings(hidden=3, levels=4, minibatches=1, epochs=1, steps=8, limit=6)


def corridors(count: int = 40) -> AuditLevels:
    """Level `i` takes `i % 5` steps to the right, or has no exit where that is 0."""
    to, reward, ended, first, plan = [], [], [], [0], []
    for number in range(count):
        length, begin = max(1, number % 5), first[-1]
        for state in range(length):
            last = state == length - 1
            to += [begin + max(0, state - 1), begin + (state if last else state + 1)]
            solved = last and number % 5 > 0
            reward += [0.0, float(solved)]
            ended += [0, int(solved)]
        first.append(begin + length)
        plan.append(number % 5)
    plans, states = np.array(plan), first[-1]
    tables = LevelTables(
        first=np.array(first),
        start_first=np.arange(count + 1),
        starts=np.array(first[:-1]),
        start_chance=np.ones(count),
        to=np.array(to, np.int32),
        chance=np.ones(len(to)),
        reward=np.array(reward),
        ended=np.array(ended, np.int8),
        seen_first=np.arange(states + 1),
        seen=np.array([place % 3 for place in range(states)], np.int32),
        inputs=3,
        actions=2,
        width=1,
    )
    optimum = np.where(plans > 0, POLICY.discount ** (plans - 1.0), 0.0)
    half, rest = count // 2, np.arange(count // 2, count)
    solvable = rest[plans[rest] > 0]
    return AuditLevels(
        tables, optimum, plans, np.arange(half), rest, solvable[:8], solvable[8:12], count, np.arange(count)
    )


def settings(steps: int = 8 * 32) -> AuditSettings:
    return AuditSettings((), (), 20, 8, 20, steps, 3, 2, 1.0, POLICY)
