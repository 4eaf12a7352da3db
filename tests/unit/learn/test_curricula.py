"""The sequences of a family."""

import pytest

from envgraph.errors import InvalidArgument
from envgraph.learn import Curriculum, sequences

NAMES = ["E1", "E2", "E3"]


def test_suffixes_end_in_the_target_and_have_two_stages_or_more() -> None:
    assert sequences(NAMES, "suffixes") == (
        Curriculum("curriculum", "E1-E3", ("E1", "E2", "E3"), (1, 1, 1)),
        Curriculum("curriculum", "E2-E3", ("E2", "E3"), (1, 1)),
    )


def test_the_paper_has_five_suffixes() -> None:
    labels = [one.label for one in sequences([f"E{number}" for number in range(1, 7)])]
    assert labels == ["E1-E6", "E2-E6", "E3-E6", "E4-E6", "E5-E6"]


def test_a_family_with_one_member_has_one_curriculum() -> None:
    assert sequences(["E1"]) == (Curriculum("curriculum", "E1", ("E1",), (1,)),)


def test_baselines_train_on_one_environment_with_the_budget_of_the_family() -> None:
    assert sequences(NAMES, "baselines") == tuple(Curriculum("baseline", name, (name,), (3,)) for name in NAMES)
    assert sequences(NAMES, "direct") == (Curriculum("baseline", "E3", ("E3",), (3,)),)


def test_the_full_family_is_the_first_suffix() -> None:
    assert sequences(NAMES, "full") == sequences(NAMES)[:1]


@pytest.mark.parametrize(
    ("names", "kind", "message"),
    [
        (NAMES, "suffix", "did you mean `suffixes`"),
        ([], "full", "different names"),
        (["E1", "E1"], "full", "different names"),
    ],
)
def test_invalid_sequences_are_refused(names: list[str], kind: str, message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        sequences(names, kind)  # type: ignore[arg-type]


@pytest.mark.parametrize("shares", [(), (1,), (1, 0)])
def test_a_curriculum_needs_a_share_for_each_stage(shares: tuple[int, ...]) -> None:
    with pytest.raises(InvalidArgument, match="positive share"):
        Curriculum("curriculum", "mine", ("E1", "E2"), shares)
