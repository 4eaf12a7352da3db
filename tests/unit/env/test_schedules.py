"""Schedules give members as they say, and learn from what comes of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from envgraph.env.schedules import (
    SCHEDULES,
    Band,
    Buffer,
    InOrder,
    MemberAssignment,
    Outcomes,
    Replay,
    ReplayBuffer,
    Schedule,
    Shuffled,
    Sifter,
    Sifting,
    Weighted,
    learnability,
    learning_progress,
    named_schedule,
)
from envgraph.errors import InvalidArgument


def outcomes(members: np.ndarray, success: np.ndarray | float, score: np.ndarray | None = None) -> Outcomes:
    shares = np.broadcast_to(np.asarray(success, np.float64), members.shape)
    return Outcomes(members, shares, 10.0 * shares, np.full(len(members), 5), score)


def member_frequencies(schedule: Schedule, rng: np.random.Generator, members: int, count: int = 4000) -> np.ndarray:
    """How often each member is given, on average."""
    return np.bincount(schedule.ask(count, rng).members, minlength=members) / count


@pytest.mark.parametrize("name", SCHEDULES)
@pytest.mark.parametrize(("members", "count"), [(1, 3), (6, 1), (6, 20), (40, 7)])
def test_schedules_return_the_requested_number_of_members_reproducibly(name: str, members: int, count: int) -> None:
    def run() -> list[list[int]]:
        schedule, rng, found = named_schedule(name, members), np.random.default_rng(5), []
        for _ in range(30):
            batch = schedule.ask(count, rng)
            found.append(batch.members.tolist())
            schedule.tell(outcomes(batch.members, (batch.members % 3) / 2))
        return found

    found = run()
    assert found == run()
    assert all(len(one) == count and set(one) <= {*range(members)} for one in found)
    assert {one for row in found for one in row} == {*range(members)}, "all of them at some time"


def test_in_order_schedule_advances_by_the_reported_steps() -> None:
    schedule, rng, found = InOrder([10, 5]), np.random.default_rng(0), []
    for _ in range(4):
        found.append(schedule.ask(2, rng).members.tolist())
        schedule.tell(outcomes(np.zeros(1, np.int64), 0.0))
    assert found == [[0, 0], [0, 0], [1, 1], [1, 1]]
    with pytest.raises(InvalidArgument, match="positive number of steps"):
        InOrder([0])


def test_shuffled_schedule_returns_each_member_once_before_repeating_any() -> None:
    schedule, rng = Shuffled(np.arange(20)), np.random.default_rng(0)
    assert sorted(one for _ in range(5) for one in schedule.ask(4, rng).members.tolist()) == [*range(20)]


def test_a_full_buffer_keeps_the_highest_scores() -> None:
    kept = ReplayBuffer(Buffer(), 3)
    kept.update(np.array([1, 2, 3]), np.array([0.1, 0.2, 0.3]), 1)
    kept.update(np.array([4, 5]), np.array([0.05, 0.25]), 2)
    kept.update(np.array([3]), np.array([0.01]), 3)
    kept.update(np.array([6]), np.array([0.02]), 4)
    assert sorted(kept._place) == [2, 5, 6]


def test_replay_probabilities_combine_rank_and_staleness() -> None:
    kept = ReplayBuffer(Buffer(temperature=0.5, staleness=0.25), 3)
    kept.update(np.array([1, 2, 3]), np.array([0.5, 0.9, 0.1]), 4)
    kept._stamps[:] = [1, 2, 3]
    by_rank = np.array([2.0**-2, 1.0, 3.0**-2])
    expected = 0.75 * by_rank / by_rank.sum() + 0.25 * np.array([4, 3, 2]) / 9
    assert np.allclose(kept.probabilities(5), expected)


def test_robust_replay_does_not_learn_on_fresh_members() -> None:
    schedule, rng = Replay(np.arange(40), Buffer(size=8, fresh_learned=False)), np.random.default_rng(0)
    kinds, seen = set(), set[int]()
    for _ in range(20):
        batch = schedule.ask(4, rng)
        assert batch.learn <= ({*batch.members.tolist()} <= seen), "what is learned on was scored before"
        seen |= {*batch.members.tolist()}
        kinds.add(batch.learn)
        schedule.tell(outcomes(batch.members, 0.5, np.arange(4.0)))
    assert kinds == {False, True}


def test_replayed_members_are_edited_and_scored_next() -> None:
    edited = list[list[int]]()

    def edit(members: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        edited.append(members.tolist())
        return members + 100

    schedule = Replay(np.arange(4), Buffer(staleness=0.0, fresh_learned=False), edit=edit)
    rng, learned = np.random.default_rng(0), list[list[int]]()
    for _ in range(12):
        batch = schedule.ask(2, rng)
        if batch.learn:
            learned.append(batch.members.tolist())
        schedule.tell(outcomes(batch.members, 0.5, batch.members.astype(np.float64)))
    assert edited == learned[: len(edited)]
    assert max(max(one) for one in learned) >= 200, "children of children"


def test_reported_scores_override_scores_from_returns() -> None:
    rng = np.random.default_rng(0)
    by_return, by_score = (Replay(np.arange(3), Buffer(staleness=0.0)) for _ in range(2))
    for success in (np.array([1.0, 1.0, 0.5]), np.array([1.0, 0.0, 0.5])):  # member 1 was better before
        by_return.tell(outcomes(np.arange(3), success))
        by_score.tell(outcomes(np.arange(3), success, np.array([0.0, 1.0, 2.0])))
    assert member_frequencies(by_return, rng, 3).argmax() == 1
    assert member_frequencies(by_score, rng, 3).argmax() == 2


def test_candidates_are_played_and_the_best_fill_their_share_of_a_batch() -> None:
    how = Sifting(episodes=4, every=100, candidates=20, best=2)
    schedule, rng = Sifter(np.arange(20), how), np.random.default_rng(0)
    played, found = 0, []
    for _ in range(90):
        batch = schedule.ask(4, rng)
        success = rng.random(4) < 1.0 / (1.0 + batch.members)
        schedule.tell(outcomes(batch.members, success.astype(np.float64)))
        assert batch.learn == (batch.episodes is None)
        if batch.learn:
            found.append(batch.members[:2].tolist())
        else:
            played += 4
    assert played == 2 * 20 * 4, "twice in 100 members that are learned on"
    assert len({one for row in found[:25] for one in row}) <= 2


def test_weights_of_members_follow_their_definitions() -> None:
    weighed: list[Any] = []
    schedule = Weighted(3, lambda known: weighed.append(known) or learnability(known))
    for success in (np.array([0.0, 0.5, 1.0]), np.array([1.0, 0.5, 1.0])):
        schedule.tell(outcomes(np.arange(3), success))
    schedule.probabilities()
    (known,) = weighed
    assert known.fast.tolist() == [0.2, 0.5, 1.0]
    assert np.allclose(learning_progress(known), [0.15, 0.0, 0.0])
    assert np.allclose(learnability(known), [0.16, 0.25, 0.0])
    assert Band(0.1, 0.3)(known).tolist() == [1.0, 0.0, 0.0]
    assert Band(0.6, 0.7)(known).tolist() == [0.0, 1.0, 0.0], "the nearest"


def test_weighted_schedule_returns_each_member_once_and_then_by_weight() -> None:
    schedule, rng = Weighted(4, learnability, uniform=0.4), np.random.default_rng(0)
    first = schedule.ask(4, rng).members
    assert sorted(first.tolist()) == [0, 1, 2, 3]
    assert np.allclose(schedule.probabilities(), 0.25), "nothing is known"
    schedule.tell(outcomes(first, np.where(first == 2, 0.5, 1.0)))
    assert np.allclose(schedule.probabilities(), [0.1, 0.1, 0.7, 0.1])


class FixedSchedule:
    """Gives what it is made with."""

    def __init__(self, members: list[int]) -> None:
        self.members = np.array(members)

    def ask(self, count: int, rng: np.random.Generator):  # type: ignore[no-untyped-def]
        return Shuffled(self.members).ask(len(self.members), rng)

    def tell(self, outcomes: Outcomes) -> None:
        raise AssertionError


@pytest.mark.parametrize("members", [[3], [-1], [0, 1]])
def test_schedule_that_returns_invalid_members_is_refused(members: list[int]) -> None:
    with pytest.raises(InvalidArgument, match="must return 1 numbers below 3"):
        MemberAssignment(FixedSchedule(members), 1, 3).begin_episodes(np.array([True]))


def test_unknown_schedule_name_suggests_a_similar_name() -> None:
    with pytest.raises(InvalidArgument, match="is 'plr', which is not a schedule"):
        MemberAssignment("plr", 1, 3)  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="unknown schedule `prl`") as caught:
        named_schedule("prl", 3)
    assert caught.value.hint == "did you mean `plr`?"
