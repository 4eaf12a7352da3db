"""What curricula are compared with."""

from dataclasses import replace
from hashlib import sha256
from itertools import permutations
from typing import get_args

import numpy as np
import pytest

from envgraph.env import Tabular
from envgraph.errors import InvalidArgument
from envgraph.lang.family._family_spec import ScheduleName
from envgraph.learn import (
    EXACT_SCHEDULES,
    TEACHERS,
    Curriculum,
    FamilyMember,
    RunResult,
    TrainingSettings,
    available_backends,
    controls,
    evaluate_policy,
    mixture,
    optimal_return,
    optimistic_values,
    other_starts,
    run_experiment,
    run_families,
    sequences,
    train_run,
)
from envgraph.learn._regret import ExactScore
from envgraph.solve import certify, optimal_episode
from envgraph.solve.learning import Backend
from tests.unit.learn.small_tables import random_table, table

NAMES = ["E1", "E2", "E3", "E4"]
FAMILY = [FamilyMember(name, random_table(seed, outcomes=seed)) for seed, name in enumerate(NAMES, start=1)]
SETTINGS = TrainingSettings(steps_per_environment=300, evaluation_episodes=20, limit=25, checkpoint=100, seeds=2)
BEGUN = {
    f"E4 from {states}": replace(
        FAMILY[-1].tabular,  # type: ignore[arg-type]
        start_states=np.array(states, np.int32),
        start_probability=np.full(len(states), 1 / len(states)),
    )
    for states in ([0, 1, 2, 3, 4], [7], [5], [2], [6], [1], [3])
}
ALL = controls(NAMES, optimism=[0.7], starts=[*BEGUN])


def test_every_control_has_exactly_the_steps_of_the_whole_family() -> None:
    (whole,) = sequences(NAMES, "full")
    found = run_experiment(FAMILY, SETTINGS, [whole, *ALL], starts=BEGUN)
    assert {run.steps for run in found.runs} == {1_200}
    assert {run.curve.steps[-1] for run in found.runs} == {1_200}
    assert [one.label for one in found.summaries()] == [
        "E1-E4",
        "E4",
        "optimistic 0.7",
        "optimistic 0.7, epsilon 0.05",
        "reversed",
        "shuffled",
        "randomised",
        "randomised, renewed",
        "backplay",
        "backplay, 4 stages",
        "exploring",
    ]


@pytest.mark.parametrize("backend", available_backends())
def test_results_do_not_depend_on_workers_or_loop(backend: Backend) -> None:
    assert run_experiment(FAMILY, SETTINGS, ALL, workers=2, backend=backend, starts=BEGUN) == run_experiment(
        FAMILY, SETTINGS, ALL, backend="python", starts=BEGUN
    )


@pytest.mark.parametrize("control", ALL, ids=lambda one: one.label)
def test_results_of_a_control_do_not_depend_on_other_controls(control: Curriculum) -> None:
    together = run_experiment(FAMILY, SETTINGS, ALL, starts=BEGUN).runs
    (alone,) = run_experiment(FAMILY, SETTINGS, [control], seeds=[1], starts=BEGUN).runs
    assert alone in together and alone == train_run(FAMILY, control, SETTINGS, 1, starts=BEGUN)[0]


def test_results_of_curricula_and_controls_equal_those_of_earlier_versions() -> None:
    """The digest is that of the results before there were "backplay" and "exploring"."""
    chosen = [*sequences(NAMES, "suffixes"), *sequences(NAMES, "baselines")]
    chosen += controls(NAMES, ["reversed", "randomised", "uniform", "plr"])
    found = run_experiment(FAMILY, SETTINGS, chosen, backend="python", starts=BEGUN)
    digest = sha256(repr(found.runs).encode()).hexdigest()
    assert digest == "45f5748dfc27a7a95a3505c8fb4fee5376d82f16f747a25f9940f5bac0b3a0d8"


def test_seeds_use_different_shuffled_orders_that_end_in_the_target() -> None:
    (found,) = controls(NAMES, ["shuffled"])
    others = {(*order, "E4") for order in permutations(NAMES[:3])} - {tuple(NAMES), ("E3", "E2", "E1", "E4")}
    assert len(found.orders) == len(others) == 4 and set(found.orders) == others
    assert [found.for_seed(seed).stages for seed in range(5)] == [*found.orders, found.orders[0]]
    runs = run_experiment(FAMILY, SETTINGS, [found], seeds=range(3)).runs
    for run in runs:
        alone = Curriculum("control", "shuffled", found.orders[run.seed % 4], (1,) * 4)
        assert run == train_run(FAMILY, alone, SETTINGS, run.seed)[0]


