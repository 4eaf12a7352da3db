"""Tabular Q-learning by each agent on its own, in an environment whose agents act together.

pip install "envgraph[multiagent]"
python independent_learners.py DOMAIN
"""

from __future__ import annotations

import sys
from collections import defaultdict

import numpy as np

import envgraph


def main() -> None:
    env = envgraph.make_parallel(domain=sys.argv[1], max_episode_steps=50)
    count = env.action_space(env.possible_agents[0]).n
    values = {agent: defaultdict(lambda: np.zeros(count)) for agent in env.possible_agents}
    rng = np.random.default_rng(3)

    def play(explore: float) -> tuple[int, bool]:
        """Play an episode, learn from it, and return its steps and success."""
        seen, infos = env.reset(seed=0)
        steps = 0
        while env.agents:
            best = {agent: int(values[agent][seen[agent]].argmax()) for agent in env.agents}
            actions = {one: int(rng.integers(count)) if rng.random() < explore else act for one, act in best.items()}
            after, rewards, ended, _, infos = env.step(actions)
            for agent, action in actions.items():
                ahead = 0.0 if ended[agent] else 0.98 * values[agent][after[agent]].max()
                own = values[agent][seen[agent]]
                own[action] += 0.2 * (rewards[agent] + ahead - own[action])
            seen, steps = after, steps + 1
        return steps, all(info["success"] for info in infos.values())

    for _ in range(1000):
        play(explore=0.2)
    steps, success = play(explore=0.0)
    print("success" if success else "no success", "after", steps, "steps")


if __name__ == "__main__":
    main()
