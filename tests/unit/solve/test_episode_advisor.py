"""Best actions in episodes that are played live: their states are found in the table."""

from __future__ import annotations

from random import Random

import pytest

from envgraph.search import find_playable, play_episode
from envgraph.solve import EpisodeAdvisor, value_iteration


@pytest.mark.parametrize("domain", ["triage", "burning_forest"])
def test_state_of_a_played_episode_is_found_in_the_table(domain: str) -> None:
    family, member = find_playable(domain)
    table, rng = family.explored(member).tabular, Random(3)
    advisor, optimal = EpisodeAdvisor(table), value_iteration(table)
    episode = play_episode(family, member, rng.random)
    for _ in range(60):
        if episode.end:
            episode.restart()
        state = advisor.state(episode)
        assert table.observation[state] == episode.simulator.observe()
        assert table.action_masks[state].tolist() == episode.allowed
        assert advisor.action(episode) == optimal.policy[state]
        assert advisor.action_values(episode).tolist() == optimal.action_values[state].tolist()
        episode.step(advisor.action(episode) if rng.random() < 0.5 else rng.randrange(len(episode.action_names)))
        if rng.random() < 0.2:
            episode.undo()
