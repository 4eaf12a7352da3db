"""Certificates, against exact fractions, systems of linear equations and each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache
from importlib.util import find_spec
from math import inf

import numpy as np
import pytest
from hypothesis import given, strategies as st

from envgraph.env import Tabular
from envgraph.errors import InvalidArgument
from envgraph.solve import (
    certify,
    cvar,
    evaluate_policy,
    hit_probability,
    optimal_return,
    shortest_plan,
    value_iteration,
)
from tests.unit.learn.forest_tables import forest, published_family
from tests.unit.learn.small_tables import Outcome, random_table, table

END = [(1.0, 1, 0.0, 0)]
EIGHTHS = [(8,), (4, 4), (1, 7), (2, 5, 1), (0, 8)]


@st.composite
def tables(draw: st.DrawFn) -> Tabular:
    """Up to four states, two actions; chances are eighths and rewards quarters, which floats have exactly."""
    states = draw(st.integers(1, 4))

    def outcome(eighths: int) -> Outcome:
        following, quarters = draw(st.integers(0, states - 1)), draw(st.integers(-4, 4))
        return (eighths / 8, following, quarters / 4, draw(st.sampled_from([0, 0, 0, 1, 2])))

    rows = [[[outcome(eighths) for eighths in draw(st.sampled_from(EIGHTHS))] for _ in "ab"] for _ in range(states)]
    return table(rows, {0: 1.0} if states == 1 else {0: 0.25, states - 1: 0.75})


Reading = Callable[[Fraction, int, Fraction, int, Fraction], Fraction]


def exact_expectation(
    tabular: Tabular, shares: Sequence[Sequence[Fraction]] | None, limit: int, reading: Reading
) -> Fraction:
    """Expectation of what `reading` makes of each outcome, of the best action if there is no policy; by recursion."""

    @cache
    def worth(state: int, left: int) -> Fraction:
        if left == 0:
            return Fraction(0)
        of_actions = [action_worth(state, action, left) for action in range(tabular.n_actions)]
        if shares is None:
            return max(of_actions)
        return sum((share * one for share, one in zip(shares[state], of_actions, strict=True)), Fraction(0))

    def action_worth(state: int, action: int, left: int) -> Fraction:
        total = Fraction(0)
        for outcome in range(tabular.next_state.shape[2]):
            at = (state, action, outcome)
            if chance := Fraction(float(tabular.probability[at])):
                ended, following = int(tabular.terminated[at]), int(tabular.next_state[at])
                after = Fraction(0) if ended else worth(following, left - 1)
                total += reading(chance, ended, Fraction(float(tabular.reward[at])), following, after)
        return total

    starts = zip(tabular.start_states.tolist(), tabular.start_probability.tolist(), strict=True)
    return sum((Fraction(weight) * worth(state, limit) for state, weight in starts), Fraction(0))


def success_reading(chance: Fraction, ended: int, reward: Fraction, following: int, after: Fraction) -> Fraction:
    return chance * (1 if ended == 1 else after)


def half_discounted_reading(
    chance: Fraction, ended: int, reward: Fraction, following: int, after: Fraction
) -> Fraction:
    return chance * (reward + after / 2)


@given(tables(), st.integers(1, 7), st.lists(st.integers(0, 8), min_size=4, max_size=4))
def test_certificates_are_those_of_fractions(tabular: Tabular, limit: int, eighths: list[int]) -> None:
    shares = [[Fraction(one, 8), Fraction(8 - one, 8)] for one in eighths[: tabular.n_states]]
    even = [[Fraction(1, 2)] * 2] * tabular.n_states
    found = certify(tabular, np.array(shares, dtype=np.float64), limit=limit, discount=0.5)
    expected = {
        "random_success": exact_expectation(tabular, even, limit, success_reading),
        "optimal_return": exact_expectation(tabular, None, limit, half_discounted_reading),
        "success": exact_expectation(tabular, shares, limit, success_reading),
        "policy_return": exact_expectation(tabular, shares, limit, half_discounted_reading),
    }
    for name, value in expected.items():
        assert getattr(found, name) == pytest.approx(float(value), rel=1e-13, abs=1e-13), name
    assert found.regret == pytest.approx(float(expected["optimal_return"] - expected["policy_return"]), abs=1e-13)
    assert found.regret >= -1e-13
    p = expected["success"]
    assert found.learnability == pytest.approx(float(p * (1 - p)), abs=1e-13)
    assert found.solvable == (expected["random_success"] > 0)


@given(tables(), st.sampled_from([1, 2]))
def test_the_shortest_plan_is_the_smallest_limit_with_a_positive_probability(tabular: Tabular, outcome: int) -> None:
    def ends_so(chance: Fraction, ended: int, reward: Fraction, following: int, after: Fraction) -> Fraction:
        return chance * (1 if ended == outcome else after)

    limits = range(1, tabular.n_states + 1)
    first = next((limit for limit in limits if exact_expectation(tabular, None, limit, ends_so) > 0), inf)
    assert shortest_plan(tabular, outcome) == shortest_plan(tabular, outcome, native=False) == first


@pytest.mark.parametrize("seed", range(6))
def test_certificates_with_a_large_limit_agree_with_linear_equations(seed: int) -> None:
    tabular = random_table(seed)
    policy = np.random.default_rng(seed).dirichlet(np.ones(3), size=12)
    chance = policy[:, :, None] * tabular.probability
    moves = np.zeros((12, 12))
    origin = np.broadcast_to(np.arange(12)[:, None, None], chance.shape)
    np.add.at(moves, (origin, tabular.next_state), np.where(tabular.terminated == 0, chance, 0.0))
    moves[11] = 0.0  # nobody steps from there
    start = np.bincount(tabular.start_states, tabular.start_probability, minlength=12)
    visits = np.linalg.solve((np.eye(12) - moves).T, start)
    discounted = np.linalg.solve((np.eye(12) - 0.9 * moves).T, start)
    found = certify(tabular, policy, limit=5_000, discount=0.9)
    assert found.success == pytest.approx(visits @ (chance * (tabular.terminated == 1)).sum(axis=(1, 2)), rel=1e-12)
    assert found.policy_return == pytest.approx(discounted @ (chance * tabular.reward).sum(axis=(1, 2)), rel=1e-12)
    best = value_iteration(tabular, 0.9, 1e-13)
    assert found.optimal_return == pytest.approx(start @ best.values, rel=1e-12)
    assert certify(tabular, best.policy, limit=5_000, discount=0.9).regret == pytest.approx(0.0, abs=1e-12)


@pytest.mark.skipif(find_spec("numba") is None, reason="needs numba")
@pytest.mark.parametrize("seed", range(4))
def test_compiled_and_python_loops_give_identical_results(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    cases = [random_table(seed), forest(["SVB", "RWR", "BVG"])]
    policies = [np.random.default_rng(seed).integers(one.n_actions, size=one.n_states) for one in cases]

    def all_results() -> list[object]:
        solved = [value_iteration(one) for one in cases]
        values = [(one.values.tobytes(), one.action_values.tobytes()) for one in solved]
        return [*values, *(certify(*each, limit=50) for each in zip(cases, policies, strict=True))]

    compiled = all_results()
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    assert all_results() == compiled


def test_certificates_of_the_published_target() -> None:
    target = published_family()[-1]
    found = certify(target, value_iteration(target).policy)
    assert found.solvable
    assert found.shortest_plan == 14.0
    assert found.random_success == hit_probability(target)
    assert (found.success, found.learnability) == (1.0, 0.0)
    assert found.optimal_return == pytest.approx(10.2, abs=1e-12)
    assert found.regret == pytest.approx(0.0, abs=1e-12)


def test_certificates_without_a_policy_use_the_random_walk() -> None:
    coin = table([[[(1.0, 1, 1.0, 1)], [(1.0, 0, 0.0, 0)]], [END, END]])
    found = certify(coin, limit=1)
    assert (found.random_success, found.success, found.policy_return) == (0.5, 0.5, 0.5)
    assert (found.regret, found.learnability) == (0.5, 0.25)


def test_a_policy_can_be_given_as_actions_or_as_probabilities() -> None:
    tabular = random_table(1)
    actions = np.arange(12) % 3
    assert certify(tabular, actions) == certify(tabular, np.eye(3)[actions])


def test_a_table_is_not_solvable_if_success_takes_longer_than_the_limit() -> None:
    way = table([[[(1.0, 1, 0.0, 0)]], [[(1.0, 1, 1.0, 1)]]])
    near, far = certify(way, limit=2), certify(way, limit=1)
    assert (near.shortest_plan, near.solvable, near.random_success) == (2.0, True, 1.0)
    assert (far.shortest_plan, far.solvable, far.random_success) == (2.0, False, 0.0)
    assert certify(forest(["SB", "BG"])).shortest_plan == inf


def test_the_optimal_return_uses_policies_that_depend_on_the_step() -> None:
    """Waiting is worth 1 a step, leaving at the last one 5: no policy over states does both."""
    door = table([[[(1.0, 0, 1.0, 0)], [(1.0, 1, 5.0, 1)]], [END, END]])
    assert optimal_return(door, 10) == 14.0
    assert certify(door, np.array([0, 0]), limit=10).policy_return == 10.0
    assert certify(door, np.array([1, 1]), limit=10).regret == 9.0


@given(st.lists(st.integers(-5, 5), min_size=1, max_size=6), st.integers(1, 12))
def test_cvar_is_the_greatest_lower_bound_of_rockafellar_and_uryasev(values: list[int], twelfths: int) -> None:
    alpha = Fraction(twelfths, 12)
    bounds = (
        level - sum((Fraction(max(level - value, 0)) for value in values), Fraction(0)) / len(values) / alpha
        for level in values
    )
    assert cvar(values, twelfths / 12) == pytest.approx(float(max(bounds)), abs=1e-12)


def test_cvar_is_the_minimum_at_alpha_0_and_the_mean_at_alpha_1() -> None:
    assert cvar([3.0, 1.0, 2.0], 0.0) == 1.0
    assert cvar([3.0, 1.0, 2.0], 1.0) == 2.0
    assert cvar([inf, 1.0, 3.0], 0.5) == pytest.approx(5 / 3)
    assert cvar([0.0, -inf], 1.0) == -inf


@pytest.mark.parametrize("policy", [[0.5, 0.4], [1.5, -0.5], [0.5, float("nan")]])
def test_a_policy_that_is_not_a_distribution_is_refused(policy: list[float]) -> None:
    two = table([[[(1.0, 0, 0.0, 0)]] * 2])
    with pytest.raises(InvalidArgument, match="probabilities of actions"):
        evaluate_policy(two, np.array([policy]), 1)


def test_invalid_arguments_are_refused() -> None:
    loop = table([[[(1.0, 0, 0.0, 0)]]])
    for policy in (np.zeros(2, int), np.zeros(1), np.ones((1, 2))):
        with pytest.raises(InvalidArgument, match="`policy` has the shape"):
            certify(loop, policy)
    with pytest.raises(InvalidArgument, match="actions that are not from 0 to"):
        certify(loop, np.array([1]))
    with pytest.raises(InvalidArgument, match="`limit`, 0, must be positive"):
        certify(loop, limit=0)
    with pytest.raises(InvalidArgument, match="must be positive"):
        evaluate_policy(loop, None, 1, discount=1.5)
    with pytest.raises(InvalidArgument, match="`values`"):
        cvar([], 0.5)
    with pytest.raises(InvalidArgument, match="`alpha`"):
        cvar([1.0], 1.5)
