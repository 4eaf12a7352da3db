"""Ask and tell."""

from __future__ import annotations

from math import inf
from pathlib import Path

import numpy as np
import pytest

from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.search import Domain, Family, Sampling, make_vector_environment, open_family
from tests.unit.search.test_samples import GARDEN

WANTED = ("samples.count=12", "samples.cover={ complexity = 3 }", "mutation.initial_applications=[10, 30]")


def wetness(family: Family) -> list[float]:
    """A score that no measure has."""
    return [-float(len(family.model(member).graph.extent("BurningTile"))) for member in family.members]


def looped(rounds: int = 12) -> tuple[Sampling, list[str], list[float]]:
    """After some rounds: the models that were asked for, and the score of each that was kept when it was told."""
    sampling, asked, kept = (
        Sampling(Domain.load("burning_forest/paper.toml", overrides=WANTED)),
        list[str](),
        list[float](),
    )
    for _ in range(rounds):
        family = sampling.ask(10)
        scores = wetness(family)
        asked += [member.model for member in family.members]
        kept += [score for score, told in zip(scores, sampling.tell(scores), strict=True) if told]
    return sampling, asked, kept


def test_models_are_new_and_valid_and_the_best_of_each_bin_stay() -> None:
    sampling, asked, kept = looped()
    family = sampling.family()
    assert len(set(asked)) == 120 and len(family.members) == 12
    problem = family.domain.problem(family.domain.engine())
    for member in family.members:
        problem = family.domain.problem(family.domain.engine(family.model(member)))
        assert problem.valid() and problem.measure() == member.measures
        assert member.initial or member.model in asked
    bins = [min(int(member.measures["complexity"] * 3), 2) for member in family.members]
    assert [bins.count(number) for number in range(3)] == [4, 4, 4] and family.members[-1].initial
    assert max(wetness(family)) == max(kept) and 12 <= len(kept) < 120


def test_the_same_scores_give_the_same_models() -> None:
    (one, asked, _), (other, again, _) = looped(3), looped(3)
    assert asked == again
    assert [member.model for member in one.family().members] == [
        member.model for member in other.family().members
    ]


def test_a_family_in_memory_is_stepped_and_stays_what_it_was() -> None:
    sampling = Sampling(Domain.load("burning_forest/paper.toml", overrides=WANTED))
    family = sampling.ask(3)
    texts = [member.model for member in family.members]
    sampling.tell([1.0, 2.0, 3.0])
    sampling.ask(2)
    envs = make_vector_environment(6, family=family, variant=["E1", "E2", "E3"], max_episode_steps=20)
    envs.reset(seed=3)
    assert envs.step(np.zeros(6, np.int64))[0].shape == (6,)
    assert [member.model for member in family.members] == texts
    assert family.split(1)[1].members[0].name in ("E1", "E2", "E3")


def test_the_archive_is_kept_as_a_run(tmp_path: Path) -> None:
    sampling, _, _ = looped(2)
    sampling.write(tmp_path / "run.sqlite")
    found = open_family(tmp_path / "run.sqlite")
    assert [member.model for member in found.members] == [
        member.model for member in sampling.family().members
    ]
    with pytest.raises(InvalidArgument, match="exists already"):
        sampling.write(tmp_path / "run.sqlite")


def test_each_model_has_a_score_and_only_once() -> None:
    sampling = Sampling(Domain.load("burning_forest/paper.toml", overrides=WANTED))
    with pytest.raises(InvalidArgument, match="for each of the 0 models"):
        sampling.tell([1.0])
    sampling.ask(2)
    for wrong in ([1.0], [1.0, inf]):
        with pytest.raises(InvalidArgument, match="for each of the 2 models"):
            sampling.tell(wrong)
    assert sampling.tell([1.0, 2.0]) == (True, True)


def test_where_there_are_no_more_models_it_is_told(tmp_path: Path) -> None:
    for name, text in GARDEN.items():
        (tmp_path / name).write_text(text)
    sampling = Sampling(Domain.load(str(tmp_path)))
    sampling.tell([0.0] * len(sampling.ask(2).members))
    with pytest.raises(EvaluationError, match=r"\d of 9 new models were found"):
        sampling.ask(9)


def test_the_file_says_how_many_are_kept() -> None:
    for given in ((), ("samples.maximise=complexity",)):
        with pytest.raises(InvalidArgument, match=r"needs `\[samples\]` without `maximise`"):
            Sampling(Domain.load("burning_forest/paper.toml", overrides=given))