def test_a_hundred_shuffled_orders_are_sampled_for_large_families() -> None:
    names = [f"E{place}" for place in range(1, 9)]
    first, again, other = (controls(names, ["shuffled"], seed=seed)[0].orders for seed in (0, 0, 1))
    assert first == again != other and len(set(first)) == 100
    assert not {tuple(names), (*names[-2::-1], "E8")} & {*first}


def test_backplay_starts_in_the_states_of_an_optimal_episode_in_reverse() -> None:
    """A corridor of six cells with the goal behind the last, and a cell beside the start that nothing leads to."""
    rows = [[[(1.0, max(cell - 1, 0), 0.0, 0)], [(1.0, cell + 1, 0.0, 0)]] for cell in range(6)]
    rows[5][1] = [(1.0, 6, 1.0, 1)]
    corridor = table([*rows, [[(1.0, 6, 0.0, 0)]] * 2, [[(1.0, 0, 0.0, 0)]] * 2])
    assert optimal_episode(corridor) == [0, 1, 2, 3, 4, 5] and optimal_episode(corridor, 5) == []
    begun = other_starts("E3", corridor)
    everywhere, *along = begun.values()
    assert [one.start_states.tolist() for one in along] == [[5], [4], [3], [2], [1]]
    assert everywhere.start_states.tolist() == [0, 1, 2, 3, 4, 5]
    assert everywhere.start_probability.tolist() == [1 / 6] * 6
    assert len(other_starts("E3", corridor, 5)) == 1
    names, starts = ["E1", "E2", "E3"], [*begun]
    whole, some, exploring = controls(names, ["backplay", "exploring"], starts=starts)
    assert whole.stages == (*starts[1:], "E3") and some.stages == (starts[2], starts[4], "E3")
    assert (some.label, exploring.stages) == ("backplay, 3 stages", (starts[0],))
    assert whole.stage_steps(7) == [3, 4, 3, 4, 3, 4] and sum(some.stage_steps(7)) == 21
    assert controls(names, ["backplay", "exploring"], starts=starts[:1]) == (exploring,)
    assert [one.label for one in controls([*names, "E4", "E5", "E6"], ["backplay"], starts=starts)] == ["backplay"]
    family = [FamilyMember(name, corridor) for name in names]
    short = TrainingSettings(steps_per_environment=1)  # fewer steps than stages
    found = run_experiment(family, short, [whole], seeds=[0], starts=begun).runs[0]
    assert (found.steps, found.curve.steps, found.steps_before) == (3, (1, 2, 3), 2)
    with pytest.raises(InvalidArgument, match="must be the target with other start states"):
        run_experiment(family, short, sequences(names), starts={"E4": random_table(1)})


def test_optimal_episodes_of_random_tables_are_sampled_until_success() -> None:
    """A step succeeds once in ten times, and else fails or stays; where only failure is possible there is none."""
    draw = [(0.1, 2, 1.0, 1), (0.5, 2, 0.0, 2), (0.4, 1, 0.0, 0)]
    chance = table([[[(0.5, 1, 0.0, 0), (0.5, 0, 0.0, 0)]], [draw], [[(1.0, 2, 0.0, 0)]]])
    states = optimal_episode(chance)
    assert states == optimal_episode(chance) and states[0] == 0 and states[-1] == 1
    assert [*other_starts("E1", chance)] == ["E1 from any state", "E1 from state 1"]
    assert optimal_episode(table([[[(1.0, 1, 1.0, 2)]], [[(1.0, 1, 0.0, 0)]]])) == []


def test_small_families_have_only_the_controls_that_their_size_allows() -> None:
    labels = [[one.label for one in controls(NAMES[:count])] for count in (1, 2, 3)]
    assert labels[0] == ["E1"]
    assert labels[1] == ["E2", "randomised", "randomised, renewed"]
    assert labels[2] == ["E3", "reversed", "randomised", "randomised, renewed"]
    assert [one.label for one in controls(NAMES, ["optimistic"])] == []


def test_optimistic_training_differs_from_direct_training_only_in_initial_values() -> None:
    direct, optimistic, rarely = controls(NAMES, ["direct", "optimistic"], optimism=[0.0])
    assert train_run(FAMILY, rarely, SETTINGS, 1)[1].epsilon == 0.05
    plain, zero = (train_run(FAMILY, one, SETTINGS, 1)[0] for one in (direct, optimistic))
    assert plain.curve == zero.curve
    high, _ = controls(NAMES, ["optimistic"], optimism=[5.0])
    first = TrainingSettings(steps_per_environment=1, limit=25)
    _, training = train_run(FAMILY, high, first, 1)
    q = training.q  # type: ignore[union-attr]
    assert np.count_nonzero(q == 5.0) >= q.size - 4


