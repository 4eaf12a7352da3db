"""Families that are searched for as a whole: what may be a family, what a move changes, what a search finds."""

from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from itertools import islice
from math import inf

import numpy as np
import pytest
from numpy.typing import NDArray

from envgraph.env import Tabular, TooManyStates
from envgraph.env.compiled import Plans, explored, program_of
from envgraph.errors import LIMITS, InvalidArgument
from envgraph.graph import model_to_json
from envgraph.search import Domain
from envgraph.search.curricula import (
    CurriculumSearch,
    CurriculumSettings,
    Learning,
    Level,
    Levels,
    Measured,
    Moves,
    Starts,
    _climb,
    value_of,
)
from envgraph.search.problem._family_measures import ChainTransfer
from envgraph.solve import chain_transfer, evaluate
from envgraph.solve.learning import TrainingSettings, train_curriculum, train_program
from tests.profile import AT_NIGHT, NIGHTLY

needs_numba = pytest.mark.skipif(
    find_spec("numba") is None, reason="numba, the extra `fast`, is not installed"
)
SETTINGS = CurriculumSettings(population=4, effort=6_000_000, lanes=2)


def levels_of(name: str) -> Levels:
    domain = Domain.load(name)
    behaviour = domain.behaviour
    assert behaviour is not None
    return Levels(domain.problem(domain.engine()), behaviour)


def started(levels: Levels, size: int, demanded: float | None, count: int) -> list[tuple[Level, ...]]:
    """Return the first families that a search begins with: `count` of them, or as many as 60 draws give."""
    rng = np.random.default_rng(0)
    starts = Starts(levels, Moves(levels, demanded), demanded, rng)
    drawn = (starts.draw(starts.origin(rng), size, rng) for _ in range(60))
    return [*islice((family for family in drawn if family is not None), count)]


def text(levels: Levels, level: Level) -> object:
    levels.go_to(level.version)
    return model_to_json(levels.engine.model)


class Fires:
    """An objective that nobody has to learn for: how many tiles burn in all members but the target."""

    drawn, most, effort = False, 189.0, 1_000

    def __init__(self, levels: Levels) -> None:
        self._levels = levels

    def scores(self, family: Sequence[Level], seeds: range) -> NDArray[np.float64]:
        return np.full((1, len(seeds)), float(sum(map(self.fires, family[:-1]))))

    def fires(self, level: Level) -> int:
        self._levels.go_to(level.version)
        return len(self._levels.engine.model.graph.extent("BurningTile"))


@pytest.mark.parametrize("name", ["burning_forest/paper.toml", "keydoor/diverse.toml"])
def test_families_to_begin_with_lead_to_the_target_by_valid_members(name: str) -> None:
    domain, levels = Domain.load(name), levels_of(name)
    families = started(levels, 4, None, 4)
    assert len(families) == 4
    problem = domain.problem(domain.engine())
    origin = problem.engine.commit()
    for family in families:
        assert family[-1] is levels.target
        assert len({level.state for level in family}) == 4
        for harder, easier in zip(family[1:], family[:-1], strict=True):
            assert easier.trace[: len(harder.trace)] == harder.trace, "what is eased further was eased before"
        for level in family:
            problem.engine.checkout(origin, discard=True)
            problem.engine.replay(level.trace)
            assert problem.engine.model.state_hash() == level.state
            assert problem.valid()
            assert problem.measure() == level.measures


@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("lava/family.toml", 50_000),
        pytest.param("sokoban/diverse.toml", 50_000, marks=AT_NIGHT),
        ("sokoban/diverse.toml", 10),
    ],
)
def test_families_may_begin_on_the_way_of_an_optimal_episode(
    name: str, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(LIMITS, "searched states", most)  # with fewer there is no table, but a plan
    levels, rng = levels_of(name), np.random.default_rng(1)
    plans = Plans(levels.behaviour)
    starts = Starts(levels, Moves(levels), None, rng, "episode")
    families = [family for _ in range(2) if (family := starts.draw(starts.origin(rng), 4, rng)) is not None]
    assert families
    for family in families:
        assert family[-1] is levels.target
        left = []
        for level in family:
            levels.go_to(level.version)
            left.append(plans.plan(levels.engine).steps)
        assert left == sorted(left) and 0 < left[0] < left[1] < left[2] <= left[3]
        for level in family:
            levels.go_to(levels.origin)
            assert levels.replayed(level.trace)
            assert levels.engine.model.state_hash() == level.state


def test_without_a_table_easing_plays_no_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LIMITS, "searched states", 10)
    levels, rng = levels_of("sokoban/diverse.toml"), np.random.default_rng(1)
    before = rng.bit_generator.state
    Starts(levels, Moves(levels), None, rng)
    assert rng.bit_generator.state == before


