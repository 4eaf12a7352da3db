"""PPO in one file, in the style of CleanRL, on a vector of environments with action masks.

Examples:

    python ppo.py --domain keydoor
    python ppo.py --family family.json --variant E1 E2 E3 --schedule plr
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import torch
from torch import nn
from torch.distributions import Categorical

import envgraph


def parse_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--domain", help="a bundled domain or a directory; the default is keydoor")
    parser.add_argument("--family", help="a family file or a run, in place of a domain")
    parser.add_argument("--variant", nargs="*", help="members of the family")
    parser.add_argument("--schedule", help="chooses the member of each episode, such as plr")
    parser.add_argument("--engine", default="compiled", help="compiled or table")
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--num-steps", type=int, default=64, help="steps of each environment between two updates")
    parser.add_argument("--total-steps", type=int, default=300_000)
    parser.add_argument("--learning-rate", type=float, default=1e-3)
    parser.add_argument("--gamma", type=float, default=0.99)
    parser.add_argument("--gae-lambda", type=float, default=0.95)
    parser.add_argument("--epochs", type=int, default=4)
    parser.add_argument("--minibatches", type=int, default=8)
    parser.add_argument("--clip", type=float, default=0.2)
    parser.add_argument("--entropy", type=float, default=0.01)
    parser.add_argument("--seed", type=int, default=0)
    return parser.parse_args()


class Agent(nn.Module):
    """A policy and a value function with two hidden layers each. Actions outside of the mask have probability 0."""

    def __init__(self, inputs: int, actions: int) -> None:
        super().__init__()

        def network(outputs: int, scale: float) -> nn.Sequential:
            layers = [nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)]
            for layer, gain in zip(layers[::2], (2**0.5, 2**0.5, scale), strict=True):
                nn.init.orthogonal_(layer.weight, gain)
                nn.init.zeros_(layer.bias)
            return nn.Sequential(*layers)

        self.policy, self.critic = network(actions, 0.01), network(1, 1.0)

    def value(self, observation: torch.Tensor) -> torch.Tensor:
        return self.critic(observation).squeeze(-1)

    def distribution(self, observation: torch.Tensor, mask: torch.Tensor) -> Categorical:
        return Categorical(logits=self.policy(observation).masked_fill(~mask, -1e9))


def main() -> None:
    args = parse_arguments()
    torch.set_num_threads(1)  # small networks are slower on several
    torch.manual_seed(args.seed)
    rng = np.random.default_rng(args.seed)
    source = {"family": args.family} if args.family else {"domain": args.domain or "keydoor"}
    given = {name: value for name in ("variant", "schedule") if (value := getattr(args, name))}
    options = {"engine": args.engine, "observation": "flat", "action_masks": True, "autoreset_mode": "SameStep"}
    envs = envgraph.make_vec(num_envs=args.num_envs, **source, **given, **options)
    agent = Agent(envs.single_observation_space.shape[0], int(envs.single_action_space.n))
    optimiser = torch.optim.Adam(agent.parameters(), lr=args.learning_rate, eps=1e-5)

    shape = args.num_steps, args.num_envs
    observations = torch.zeros(*shape, envs.single_observation_space.shape[0])
    masks = torch.zeros(*shape, int(envs.single_action_space.n), dtype=torch.bool)
    actions, log_probs, rewards, ends, values = (torch.zeros(shape) for _ in range(5))
    returns, finished, started = np.zeros(args.num_envs), [], time.time()
    seen, infos = envs.reset(seed=args.seed)
    updates = args.total_steps // (args.num_steps * args.num_envs)
    for update in range(1, updates + 1):
        for step in range(args.num_steps):
            observations[step] = torch.as_tensor(seen)
            masks[step] = torch.as_tensor(infos["action_mask"] > 0)
            with torch.no_grad():
                chosen = agent.distribution(observations[step], masks[step])
                actions[step] = chosen.sample()
                log_probs[step] = chosen.log_prob(actions[step])
                values[step] = agent.value(observations[step])
            seen, reward, terminated, truncated, infos = envs.step(actions[step].long().numpy())
            returns += reward
            rewards[step] = torch.as_tensor(reward)
            over = terminated | truncated
            ends[step] = torch.as_tensor(over)
            if over.any():
                finished += zip(returns[over], infos["final_info"]["success"][over], strict=True)
                returns[over] = 0.0
            cut = truncated & ~terminated  # the episode could have gone on: add what its last state is worth
            if cut.any():
                with torch.no_grad():
                    last = agent.value(torch.as_tensor(np.stack(infos["final_obs"][cut])))
                rewards[step, torch.as_tensor(cut)] += args.gamma * last

        with torch.no_grad():  # generalised advantage estimation
            advantages, advantage = torch.zeros(shape), torch.zeros(args.num_envs)
            following = agent.value(torch.as_tensor(seen))
            for step in reversed(range(args.num_steps)):
                goes_on = 1.0 - ends[step]
                delta = rewards[step] + args.gamma * following * goes_on - values[step]
                advantage = delta + args.gamma * args.gae_lambda * goes_on * advantage
                advantages[step], following = advantage, values[step]
        targets = advantages + values

        batch = [one.flatten(0, 1) for one in (observations, masks, actions, log_probs, advantages, targets)]
        for _ in range(args.epochs):
            for part in np.array_split(rng.permutation(len(batch[0])), args.minibatches):
                observation, mask, action, old, gain, target = (one[part] for one in batch)
                distribution = agent.distribution(observation, mask)
                ratio = (distribution.log_prob(action) - old).exp()
                gain = (gain - gain.mean()) / (gain.std() + 1e-8)
                policy_loss = -torch.min(gain * ratio, gain * ratio.clamp(1 - args.clip, 1 + args.clip)).mean()
                value_loss = (agent.value(observation) - target).square().mean()
                loss = policy_loss + 0.5 * value_loss - args.entropy * distribution.entropy().mean()
                optimiser.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimiser.step()

        if finished and (update % 10 == 0 or update == updates):
            total, success = np.mean(finished, axis=0)
            steps = update * args.num_steps * args.num_envs
            speed = steps / (time.time() - started)
            print(f"{steps:>9,} steps  return {total:8.3f}  success {success:.2f}  {speed:,.0f} steps/s")
            finished = []
    envs.close()


if __name__ == "__main__":
    main()
