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
from envgraph.env.compiled import Plans, explore_fast, program_of
from envgraph.errors import LIMITS, InvalidArgument
from envgraph.graph import model_to_json
from envgraph.search import Domain
from envgraph.search.curricula import (
    CurriculumSearch,
    CurriculumSettings,
    FamilyMoves,
    FirstFamilySampler,
    LearningObjective,
    LevelFactory,
    MeasureObjective,
    ModelLevel,
    _curriculum_search,
    value_of_scores,
)
from envgraph.search.problem._family_measures import ChainTransfer
from envgraph.solve import chain_transfer, evaluate
from envgraph.solve.learning import TrainingSettings, train_curriculum, train_program
from tests.profile import AT_NIGHT, NIGHTLY

needs_numba = pytest.mark.skipif(find_spec("numba") is None, reason="numba, the extra `fast`, is not installed")
SETTINGS = CurriculumSettings(population=4, effort=6_000_000, lanes=2)


def levels_of(name: str) -> LevelFactory:
    domain = Domain.load(name)
    behaviour = domain.behaviour
    assert behaviour is not None
    return LevelFactory(domain.problem(domain.engine()), behaviour)


def start_families(levels: LevelFactory, size: int, demanded: float | None, count: int) -> list[tuple[ModelLevel, ...]]:
    """Return the first families that a search begins with: `count` of them, or as many as 60 draws give."""
    rng = np.random.default_rng(0)
    starts = FirstFamilySampler(levels, FamilyMoves(levels, demanded), demanded, rng)
    drawn = (starts.sample_family(starts.sample_origin(rng), size, rng) for _ in range(60))
    return [*islice((family for family in drawn if family is not None), count)]


def text(levels: LevelFactory, level: ModelLevel) -> object:
    levels.check_out(level.version)
    return model_to_json(levels.engine.model)


class Fires:
    """An objective that nobody has to learn for: how many tiles burn in all members but the target."""

    drawn, most, effort = False, 189.0, 1_000

    def __init__(self, levels: LevelFactory) -> None:
        self._levels = levels

    def scores(self, family: Sequence[ModelLevel], seeds: range) -> NDArray[np.float64]:
        return np.full((1, len(seeds)), float(sum(map(self.fires, family[:-1]))))

    def fires(self, level: ModelLevel) -> int:
        self._levels.check_out(level.version)
        return len(self._levels.engine.model.graph.extent("BurningTile"))


@pytest.mark.parametrize("name", ["burning_forest/paper.toml", "keydoor/diverse.toml"])
def test_start_families_lead_to_the_target_through_valid_members(name: str) -> None:
    domain, levels = Domain.load(name), levels_of(name)
    families = start_families(levels, 4, None, 4)
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
            assert problem.is_valid()
            assert problem.compute_measures() == level.measures


@pytest.mark.parametrize(
    ("name", "most"),
    [
        ("lava/family.toml", 50_000),
        pytest.param("sokoban/diverse.toml", 50_000, marks=AT_NIGHT),
        ("sokoban/diverse.toml", 10),
    ],
)
def test_start_families_can_consist_of_states_of_an_optimal_episode(
    name: str, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(LIMITS, "searched states", most)  # with fewer there is no table, but a plan
    levels, rng = levels_of(name), np.random.default_rng(1)
    plans = Plans(levels.behaviour)
    starts = FirstFamilySampler(levels, FamilyMoves(levels), None, rng, "episode")
    families = [
        family for _ in range(2) if (family := starts.sample_family(starts.sample_origin(rng), 4, rng)) is not None
    ]
    assert families
    for family in families:
        assert family[-1] is levels.target
        left = []
        for level in family:
            levels.check_out(level.version)
            left.append(plans.plan(levels.engine).steps)
        assert left == sorted(left) and 0 < left[0] < left[1] < left[2] <= left[3]
        for level in family:
            levels.check_out(levels.origin)
            assert levels.try_apply_all(level.trace)
            assert levels.engine.model.state_hash() == level.state


def test_easing_without_a_table_plays_no_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LIMITS, "searched states", 10)
    levels, rng = levels_of("sokoban/diverse.toml"), np.random.default_rng(1)
    before = rng.bit_generator.state
    FirstFamilySampler(levels, FamilyMoves(levels), None, rng)
    assert rng.bit_generator.state == before


def test_start_from_an_episode_is_refused_without_a_successful_episode() -> None:
    levels = levels_of("lava/diverse.toml")
    levels = LevelFactory(levels.problem, replace(levels.behaviour, limit=5))
    with pytest.raises(InvalidArgument, match="no optimal episode of the target was found"):
        FirstFamilySampler(levels, FamilyMoves(levels), None, np.random.default_rng(1), "episode")


def test_start_families_have_the_demanded_diversity() -> None:
    levels = levels_of("burning_forest/paper.toml")
    most = levels.problem.largest_diversity(6)
    families = start_families(levels, 6, most - 1e-9, 8)
    assert families
    assert [levels.family_diversity(family) for family in families] == pytest.approx([most] * len(families))