def test_families_begin_on_no_way_that_does_not_end_in_success() -> None:
    levels = levels_of("lava/diverse.toml")
    levels = Levels(levels.problem, replace(levels.behaviour, limit=5))
    with pytest.raises(InvalidArgument, match="no optimal episode of the target was found"):
        Starts(levels, Moves(levels), None, np.random.default_rng(1), "episode")


def test_families_to_begin_with_are_as_diverse_as_demanded() -> None:
    levels = levels_of("burning_forest/paper.toml")
    most = levels.problem.maximum(6)
    families = started(levels, 6, most - 1e-9, 8)
    assert families
    assert [levels.diversity(family) for family in families] == pytest.approx([most] * len(families))


def test_a_model_with_an_observed_object_that_the_target_lacks_is_no_member() -> None:
    levels = levels_of("sokoban/diverse.toml")
    for rule, found in (("sokoban.moveBox", True), ("sokoban.clear", False)):
        levels.go_to(levels.target.version)
        rows = [match.row for match in levels.engine.matches(rule, applicable=True)]
        made = []
        for row in rows:
            levels.go_to(levels.target.version)
            assert levels.replayed([(rule, row)])
            made.append(levels.here(((rule, row),)))
        assert rows and any(made) == found
    assert levels.rejected["it has an observed object of class `Floor` that the target does not have"]


def test_families_to_begin_with_are_the_same_where_observations_are_numbered_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wanted = [
        [level.trace for level in family]
        for family in started(levels_of("burning_forest/paper.toml"), 4, None, 8)
    ]
    monkeypatch.setitem(LIMITS, "action values", 1)
    assert [
        [level.trace for level in one] for one in started(levels_of("burning_forest/paper.toml"), 4, None, 8)
    ] == wanted


@pytest.mark.parametrize("name", ["burning_forest/paper.toml", "keydoor/diverse.toml"])
def test_moves_make_families_of_valid_members_and_leave_versions_as_they_are(name: str) -> None:
    domain, levels, rng = Domain.load(name), levels_of(name), np.random.default_rng(1)
    family = started(levels, 4, None, 1)[0]
    before = [text(levels, level) for level in family]
    moves, fresh = Moves(levels), domain.problem(domain.engine())
    origin, children, several = fresh.engine.commit(), 0, 0
    for _ in range(40):
        child = moves.draw(family, rng)
        if child is None:
            continue
        changed = [one for one, other in zip(child, family, strict=True) if one is not other]
        children, several = children + 1, several + (len(changed) > 1)
        assert child[-1] is levels.target
        assert len({level.state for level in child}) == len(child)
        for level in changed:
            fresh.engine.checkout(origin, discard=True)
            fresh.engine.replay(level.trace)
            assert fresh.engine.model.state_hash() == level.state
            assert fresh.valid()
    assert children > 6
    assert several > 2
    assert [text(levels, level) for level in family] == before


def test_a_move_keeps_the_diversity_that_is_demanded() -> None:
    levels, rng = levels_of("burning_forest/paper.toml"), np.random.default_rng(2)
    demanded = levels.problem.maximum(6) - 1e-9
    family = started(levels, 6, demanded, 1)[0]
    moves = Moves(levels, demanded)
    children = [child for _ in range(60) if (child := moves.draw(family, rng)) is not None]
    assert children
    assert all(levels.diversity(child) >= demanded for child in children)