def test_optimistic_values_are_half_one_and_two_times_the_optimal_return() -> None:
    """Reward 8 after three steps, the second and third of them discounted."""
    chain = table([[[(1.0, 1, 0.0, 0)]], [[(1.0, 2, 0.0, 0)]], [[(1.0, 3, 8.0, 1)]], [[(1.0, 3, 0.0, 0)]]])
    settings = TrainingSettings(discount=0.5, limit=10)
    assert optimistic_values(chain, settings) == pytest.approx((1.0, 2.0, 4.0))
    assert optimistic_values(chain, TrainingSettings(discount=0.5, limit=2)) == ()
    assert optimistic_values(chain, TrainingSettings(discount=0.5, initial_value=1.0)) == pytest.approx((2.0, 4.0))


def test_each_episode_of_a_mixture_is_in_a_uniformly_sampled_environment() -> None:
    """Environments that always pay 1, 2 and 4 in episodes of one, two and three steps."""

    def corridor(length: int, reward: float) -> Tabular:
        rows = [[[(1.0, place + 1, reward, 0)]] for place in range(3)] + [[[(1.0, 3, 0.0, 0)]]]
        rows[length - 1] = [[(1.0, 3, reward, 1)]]
        return table(rows)

    several = [corridor(1, 1.0), corridor(2, 2.0), corridor(3, 4.0)]
    family = [FamilyMember(name, one) for name, one in zip(NAMES, several, strict=False)]
    control = Curriculum("control", "mixed", (tuple(NAMES[:3]),), (3,))
    settings = TrainingSettings(steps_per_environment=20_000, checkpoint=1)
    curve = train_run(family, control, settings, 0)[0].curve
    ends = np.flatnonzero(np.diff([0, *curve.episodes]))
    totals = np.diff([0.0, *np.array(curve.reward)[ends]])
    lengths = np.diff([0, *np.array(curve.steps)[ends]])
    assert set(zip(lengths.tolist(), totals.tolist(), strict=True)) == {(1, 1.0), (2, 4.0), (3, 12.0)}
    shares = np.bincount(lengths)[1:] / len(lengths)  # of 30,000 episodes
    assert np.abs(shares - 1 / 3).max() < 0.012


def test_a_mixture_expects_the_mean_of_its_environments() -> None:
    tables = [one.tabular for one in FAMILY if isinstance(one.tabular, Tabular)]
    mixed = mixture(tables)
    mixed.check()
    assert mixed.n_states == sum(one.n_states for one in tables)
    whole, parts = evaluate_policy(mixed, None, 25), [evaluate_policy(one, None, 25) for one in tables]
    assert whole.success_rate == pytest.approx(np.mean([one.success_rate for one in parts]))
    assert whole.mean_return == pytest.approx(np.mean([one.mean_return for one in parts]))
    assert optimal_return(mixed, 25) == pytest.approx(np.mean([optimal_return(one, 25) for one in tables]))


