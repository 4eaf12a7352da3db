"""Train MaskablePPO on the members of a family from the ends of their plans backwards, and print how many it solves.

    pip install "envgraph[fast,sb3]" sb3-contrib
    python backwards.py RUN 52 4000000      # the 52 easiest members, for 4,000,000 steps

A random walk does not solve long levels, but from the last states of a plan it does. So every second state of a plan
becomes an environment, and the agent begins two steps earlier as soon as it succeeds (Florensa et al. 2017).
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import torch
from sb3_contrib import MaskablePPO

import envgraph.sb3
from envgraph.env.compiled import Plans
from envgraph.env.schedules import Batch, Outcomes
from envgraph.graph import model_to_json
from envgraph.search import Family, Member, open_family


class Backwards:
    """A schedule that begins with the first start of each level; `starts` has a range of members for each level."""

    def __init__(self, starts: list[range]) -> None:
        self.starts, self.success = starts, np.zeros(len(starts))
        self.first, self.last = np.array([(row.start, row.stop - 1) for row in starts]).T
        self.next = self.first.copy()
        self.level = np.repeat(np.arange(len(starts)), [len(row) for row in starts])

    def ask(self, count: int, rng: np.random.Generator) -> Batch:
        """Return the next starts of random levels; in 30 % of cases earlier ones, so that the agent forgets none.

        Levels that begin at their first state already are chosen less than half as often.
        """
        weights = np.where(self.next < self.last, 1.0, 0.4)
        levels = rng.choice(len(self.starts), size=count, p=weights / weights.sum())
        earlier = rng.integers(self.first[levels], self.next[levels] + 1)
        return Batch(np.where(rng.random(count) < 0.7, self.next[levels], earlier))

    def tell(self, outcomes: Outcomes) -> None:
        """Go back in each level whose next start is solved in about half of the episodes."""
        for member, success in zip(outcomes.members.tolist(), outcomes.success.tolist(), strict=True):
            level = self.level[member]
            if member == self.next[level]:
                self.success[level] += 0.25 * (success - self.success[level])
                if self.success[level] > 0.5 and member < self.last[level]:
                    self.next[level], self.success[level] = member + 1, 0.2


def starts_of(family: Family) -> tuple[Family, Backwards]:
    """Return every second state of a plan of each member, the last ones first, as a family, and its schedule."""
    plans, members, rows = Plans(family.behaviour), list[Member](), list[range]()
    for member in family.members:
        engine = family.domain.engine(family.model(member))
        states = [json.dumps(model_to_json(one.engine.model)) for one in plans.episode(engine)][:-1]
        if states:  # otherwise no plan was found
            chosen = [*states[:0:-2], states[0]]
            rows.append(range(len(members), len(members) + len(chosen)))
            members += [Member(f"{member.name} {place}", {}, state) for place, state in enumerate(chosen)]
    return replace(family, members=tuple(members)), Backwards(rows)


def main(run: str, easiest: int, total_steps: int, num_envs: int = 256, limit: int = 64) -> None:
    torch.set_num_threads(1)  # small networks are slower on several
    members = open_family(run).members[:easiest]
    family = open_family(run).subset(members)
    starts, schedule = starts_of(family)
    print(f"{len(members)} members, {len(starts.members)} starts", flush=True)
    envs = envgraph.sb3.make_vec(starts, num_envs, schedule=schedule, max_episode_steps=limit)
    network = {"net_arch": [192, 128], "activation_fn": torch.nn.ReLU}
    options = {"gamma": 0.97, "learning_rate": 6e-4, "ent_coef": 0.001, "n_steps": 48, "batch_size": 512, "n_epochs": 4}
    model = MaskablePPO("MlpPolicy", envs, policy_kwargs=network, seed=0, device="cpu", **options)
    model.learn(total_steps)

    names = [member.name for member in members]
    found = envgraph.sb3.evaluate(model, envgraph.sb3.make_vec(family, len(names), names), 10, deterministic=False)
    solved = [name for name, share in zip(found.members, found.success, strict=True) if share >= 0.5]
    print(f"{total_steps} steps: {len(solved)} of {len(members)} members are solved mostly:", *solved)


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