def test_an_objective_of_ones_own_is_climbed() -> None:
    levels = levels_of("burning_forest/paper.toml")
    objective = Fires(levels)
    first = max(objective.scores(family, range(1))[0, 0] for family in started(levels, 4, None, 60))
    found = CurriculumSearch(levels, objective, replace(SETTINGS, effort=15_000_000), seed=3).run()
    assert found.value == sum(map(objective.fires, found.family[:-1])) > first


def test_a_search_ends_where_it_is_enough() -> None:
    levels = levels_of("burning_forest/paper.toml")
    seen: list[float] = []
    settings = replace(SETTINGS, enough=10.0)
    result = CurriculumSearch(levels, Fires(levels), settings, 3, lambda one: seen.append(one.value)).run()
    assert result.value >= 10.0
    assert result.spent < 1.0
    assert max(seen) == result.value


def test_what_costs_no_steps_counts_too() -> None:
    """Else a search whose moves all succeed has no end."""
    levels = levels_of("burning_forest/paper.toml")

    class Free(Fires):
        effort = 0

    told: list[float] = []
    settings = replace(SETTINGS, effort=2_000_000)
    found = CurriculumSearch(levels, Free(levels), settings, 3, lambda one: told.append(one.spent)).run()
    assert found.tried <= settings.effort // _climb.CLIMB.level + 2 * settings.lanes
    assert told[-1] == 1.0


def test_chain_transfer_is_an_objective() -> None:
    levels = levels_of("burning_forest/paper.toml")
    objective = Measured(ChainTransfer(), 4)
    family = started(levels, 4, None, 1)[0]
    expected = chain_transfer([level.tabular for level in family])
    assert objective.scores(family, range(3)).tolist() == [pytest.approx([expected] * 3)]
    found = CurriculumSearch(levels, objective, replace(SETTINGS, effort=1_000_000), seed=1).run()
    assert found.value == objective.scores(found.family, range(1))[0, 0] <= 0.0
    assert found.value > np.mean([objective.scores(one, range(1)) for one in started(levels, 4, None, 8)])


def test_nothing_that_is_as_diverse_as_demanded_is_an_error_that_says_why(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    levels = levels_of("keydoor/diverse.toml")
    monkeypatch.setattr(_climb.ClimbCosts, "births", 20)
    settings = CurriculumSettings(population=4, effort=10_000, demanded=1.99)
    with pytest.raises(InvalidArgument, match=r"no valid family with a diversity of 1[.]990 was found"):
        CurriculumSearch(levels, Measured(ChainTransfer(), 4), settings, seed=1).run()


def test_a_value_leans_on_the_worst_criterion() -> None:
    assert value_of(np.array([[1.0, 1.0], [0.0, 0.5]])) == 0.5 * (0.625 + 0.25)


# --- learners


def generator(seed: int, number: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(2, number))))


@needs_numba
@pytest.mark.parametrize("workers", [1, 3])
def test_learning_is_what_the_trainer_comes_to(workers: int) -> None:
    levels = levels_of("burning_forest/paper.toml")
    family = started(levels, 4, None, 1)[0]
    training = TrainingSettings(limit=200)
    scores = Learning(training, levels.target, [500, 3_000], 9, workers).scores(family, range(4, 9))
    tables = [level.tabular for level in family]
    for criterion, steps in enumerate((500, 3_000)):
        for place, number in enumerate(range(4, 9)):
            settings = replace(training, steps_per_environment=steps)
            rng = generator(9, number)
            q = train_curriculum(tables, settings, rng, backend="python").q
            success = evaluate(q, tables[-1], 1, 200, rng).success_rate
            assert (scores[criterion, place] == 1.0) == (success == 1.0)
            assert 0.0 <= scores[criterion, place] <= 1.0


@needs_numba
def test_workers_and_repetition_change_nothing() -> None:
    def found(workers: int) -> tuple[float, list[int]]:
        levels = levels_of("burning_forest/paper.toml")
        objective = Learning(TrainingSettings(limit=200), levels.target, [300], 5, workers)
        result = CurriculumSearch(levels, objective, replace(SETTINGS, effort=1_500_000), 5).run()
        return result.value, [level.state for level in result.family]

    assert found(1) == found(2)