def test_model_with_an_observed_object_missing_from_the_target_is_rejected() -> None:
    levels = levels_of("sokoban/diverse.toml")
    for rule, found in (("sokoban.moveBox", True), ("sokoban.clear", False)):
        levels.check_out(levels.target.version)
        rows = [match.row for match in levels.engine.matches(rule, applicable=True)]
        made = []
        for row in rows:
            levels.check_out(levels.target.version)
            assert levels.try_apply_all([(rule, row)])
            made.append(levels.commit_if_member(((rule, row),)))
        assert rows and any(made) == found
    assert levels.rejection_counts["it has an observed object of class `Floor` that the target does not have"]


def test_renumbering_observations_does_not_change_start_families(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wanted = [
        [level.trace for level in family]
        for family in start_families(levels_of("burning_forest/paper.toml"), 4, None, 8)
    ]
    monkeypatch.setitem(LIMITS, "action values", 1)
    assert [
        [level.trace for level in one] for one in start_families(levels_of("burning_forest/paper.toml"), 4, None, 8)
    ] == wanted


@pytest.mark.parametrize("name", ["burning_forest/paper.toml", "keydoor/diverse.toml"])
def test_search_moves_give_valid_families_and_keep_existing_versions(name: str) -> None:
    domain, levels, rng = Domain.load(name), levels_of(name), np.random.default_rng(1)
    family = start_families(levels, 4, None, 1)[0]
    before = [text(levels, level) for level in family]
    moves, fresh = FamilyMoves(levels), domain.problem(domain.engine())
    origin, children, several = fresh.engine.commit(), 0, 0
    for _ in range(40):
        child = moves.sample_move(family, rng)
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
            assert fresh.is_valid()
    assert children > 6
    assert several > 2
    assert [text(levels, level) for level in family] == before


def test_search_moves_keep_the_demanded_diversity() -> None:
    levels, rng = levels_of("burning_forest/paper.toml"), np.random.default_rng(2)
    demanded = levels.problem.largest_diversity(6) - 1e-9
    family = start_families(levels, 6, demanded, 1)[0]
    moves = FamilyMoves(levels, demanded)
    children = [child for _ in range(60) if (child := moves.sample_move(family, rng)) is not None]
    assert children
    assert all(levels.family_diversity(child) >= demanded for child in children)


def test_search_maximises_a_custom_objective() -> None:
    levels = levels_of("burning_forest/paper.toml")
    objective = Fires(levels)
    first = max(objective.scores(family, range(1))[0, 0] for family in start_families(levels, 4, None, 60))
    found = CurriculumSearch(levels, objective, replace(SETTINGS, effort=15_000_000), seed=3).run()
    assert found.value == sum(map(objective.fires, found.family[:-1])) > first


def test_search_stops_at_a_sufficient_value() -> None:
    levels = levels_of("burning_forest/paper.toml")
    seen: list[float] = []
    settings = replace(SETTINGS, enough=10.0)
    result = CurriculumSearch(levels, Fires(levels), settings, 3, lambda one: seen.append(one.value)).run()
    assert result.value >= 10.0
    assert result.effort_share < 1.0
    assert max(seen) == result.value


def test_search_with_a_free_objective_ends_at_its_effort_limit() -> None:
    """Else a search whose moves all succeed has no end."""
    levels = levels_of("burning_forest/paper.toml")

    class Free(Fires):
        effort = 0

    told: list[float] = []
    settings = replace(SETTINGS, effort=2_000_000)
    found = CurriculumSearch(levels, Free(levels), settings, 3, lambda one: told.append(one.effort_share)).run()
    assert found.families_judged <= settings.effort // _curriculum_search.CLIMB.level + 2 * settings.lanes
    assert told[-1] == 1.0


def test_chain_transfer_is_an_objective() -> None:
    levels = levels_of("burning_forest/paper.toml")
    objective = MeasureObjective(ChainTransfer(), 4)
    family = start_families(levels, 4, None, 1)[0]
    expected = chain_transfer([level.tabular for level in family])
    assert objective.scores(family, range(3)).tolist() == [pytest.approx([expected] * 3)]
    found = CurriculumSearch(levels, objective, replace(SETTINGS, effort=1_000_000), seed=1).run()
    assert found.value == objective.scores(found.family, range(1))[0, 0] <= 0.0
    assert found.value > np.mean([objective.scores(one, range(1)) for one in start_families(levels, 4, None, 8)])


def test_unreachable_demanded_diversity_is_an_error_with_a_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    levels = levels_of("keydoor/diverse.toml")
    monkeypatch.setattr(_curriculum_search.ClimbCosts, "births", 20)
    settings = CurriculumSettings(population=4, effort=10_000, least_diversity=1.99)
    with pytest.raises(InvalidArgument, match=r"no valid family with a diversity of 1[.]990 was found"):
        CurriculumSearch(levels, MeasureObjective(ChainTransfer(), 4), settings, seed=1).run()


def test_value_of_a_family_weighs_the_worst_criterion_more() -> None:
    assert value_of_scores(np.array([[1.0, 1.0], [0.0, 0.5]])) == 0.5 * (0.625 + 0.25)


# --- learners


def generator(seed: int, number: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=(2, number))))


