"""MaskablePPO on one part of a family; success on the other part and on the target, before and after.

Examples:

    python train_family.py mazes
    python train_family.py mazes --steps 1000000 --control

`mazes` is a run of `envgraph generate maze --samples 400 --name mazes`, or a family file.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import torch
from sb3_contrib import MaskablePPO
from stable_baselines3.common.vec_env import VecNormalize

import envgraph.sb3
from envgraph.search import open_family


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("family", help="a run or a family file with many members")
    parser.add_argument("--held-out", type=float, default=0.2, help="share of the members that are only tested")
    parser.add_argument("--control", action="store_true", help="train on the target alone, with as many steps, as well")
    parser.add_argument("--schedule", default="uniform", help="chooses the member of each episode")
    parser.add_argument("--steps", type=int, default=400_000)
    parser.add_argument("--num-envs", type=int, default=256)
    parser.add_argument("--hidden", type=int, default=64, help="units in each of the two layers")
    parser.add_argument("--gamma", type=float, default=0.98)
    parser.add_argument("--seed", type=int, default=0)
    return parser.parse_args()


def train(args: argparse.Namespace, family: Any, names: list[str]) -> MaskablePPO:
    """Return a network that was trained on the members `names`."""
    schedule = args.schedule if len(names) > 1 else None
    envs = VecNormalize(envgraph.sb3.make_vec(family, args.num_envs, names, schedule=schedule), gamma=args.gamma)
    layers = {"net_arch": [args.hidden, args.hidden]}
    rollouts = {"n_steps": max(8192 // args.num_envs, 1), "batch_size": 1024, "n_epochs": 4}
    rates = {"learning_rate": 1e-3, "ent_coef": 0.01, "gamma": args.gamma}
    model = MaskablePPO("MlpPolicy", envs, policy_kwargs=layers, seed=args.seed, device="cpu", **rollouts, **rates)
    return model.learn(args.steps)


def main() -> None:
    args = parse_arguments()
    torch.set_num_threads(1)  # small networks are slower on several
    family = open_family(args.family)
    train_part, test_part = family.split(args.held_out, seed=1)
    target = [member.name for member in family.members if member.initial]
    names = [member.name for member in train_part.members if not member.initial] + target
    held_out = [member.name for member in test_part.members if not member.initial]
    tests = {
        "target": envgraph.sb3.make_vec(family, 64, target),
        f"{len(held_out)} held out": envgraph.sb3.make_vec(family, len(held_out), held_out),
    }

    def show(title: str, model: MaskablePPO | None) -> None:
        for members, envs in tests.items():
            found = envgraph.sb3.evaluate(model, envs, episodes=4)
            numbers = f"success {found.success.mean():.3f}  return {found.returns.mean():8.2f}"
            print(f"{title:24} {members:14} {numbers}", flush=True)

    show("random actions", None)
    trainings = {"trained on the family": names, "on the target alone": target}
    for title, members in [*trainings.items()][: 1 + args.control]:
        start = time.process_time()
        model = train(args, family, members)
        print(f"{args.steps:,} steps in {time.process_time() - start:.0f} s of CPU time")
        show(title, model)


if __name__ == "__main__":
    main()