@needs_numba
@pytest.mark.parametrize("workers", [1, 3])
def test_learning_without_tables_is_what_training_in_a_program_comes_to(
    workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(LIMITS, "searched states", 20)
    domain, levels = Domain.load("keydoor/diverse.toml"), levels_of("keydoor/diverse.toml")
    behaviour, training = domain.behaviour, TrainingSettings(limit=100)
    assert behaviour is not None
    family = started(levels, 3, None, 1)[0]
    engines = []
    for level in family:
        levels.go_to(level.version)
        engines.append(levels.engine.copy())
    program = program_of(engines[-1], behaviour, engines, levels.keys)
    scores = Learning(training, levels.target, [400, 4_000], 9, workers).scores(family, range(4, 9))
    with pytest.raises(TooManyStates):
        levels.target.table  # noqa: B018
    for criterion, steps in enumerate((400, 4_000)):
        for place, number in enumerate(range(4, 9)):
            settings, rng = replace(training, steps_per_environment=steps), generator(9, number)
            learner = train_program(program, settings, rng).learner
            assert scores[criterion, place] == learner.play(2, 16, 100, rng)[0]


@needs_numba
def test_workers_change_nothing_without_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LIMITS, "searched states", 20)

    def found(workers: int) -> tuple[float, list[int]]:
        levels = levels_of("keydoor/diverse.toml")
        objective = Learning(TrainingSettings(limit=100), levels.target, [400], 5, workers)
        result = CurriculumSearch(levels, objective, replace(SETTINGS, effort=1_000_000), 5).run()
        return result.value, [level.state for level in result.family]

    assert found(1) == found(2)


def test_a_family_with_a_member_that_has_no_table_is_worth_nothing() -> None:
    class Large(Measured):
        """Says of all with an odd number of fires that they have too many states."""

        def scores(self, family: Sequence[Level], seeds: range) -> NDArray[np.float64]:
            if any(Fires(levels).fires(level) % 2 for level in family[:-1]):
                raise TooManyStates(levels.behaviour, 24)
            return np.full((1, len(seeds)), -1.0)

    levels = levels_of("burning_forest/paper.toml")
    found = CurriculumSearch(levels, Large(ChainTransfer(), 4), replace(SETTINGS, effort=1_000_000), 1).run()
    assert found.value == -1.0
    assert not any(Fires(levels).fires(level) % 2 for level in found.family[:-1])
    assert levels.rejected["environment `BurningForest` has more than 24 states"] > 0


@needs_numba
def test_a_family_that_is_searched_for_teaches_more_than_those_it_began_with() -> None:
    """Judged on seeds that the search has not seen."""
    levels = levels_of("burning_forest/paper.toml")
    training = TrainingSettings(limit=200)
    search = Learning(training, levels.target, [2_000], 1, 2)
    size, effort, least = 6, 200_000_000 if NIGHTLY else 8_000_000, 0.9
    settings = CurriculumSettings(population=size, effort=effort, lanes=4, demanded=inf)
    found = CurriculumSearch(levels, search, settings, 1).run()
    unseen = Learning(training, levels.target, [2_000], 2, 2)
    count, seeds = (60, 400) if NIGHTLY else (6, 50)
    begun = [unseen.scores(one, range(seeds // 10)).mean() for one in started(levels, size, None, count)]
    assert unseen.scores(found.family, range(seeds)).mean() > max(least, *begun)


def test_levels_know_their_tables() -> None:
    domain, levels = Domain.load("burning_forest/paper.toml"), levels_of("burning_forest/paper.toml")
    behaviour = domain.behaviour
    assert behaviour is not None
    level = started(levels, 4, None, 1)[0][0]
    levels.go_to(level.version)
    expected: Tabular = explored(levels.engine, behaviour, levels.keys).tabular
    assert np.array_equal(level.tabular.next_state, expected.next_state)
    assert np.array_equal(level.tabular.reward, expected.reward)
    assert level.tabular is level.tabular
