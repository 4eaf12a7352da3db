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


def run_sampling_rounds(rounds: int = 12) -> tuple[Sampling, list[str], list[float]]:
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


def test_sampling_asks_new_valid_models_and_keeps_the_best_of_each_bin() -> None:
    sampling, asked, kept = run_sampling_rounds()
    family = sampling.family()
    assert len(set(asked)) == 120 and len(family.members) == 12
    problem = family.domain.problem(family.domain.engine())
    for member in family.members:
        problem = family.domain.problem(family.domain.engine(family.model(member)))
        assert problem.is_valid() and problem.compute_measures() == member.measures
        assert member.initial or member.model in asked
    bins = [min(int(member.measures["complexity"] * 3), 2) for member in family.members]
    assert [bins.count(number) for number in range(3)] == [4, 4, 4] and family.members[-1].initial
    assert max(wetness(family)) == max(kept) and 12 <= len(kept) < 120


def test_the_same_scores_give_the_same_models() -> None:
    (one, asked, _), (other, again, _) = run_sampling_rounds(3), run_sampling_rounds(3)
    assert asked == again
    assert [member.model for member in one.family().members] == [member.model for member in other.family().members]


def test_asked_family_can_be_stepped_and_is_not_changed_by_later_sampling() -> None:
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


def test_archive_of_a_sampling_can_be_written_as_a_run(tmp_path: Path) -> None:
    sampling, _, _ = run_sampling_rounds(2)
    sampling.write(tmp_path / "run.sqlite")
    found = open_family(tmp_path / "run.sqlite")
    assert [member.model for member in found.members] == [member.model for member in sampling.family().members]
    with pytest.raises(InvalidArgument, match="exists already") as failure:
        sampling.write(tmp_path / "run.sqlite")
    assert failure.value.hint is not None and "`overwrite=True`" in failure.value.hint
    sampling.write(tmp_path / "run.sqlite", overwrite=True)
    assert open_family(tmp_path / "run.sqlite").members


def test_scores_are_required_for_each_asked_model_exactly_once() -> None:
    sampling = Sampling(Domain.load("burning_forest/paper.toml", overrides=WANTED))
    with pytest.raises(InvalidArgument, match="for each of the 0 models"):
        sampling.tell([1.0])
    sampling.ask(2)
    for wrong in ([1.0], [1.0, inf]):
        with pytest.raises(InvalidArgument, match="for each of the 2 models"):
            sampling.tell(wrong)
    assert sampling.tell([1.0, 2.0]) == (True, True)


def test_sampling_reports_that_no_more_new_models_are_found(tmp_path: Path) -> None:
    for name, text in GARDEN.items():
        (tmp_path / name).write_text(text)
    sampling = Sampling(Domain.load(str(tmp_path)))
    sampling.tell([0.0] * len(sampling.ask(2).members))
    with pytest.raises(EvaluationError, match=r"\d of 9 new models were found"):
        sampling.ask(9)


def test_sampling_without_a_samples_section_is_refused() -> None:
    for given in ((), ("samples.maximise=complexity",)):
        with pytest.raises(InvalidArgument, match=r"needs `\[samples\]` without `maximise`"):
            Sampling(Domain.load("burning_forest/paper.toml", overrides=given))
