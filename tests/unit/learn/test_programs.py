"""Learning in compiled environments: with tables' draws it is what trainers over tables do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from envgraph.env import explore
from envgraph.env.compiled import Learner, has_numba, program_of
from envgraph.env.compiled.layout._compiled_costs import COSTS, CompiledCosts
from envgraph.errors import InvalidArgument
from envgraph.learn import (
    FamilyMember,
    InProgram,
    TrainingSettings,
    fingerprint,
    run_experiment,
    sequences,
    train_curriculum,
    train_program,
)
from envgraph.solve.learning import (
    Stage,
)
from envgraph.solve.learning._programs import (
    learning_rates_of,
    train_learner,
)
from envgraph.solve.learning._training_settings import Agent, Ties
from tests.profile import AT_NIGHT, NIGHTLY
from tests.unit.env.side_by_side import BUNDLED, EXTRA, family_keys, mutants, opened

KEYDOOR = BUNDLED / "keydoor"


def keydoor_files() -> list[object]:
    return [KEYDOOR / "two_rooms.model", KEYDOOR / "keydoor.environment"]


@pytest.mark.parametrize(
    ("native", "agent", "ties"),
    [
        (False, "q_learning", "lowest"),
        (True, "q_learning", "lowest"),
        (True, "sarsa", "random"),
        (True, "expected_sarsa", "lowest"),
    ],
)
def test_training_in_a_program_gives_the_values_of_training_on_tables(native: bool, agent: Agent, ties: Ties) -> None:
    if native:
        pytest.importorskip("numba")
    engine, behaviour = opened(*keydoor_files())  # type: ignore[arg-type]
    engines = mutants(engine, behaviour, 2)
    keys = family_keys(engines, behaviour)
    settings = TrainingSettings(agent=agent, ties=ties, steps_per_environment=700, limit=30, checkpoint=100)
    tables = [explore(each, behaviour, keys).tabular for each in engines]
    assert all(table.deterministic and len(table.start_states) == 1 for table in tables)
    wanted = train_curriculum(tables, settings, np.random.default_rng(3))
    program = program_of(engine, behaviour, engines, keys, native=native)
    learner, rng = Learner(program), np.random.default_rng(3)
    epsilon, curve = 0.0, []
    for member in range(2):
        stage = Stage(700, settings.epsilon.start, settings)
        epsilon, points = learner.train(
            member, stage.curve_points, learning_rates_of(stage), stage.epsilon, settings.limit, rng, draws=0
        )
        curve += points
    assert epsilon == wanted.epsilon
    assert [reward for reward, _, _ in curve[:7]] == list(wanted.curve.reward[:7])
    seen = learner.keys[: learner.count, 0]
    assert len(set(seen.tolist())) == len(seen)
    assert np.array_equal(learner.values[: learner.count], wanted.q[seen])
    others = np.delete(wanted.q, seen, axis=0)
    assert not others.any()
    assert rng.random() == next_random_number(wanted, settings, tables)


def next_random_number(wanted: object, settings: TrainingSettings, tables: object) -> float:
    """The number that a trainer over tables would draw next."""
    rng = np.random.default_rng(3)
    train_curriculum(tables, settings, rng)  # type: ignore[arg-type]
    return float(rng.random())


TWO_BOXES = [EXTRA / "sokoban/small.model", EXTRA / "sokoban/sokoban.environment"]


@pytest.mark.parametrize(
    ("files", "first", "steps"),
    [(keydoor_files(), 16, 3_000), pytest.param(TWO_BOXES, COSTS.first_keys, 1_500_000, marks=AT_NIGHT)],
    ids=["keydoor", "two boxes"],
)
def test_a_learner_grows_if_a_program_has_more_states_than_its_capacity(
    files: list[object], first: int, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(CompiledCosts, "first_keys", first)
    engine, behaviour = opened(*files)  # type: ignore[arg-type]
    program = program_of(engine, behaviour, native=NIGHTLY and has_numba())
    settings = TrainingSettings(steps_per_environment=steps, limit=100, checkpoint=steps // 3)
    training = train_program(program, settings, np.random.default_rng(1), of="state")
    assert training.learner.count > first  # it has grown
    assert training.learner.play(0, 1, 100, np.random.default_rng(2))[0] == 1.0


def test_invalid_arguments_are_refused() -> None:
    engine, behaviour = opened(*keydoor_files())  # type: ignore[arg-type]
    program, rng = program_of(engine, behaviour, native=False), np.random.default_rng(0)
    with pytest.raises(InvalidArgument, match=r"`members` must be one or more numbers from 0 to 0"):
        train_program(program, TrainingSettings(), rng, members=[1])
    with pytest.raises(InvalidArgument, match="positive length"):
        train_program(program, TrainingSettings(), rng, steps=[0])
    with pytest.raises(InvalidArgument, match='"observation" or "state"'):
        train_program(program, TrainingSettings(), rng, of="both")  # type: ignore[arg-type]


def test_experiments_run_in_programs_and_do_not_depend_on_workers() -> None:
    engine, behaviour = opened(*keydoor_files())  # type: ignore[arg-type]
    engines = mutants(engine, behaviour, 2)
    keys = family_keys(engines, behaviour)
    program = program_of(engine, behaviour, engines, keys, native=False)
    family = [FamilyMember(f"E{number + 1}", InProgram(program, number)) for number in range(2)]
    settings = TrainingSettings(steps_per_environment=300, limit=30, seeds=2, evaluation_episodes=3)
    curricula = sequences(["E1", "E2"], "full")
    one = run_experiment(family, settings, curricula)
    assert one.runs == run_experiment(family, settings, curricula, workers=2).runs
    assert [run.steps for run in one.runs] == [600, 600]
    assert all(0.0 <= run.success_rate <= 1.0 and 1 <= run.mean_length <= 30 for run in one.runs)
    taught = replace(curricula[0], stages=(("E1", "E2"), "E2"), schedule="plr")
    (found,) = run_experiment(family, settings, [taught], seeds=[0]).runs
    assert (found.steps, found.steps_before, found.curve.steps) == (600, 300, (600,))
    with pytest.raises(InvalidArgument, match="`exact_regret` needs tables"):
        run_experiment(family, settings, [replace(taught, schedule="exact_regret")])
    marks = [fingerprint({"E1": member.tabular}, settings) for member in family]
    assert marks[0] != marks[1]
    tables = [FamilyMember("E1", explore(engine, behaviour, keys).tabular), family[1]]
    with pytest.raises(InvalidArgument, match="members of one program"):
        run_experiment(tables, settings, curricula)


def test_networks_are_not_trained_in_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("envgraph.solve.learning._training_settings.find_spec", lambda name: True)
    engine, behaviour = opened(*keydoor_files())  # type: ignore[arg-type]
    program = program_of(engine, behaviour, [engine], family_keys([engine], behaviour), native=False)
    settings = TrainingSettings(student="sb3:dqn", steps_per_environment=10, seeds=1)
    with pytest.raises(InvalidArgument, match="`sb3:dqn` needs tables, but the environments have too many states"):
        run_experiment([FamilyMember("E1", InProgram(program, 0))], settings, sequences(["E1"], "direct"))


@pytest.mark.parametrize("native", [False, *([True] if NIGHTLY else [])])
def test_a_learner_can_continue_in_another_program_as_in_another_member(native: bool) -> None:
    """Also to a program with another text, which assumes less of its members."""
    if native:
        pytest.importorskip("numba")
    engine, behaviour = opened(*keydoor_files())  # type: ignore[arg-type]
    engines = mutants(engine, behaviour, 3)
    keys = family_keys(engines, behaviour)
    settings = TrainingSettings(steps_per_environment=600, limit=30, checkpoint=200)
    whole = program_of(engine, behaviour, engines, keys, native=native)
    wanted = train_program(whole, settings, np.random.default_rng(4))
    first = program_of(engine, behaviour, engines[:1], keys, native=native)
    parts = [InProgram(first.with_model(each, keys), 0) for each in engines[:2]]
    assert {place.program.source for place in parts} == {first.source}
    doubted = [*first.layout._single.values()]
    last = program_of(engine, behaviour, engines[2:], keys, native=native, broken=doubted)
    assert last.source != first.source
    learner, rng = Learner(first), np.random.default_rng(4)
    found = train_learner(learner, [*parts, InProgram(last, 0)], settings, [600] * 3, rng)
    assert (found.curve, found.epsilon) == (wanted.curve, wanted.epsilon)
    count = wanted.learner.count
    assert learner.count == count
    assert np.array_equal(learner.keys[:count], wanted.learner.keys[:count])
    assert np.array_equal(learner.values[:count], wanted.learner.values[:count])


def test_learners_refuse_programs_with_other_actions_or_observations() -> None:
    engine, behaviour = opened(*keydoor_files())  # type: ignore[arg-type]
    program = program_of(engine, behaviour, native=False)
    other = program_of(engine, replace(behaviour, observations=behaviour.observations[:1]), native=False)
    for learner, entered in ((Learner(program), other), (Learner(program, of_states=True), replace(program))):
        with pytest.raises(InvalidArgument, match="same actions and observations"):
            learner.switch_program(entered)


@pytest.mark.parametrize(("domain", "drawn"), [("keydoor/two_rooms", False), ("network/backbone", True)])
def test_deterministic_episodes_are_played_once(domain: str, drawn: bool) -> None:
    """Several episodes are what one after the other is."""
    folder, model = domain.split("/")
    files = BUNDLED / folder / f"{model}.model", BUNDLED / folder / f"{folder}.environment"
    program = program_of(*opened(*files), native=False)
    learner, rng = Learner(program), np.random.default_rng(2)
    rates = learning_rates_of(Stage(3_000, 1.0, TrainingSettings()))
    learner.train(0, [3_000], rates, 1.0, 50, rng)
    one, several = np.random.default_rng(5), np.random.default_rng(5)
    episodes = [learner.play(0, 1, 50, one) for _ in range(12)]
    assert learner.play(0, 12, 50, several) == pytest.approx(tuple(np.mean(episodes, axis=0)))
    assert (len(set(episodes)) > 1) == drawn
    assert (one.random() == several.random()) == drawn