def test_mixed_stages_and_single_stages_use_different_random_numbers() -> None:
    twins = [FamilyMember(name, random_table(1)) for name in NAMES]
    curves = [
        train_run(twins, Curriculum("control", "mine", stages, (1,) * len(stages)), SETTINGS, 0)[0].curve.reward[0]
        for stages in (
            (("E1", "E2"),),
            (("E2", "E1"),),
            ("E1", "E2"),
            (("E1", "E2"), "E1"),
            (("E1", "E2", "E3"),),
        )
    ]
    assert len(set(curves)) == 5


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda: controls(NAMES, ["revered"]), "unknown control 'revered'; did you mean `reversed`"),
        (lambda: controls([]), "different names"),
        (lambda: Curriculum("control", "mine", (("E1", "E1"),), (1,)), "different names"),
        (lambda: Curriculum("control", "mine", ((),), (1,)), "different names"),
        (lambda: Curriculum("control", "mine", ("E1",), (1,), float("inf")), "finite"),
        (lambda: Curriculum("control", "mine", ("E1",), (1,), orders=(("E2",),)), "must have all its stages"),
        (lambda: mixture([]), "needs at least one environment"),
        (
            lambda: mixture([random_table(1), table([[[(1.0, 0, 0.0, 0)]]])]),
            "environment 2 .* other `n_observations`",
        ),
        (
            lambda: run_experiment(FAMILY, SETTINGS, [Curriculum("control", "x", (("E1", "E22"),), (1,))]),
            "no environment is called `E22`",
        ),
    ],
)
def test_invalid_controls_are_refused(act: object, message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        act()  # type: ignore[operator]


def test_each_of_several_families_is_trained_with_a_seed_of_its_own() -> None:
    families = [
        [FamilyMember(name, random_table(10 * number + place)) for place, name in enumerate(NAMES[:2])]
        for number in range(3)
    ]
    ended: list[RunResult] = []
    found = run_families(families, SETTINGS, "random families", found=ended.append)
    assert [(run.kind, run.label, run.seed, run.steps) for run in found.runs] == [
        ("control", "random families", seed, 600) for seed in range(3)
    ]
    curriculum = Curriculum("control", "random families", ("E1", "E2"), (1, 1))
    assert found.runs[2] == train_run(families[2], curriculum, SETTINGS, 2)[0]
    told: list[tuple[int, int]] = []
    again = run_families(
        families,
        SETTINGS,
        "random families",
        known=ended[:2],
        progress=lambda *numbers: told.append(numbers),
        backend="python",
    )
    assert again == found and told == [(3, 3)]


TAUGHT = controls(NAMES, TEACHERS)


def test_schedules_have_the_steps_of_the_family_and_equal_results_in_all_loops() -> None:
    found = [run_experiment(FAMILY, SETTINGS, TAUGHT, backend=one) for one in available_backends()]
    assert all(one == found[0] for one in found)
    assert {run.steps for run in found[0].runs} == {run.curve.steps[-1] for run in found[0].runs} == {1_200}
    assert [one.label for one in found[0].summaries()] == [*TEACHERS]
    assert len({run.curve for run in found[0].runs}) > len(TEACHERS), "they choose different environments"
    assert {(run.steps_before, len(run.curve.steps)) for run in found[0].runs} == {(900, 12)}
    assert run_experiment(FAMILY, SETTINGS, TAUGHT[3:4]).runs[0] in found[0].runs


def test_episodes_that_a_schedule_only_scores_do_not_update_values() -> None:
    """Robust replay of three environments: the first two turns are played alone."""
    (robust,) = controls(NAMES, ["robust_plr"])
    short = replace(robust, stages=robust.stages[:1], shares=(1,))
    settings = replace(SETTINGS, steps_per_environment=2 * SETTINGS.limit, initial_value=0.25)
    _, training = train_run(FAMILY, short, settings, 0)
    assert (training.q == 0.25).all()  # type: ignore[union-attr]
    assert training.epsilon == 1.0


def test_exact_scores_use_the_exploring_policy_of_the_learner() -> None:
    tabulars = [one.tabular for one in FAMILY]
    q = np.random.default_rng(0).standard_normal((tabulars[0].n_observations, tabulars[0].n_actions))
    regret, learnability = (ExactScore(kind, tabulars, SETTINGS, lambda: q) for kind in EXACT_SCHEDULES)  # type: ignore[arg-type]
    for score in (regret, learnability):
        score.epsilon = 0.3
    policy = np.full(q.shape, 0.1)
    policy[np.arange(len(q)), q.argmax(axis=1)] += 0.7
    known = certify(tabulars[2], policy[tabulars[2].observation], limit=25, discount=0.99)
    assert regret.score_of(2) == pytest.approx(known.regret)
    assert learnability.score_of(2) == pytest.approx(known.learnability)


def test_unknown_schedules_and_stages_of_different_environments_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="unknown schedule `plrr`"):
        run_experiment(FAMILY, SETTINGS, [replace(TAUGHT[0], schedule="plrr")])
    with pytest.raises(InvalidArgument, match="stages with several environments must be the same"):
        Curriculum("control", "x", ("E1", "E2"), (1, 1), schedule="plr")
    assert get_args(ScheduleName) == TEACHERS


def test_environments_of_a_mixture_can_have_different_agents() -> None:
    """A family in which nurses are added: whose turn it is is told of by name, and the numbers of one name agree."""

    def of(names: tuple[str, ...], seed: int) -> Tabular:
        one = random_table(seed)
        return replace(one, agent_names=names, turn=(np.arange(12) % len(names)).astype(np.int32))

    tables = [of(("n1", "d1"), 1), of(("n1", "n2", "d1"), 2)]
    mixed = mixture(tables)
    mixed.check()
    assert mixed.agent_names == ("n1", "d1", "n2")
    assert mixed.turn is not None
    told = [mixed.agent_names[turn] for turn in mixed.turn]
    assert told == ["n1", "d1"] * 6 + ["n1", "n2", "d1"] * 4
    family = [FamilyMember(name, one) for name, one in zip(NAMES, tables, strict=False)]
    control = Curriculum("control", "randomised", (tuple(NAMES[:2]),), (2,))
    assert train_run(family, control, SETTINGS, 0)[0].steps == 2 * SETTINGS.steps_per_environment
    with pytest.raises(InvalidArgument, match="that take turns, or none"):
        mixture([tables[0], random_table(1)])