@needs_numba
@pytest.mark.parametrize("workers", [1, 3])
def test_learning_objective_equals_the_result_of_training(workers: int) -> None:
    levels = levels_of("burning_forest/paper.toml")
    family = start_families(levels, 4, None, 1)[0]
    training = TrainingSettings(limit=200)
    scores = LearningObjective(training, levels.target, [500, 3_000], 9, workers).scores(family, range(4, 9))
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
def test_number_of_workers_does_not_change_the_search_result() -> None:
    def found(workers: int) -> tuple[float, list[int]]:
        levels = levels_of("burning_forest/paper.toml")
        objective = LearningObjective(TrainingSettings(limit=200), levels.target, [300], 5, workers)
        result = CurriculumSearch(levels, objective, replace(SETTINGS, effort=1_500_000), 5).run()
        return result.value, [level.state for level in result.family]

    assert found(1) == found(2)


@needs_numba
@pytest.mark.parametrize("workers", [1, 3])
def test_learning_objective_without_tables_equals_training_in_a_program(
    workers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(LIMITS, "searched states", 20)
    domain, levels = Domain.load("keydoor/diverse.toml"), levels_of("keydoor/diverse.toml")
    behaviour, training = domain.behaviour, TrainingSettings(limit=100)
    assert behaviour is not None
    family = start_families(levels, 3, None, 1)[0]
    engines = []
    for level in family:
        levels.check_out(level.version)
        engines.append(levels.engine.copy())
    program = program_of(engines[-1], behaviour, engines, levels.keys)
    scores = LearningObjective(training, levels.target, [400, 4_000], 9, workers).scores(family, range(4, 9))
    with pytest.raises(TooManyStates):
        levels.target.table  # noqa: B018
    for criterion, steps in enumerate((400, 4_000)):
        for place, number in enumerate(range(4, 9)):
            settings, rng = replace(training, steps_per_environment=steps), generator(9, number)
            learner = train_program(program, settings, rng).learner
            assert scores[criterion, place] == learner.play(2, 16, 100, rng)[0]


@needs_numba
def test_number_of_workers_does_not_change_the_search_result_without_tables(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(LIMITS, "searched states", 20)

    def found(workers: int) -> tuple[float, list[int]]:
        levels = levels_of("keydoor/diverse.toml")
        objective = LearningObjective(TrainingSettings(limit=100), levels.target, [400], 5, workers)
        result = CurriculumSearch(levels, objective, replace(SETTINGS, effort=1_000_000), 5).run()
        return result.value, [level.state for level in result.family]

    assert found(1) == found(2)


def test_family_with_a_member_of_too_many_states_is_rejected() -> None:
    class Large(MeasureObjective):
        """Says of all with an odd number of fires that they have too many states."""

        def scores(self, family: Sequence[ModelLevel], seeds: range) -> NDArray[np.float64]:
            if any(Fires(levels).fires(level) % 2 for level in family[:-1]):
                raise TooManyStates(levels.behaviour, 24)
            return np.full((1, len(seeds)), -1.0)

    levels = levels_of("burning_forest/paper.toml")
    found = CurriculumSearch(levels, Large(ChainTransfer(), 4), replace(SETTINGS, effort=1_000_000), 1).run()
    assert found.value == -1.0
    assert not any(Fires(levels).fires(level) % 2 for level in found.family[:-1])
    assert levels.rejection_counts["environment `BurningForest` has more than 24 states"] > 0


@needs_numba
def test_searched_family_teaches_more_than_the_start_families() -> None:
    """Judged on seeds that the search has not seen."""
    levels = levels_of("burning_forest/paper.toml")
    training = TrainingSettings(limit=200)
    search = LearningObjective(training, levels.target, [2_000], 1, 2)
    size, effort, least = 6, 200_000_000 if NIGHTLY else 8_000_000, 0.9
    settings = CurriculumSettings(population=size, effort=effort, lanes=4, least_diversity=inf)
    found = CurriculumSearch(levels, search, settings, 1).run()
    unseen = LearningObjective(training, levels.target, [2_000], 2, 2)
    count, seeds = (60, 400) if NIGHTLY else (6, 50)
    begun = [unseen.scores(one, range(seeds // 10)).mean() for one in start_families(levels, size, None, count)]
    assert unseen.scores(found.family, range(seeds)).mean() > max(least, *begun)


def test_levels_compute_and_cache_their_tables() -> None:
    domain, levels = Domain.load("burning_forest/paper.toml"), levels_of("burning_forest/paper.toml")
    behaviour = domain.behaviour
    assert behaviour is not None
    level = start_families(levels, 4, None, 1)[0][0]
    levels.check_out(level.version)
    expected: Tabular = explore_fast(levels.engine, behaviour, levels.keys).tabular
    assert np.array_equal(level.tabular.next_state, expected.next_state)
    assert np.array_equal(level.tabular.reward, expected.reward)
    assert level.tabular is level.tabular
