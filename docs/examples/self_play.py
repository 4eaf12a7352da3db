"""One network of Stable-Baselines3 plays all agents of an environment whose agents act together.

pip install "envgraph[multiagent,sb3]" supersuit
python self_play.py DOMAIN
"""

from __future__ import annotations

import sys

import supersuit
from stable_baselines3 import PPO
from stable_baselines3.common.utils import set_random_seed

import envgraph


def main() -> None:
    set_random_seed(0)  # SuperSuit passes no seeds on
    env = envgraph.make_parallel(domain=sys.argv[1], observation="flat", max_episode_steps=50)
    agents = supersuit.pettingzoo_env_to_vec_env_v1(env)  # each agent is an environment of the vector
    envs = supersuit.concat_vec_envs_v1(agents, 4, base_class="stable_baselines3")
    model = PPO("MlpPolicy", envs, n_steps=128, batch_size=256, learning_rate=1e-3, ent_coef=0.01, device="cpu")
    model.learn(24_000)

    steps, (seen, _) = 0, env.reset(seed=0)
    while env.agents:
        actions = {agent: int(model.predict(seen[agent], deterministic=True)[0]) for agent in env.agents}
        seen, _, _, _, infos = env.step(actions)
        steps += 1
    print("success" if infos["left"]["success"] else "no success", "after", steps, "steps")


if __name__ == "__main__":
    main()
