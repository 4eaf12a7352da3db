"""Train MaskablePPO on the members of a family, after imitating their plans, and print how many it solves.

    pip install "envgraph[fast,sb3]" sb3-contrib
    python from_plans.py RUN 52 300000      # the 52 easiest members, for 300,000 steps

A random walk does not solve long levels. So the policy first learns the actions of a plan of each member.
"""

from __future__ import annotations

import sys

import numpy as np
import torch
from sb3_contrib import MaskablePPO

import envgraph.sb3
from envgraph.env.compiled import Plans
from envgraph.search import Family, open_family


def imitate(policy: torch.nn.Module, family: Family, epochs: int) -> None:
    """Teach a policy a plan of each member that has one: make the actions of the plan likely in its states."""
    search = Plans(family.behaviour)
    found = {one.name: search.plan(family.domain.engine(family.model(one))).actions for one in family.members}
    plans = [[*plan] for plan in found.values() if plan]
    envs = envgraph.sb3.make_vec(family, len(plans), [name for name, plan in found.items() if plan])
    numbers = {name: number for number, name in enumerate(envs.get_attr("action_names")[0])}
    seen, rows = envs.reset(), []
    for step in range(max(map(len, plans))):
        masks = np.array(envs.env_method("action_masks"))
        playing = np.array([step < len(plan) for plan in plans])
        actions = np.array([numbers[plan[step]] if step < len(plan) else 0 for plan in plans])
        rows.append((seen[playing], actions[playing], masks[playing]))
        seen = envs.step(actions)[0]
    inputs, actions, masks = (np.concatenate(column) for column in zip(*rows, strict=True))
    print(f"{len(plans)} plans, {len(actions)} actions", flush=True)
    optimiser, rng = torch.optim.Adam(policy.parameters(), lr=1e-3), np.random.default_rng(0)
    for _ in range(epochs):
        for batch in np.array_split(rng.permutation(len(actions)), len(actions) // 128 + 1):
            chosen = torch.as_tensor(actions[batch])
            likely = policy.evaluate_actions(torch.as_tensor(inputs[batch]), chosen, action_masks=masks[batch])[1]
            optimiser.zero_grad()
            (-likely.mean()).backward()
            optimiser.step()


def main(run: str, easiest: int, total_steps: int, epochs: int = 200, num_envs: int = 256) -> None:
    torch.set_num_threads(1)  # small networks are slower on several
    opened = open_family(run)
    family = opened.subset(opened.members[:easiest])
    envs = envgraph.sb3.make_vec(family, num_envs, schedule="learnability")
    network = {"net_arch": [192, 128], "activation_fn": torch.nn.ReLU}
    options = {"gamma": 0.98, "n_steps": 48, "batch_size": 1536, "n_epochs": 4, "learning_rate": 1e-4}
    model = MaskablePPO("MlpPolicy", envs, policy_kwargs=network, seed=0, device="cpu", **options)
    imitate(model.policy, family, epochs)
    names = [member.name for member in family.members]
    test = envgraph.sb3.make_vec(family, len(names), names)
    for steps in (0, total_steps):
        if steps:
            model.learn(steps)
        found = envgraph.sb3.evaluate(model, test, 10, deterministic=False)
        solved = [name for name, share in zip(found.members, found.success, strict=True) if share >= 0.5]
        print(f"{steps} steps: {len(solved)} of {len(names)} members are solved mostly:", *solved, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
