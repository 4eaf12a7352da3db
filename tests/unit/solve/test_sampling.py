"""Sampled episodes of a random walk: the same in a program and on the live engine, and as likely as the table says."""

from __future__ import annotations

import numpy as np
import pytest

from envgraph.env import Simulator, explore
from envgraph.env.compiled import CompiledProgram, program_of
from envgraph.errors import EvaluationError, RuleError
from envgraph.solve import _sampling, bootstrap_interval, certify, sample_walks, wilson_interval
from tests.profile import NIGHTLY
from tests.unit.env.coins import loaded
from tests.unit.env.side_by_side import family_of
from tests.unit.env.test_compiled_corners import CORNERS

SOME = [*CORNERS] if NIGHTLY else [*CORNERS][::12]


def walked(environment: CompiledProgram | Simulator, legal: bool) -> list[list[float]] | None:
    """Return the results of a few episodes; None if a step has an error. The first one may be in another episode."""
    try:
        found: list[list[float]] = sample_walks(environment, 12, 6, seed=5, legal=legal).tolist()
    except (RuleError, EvaluationError):
        return None
    return found


@pytest.mark.parametrize("corner", SOME)
def test_walks_in_a_program_equal_those_of_the_live_engine(corner: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_sampling, "BLOCK_STEPS", 4 * 12)  # so that there are two blocks
    family = family_of(CORNERS[corner], 1)
    for legal in (False, True):
        found = walked(family.program, legal)
        assert found == walked(Simulator(family.engines[0].copy(), family.behaviour, family.keys), legal)
        assert all(0 < steps <= 12 and success in (0, 1) for success, _, steps in found or ())


CLAUSES = """
    action turn = 0.5: turn() reward 0.25
    action wait = nothing()
    each step reward -0.5
    on find pair(_, _) terminate success
    on neg find up(_) terminate failure
    observe count find up(_) up to 3
"""
"""Episodes end in success, in failure, and at the limit, with random rewards."""


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_intervals_of_sampled_means_contain_the_exact_values(seed: int) -> None:
    engine, behaviour = loaded(CLAUSES, "hand : Hand")
    exact = certify(explore(engine, behaviour).tabular, limit=9)
    walks = sample_walks(program_of(engine, behaviour, native=False), 9, 2_000, seed=seed)
    success = float(walks[:, 0].mean())
    assert 0.05 < success < 0.95 and walks[:, 1].std() > 0.1
    low, high = wilson_interval(success, len(walks))
    least, most = bootstrap_interval(walks[:, 1].tolist()) or (0.0, 0.0)
    assert low <= exact.random_success <= high < low + 0.05
    assert least <= exact.policy_return <= most


def test_legal_walks_choose_only_from_the_actions_that_masks_allow() -> None:
    places = np.linspace(0.0, 1.0, 12, endpoint=False)
    masks = np.array(12 * [[False, True, False, True, True]])
    assert _sampling._legal_actions(places, masks).tolist() == [1, 1, 1, 1, 3, 3, 3, 3, 4, 4, 4, 4]
    assert _sampling._legal_actions(np.array([np.nextafter(1.0, 0.0)]), masks[:1]).tolist() == [4]


def test_the_number_of_episodes_depends_on_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_sampling, "LIVE_STEPS", 600)
    simulator = Simulator(*loaded(CLAUSES, "hand : Hand"))
    told = list[int]()
    few = sample_walks(simulator, 9, progress=lambda episodes, _: told.append(episodes))
    many = sample_walks(simulator, 4)
    assert (len(few), len(many)) == (100, 150) and told == [*range(1, 101)]
    assert np.array_equal(sample_walks(simulator, 9, 10), few[:10])
    assert not np.array_equal(sample_walks(simulator, 9, 10, seed=1), few[:10])
