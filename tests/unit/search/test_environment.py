"""Families as Gymnasium environments, against the published semantics."""

from __future__ import annotations

import json
import pickle
import shutil
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import envgraph
import envgraph.env
from envgraph.env import multiagent
from envgraph.env.schedules import InOrder, Replay
from envgraph.errors import InvalidArgument, Source
from envgraph.lang import bundled_domain
from envgraph.learn import FamilyMember, TrainingSettings, optimal_return, run_experiment, sequences
from envgraph.search import Family, import_ga4cl, write_family
from tests.profile import AT_NIGHT
from tests.unit.env.test_vector import same
from tests.unit.learn.forest_tables import forest

ID = "envgraph/BurningForest-v0"
KNOWN = {"random_success": 0.5, "optimal_return": 10.0, "limit": 200.0}


@pytest.fixture(scope="module")
def imported(published: Path, tmp_path_factory: pytest.TempPathFactory) -> Family:
    source = Source("published.json", published.read_text())
    family, _ = import_ga4cl(source, "burning_forest/paper.toml", tmp_path_factory.mktemp("p") / "run.sqlite")
    return family


@pytest.fixture(scope="module")
def family_file(imported: Family, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("f") / "family.json"
    path.write_text(write_family(imported))
    return path


def test_make_aec_without_pettingzoo_names_the_missing_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(multiagent, "_PETTINGZOO", None)
    with pytest.raises(InvalidArgument, match=r"pip install 'envgraph\[multiagent\]'"):
        envgraph.make_aec(domain="warehouse")


@pytest.fixture(scope="module")
def verified_file(imported: Family, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same, with certificates; E6 has no plan that is short enough."""
    members = [
        replace(one, certificates={**KNOWN, "shortest_plan": None if one.name == "E6" else float(number)})
        for number, one in enumerate(imported.members, start=3)
    ]
    path = tmp_path_factory.mktemp("v") / "verified.json"
    path.write_text(write_family(replace(imported, members=tuple(members))))
    return path


def test_every_published_map_steps_as_published(imported: Family, published: Path) -> None:
    """Walks both tables in parallel from the start, over every state that can be reached."""
    for member, entry in zip(imported.members, json.loads(published.read_text())["environments"], strict=True):
        ours, theirs = imported.explored(member).tabular, forest(entry["desc"])
        assert ours.action_names == ("left", "down", "right", "up")
        assert ours.n_observations == theirs.n_observations == 128
        queue = [(int(ours.start_states[0]), int(theirs.start_states[0]))]
        seen = set(queue)
        for mine, other in queue:
            assert ours.observation[mine] == theirs.observation[other]
            for action in range(4):
                assert ours.reward[mine, action, 0] == pytest.approx(theirs.reward[other, action, 0], abs=1e-12)
                outcome = ours.terminated[mine, action, 0]
                assert outcome == theirs.terminated[other, action, 0]
                after = (int(ours.next_state[mine, action, 0]), int(theirs.next_state[other, action, 0]))
                if not outcome and after not in seen:
                    seen.add(after)
                    queue.append(after)
        # The states in which an episode goes on are the same ones.
        assert len(seen) == len({mine for mine, _ in seen}) == len({other for _, other in seen})


def test_the_best_policy_on_the_published_target_returns_10_2(imported: Family) -> None:
    assert optimal_return(imported.explored(imported.members[-1]).tabular) == pytest.approx(10.2, abs=1e-9)


def test_the_published_curriculum_succeeds_and_direct_training_does_not(imported: Family) -> None:
    members = [FamilyMember(one.name, imported.explored(one).tabular) for one in imported.members]
    names = [one.name for one in members]
    curricula = [*sequences(names, "full"), *sequences(names, "direct")]
    found = run_experiment(members, TrainingSettings(), curricula, seeds=range(3)).summaries()
    assert [(one.label, one.success_rate) for one in found] == [("E1-E6", 1.0), ("E6", 0.0)]
    assert found[0].mean_return == pytest.approx(10.2, abs=1e-9)


@pytest.mark.parametrize("render_mode", [None, pytest.param("ansi", marks=AT_NIGHT), "rgb_array"])
def test_family_member_passes_the_gymnasium_checker(family_file: Path, render_mode: str | None) -> None:
    env = gymnasium.make(ID, family=family_file, variant=3, render_mode=render_mode)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=render_mode is None)
    env.close()


def test_a_variant_is_chosen_by_number_or_name_and_the_target_is_the_default(family_file: Path) -> None:
    def states(**options: object) -> int:
        return int(gymnasium.make(ID, family=family_file, **options).unwrapped.tabular.n_states)  # type: ignore[attr-defined]

    assert states(variant=2) == states(variant="E2") != states(variant="E6")
    assert states() == states(variant=6)


def test_make_without_a_family_uses_the_model_of_the_domain() -> None:
    env = gymnasium.make(ID)
    observation, _ = env.reset(seed=0)
    assert observation == 0
    assert env.spec is not None and env.spec.max_episode_steps == 200


def test_an_episode_is_truncated_after_200_steps(family_file: Path) -> None:
    env = gymnasium.make(ID, family=family_file, variant="E1")
    env.reset(seed=1)
    for step in range(1, 201):
        _, reward, terminated, truncated, _ = env.step(3)  # up, into the border
        assert (reward, terminated) == (0.0, False)
        assert truncated == (step == 200)


def test_unknown_variants_and_families_are_reported(family_file: Path) -> None:
    with pytest.raises(InvalidArgument, match="no environment `E9`"):
        gymnasium.make(ID, family=family_file, variant="E9")
    with pytest.raises(InvalidArgument, match="there is no run"):
        gymnasium.make(ID, family="nowhere")
    with pytest.raises(InvalidArgument, match="family"):
        gymnasium.make(ID, variant=2)


def test_a_vector_environment_steps_like_its_parts(family_file: Path) -> None:
    vector = gymnasium.make_vec(
        ID, num_envs=4, family=family_file, variant=["E2", "E6"], vectorization_mode="vector_entry_point"
    )
    assert isinstance(vector, envgraph.env.EnvgraphVectorEnv)
    single = [gymnasium.make(ID, family=family_file, variant=name) for name in ("E2", "E6", "E2", "E6")]
    observations, _ = vector.reset(seed=0)
    assert observations.tolist() == [env.reset(seed=0)[0] for env in single]
    actions = np.random.default_rng(0).integers(4, size=(40, 4))
    running = [True] * 4
    for row in actions:
        observations, rewards, terminated, truncated, _ = vector.step(row)
        for place, env in enumerate(single):
            if running[place]:
                observation, reward, ended, cut, _ = env.step(int(row[place]))
                assert observation == observations[place] and reward == pytest.approx(rewards[place])
                assert (ended, cut) == (terminated[place], truncated[place])
                running[place] = not ended


def test_a_vector_environment_truncates_after_the_registered_limit(family_file: Path) -> None:
    vector = gymnasium.make_vec(
        ID, num_envs=2, family=family_file, variant="E1", vectorization_mode="vector_entry_point"
    )
    vector.reset(seed=0)
    cut = [vector.step(np.array([3, 3]))[3].tolist() for _ in range(200)]
    assert cut == [[False, False]] * 199 + [[True, True]]


def test_make_returns_a_member_of_a_family(family_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(family_file.parent)
    env = envgraph.make(family_file.name, variant=6)
    assert env.spec is not None
    assert (env.spec.id, env.spec.max_episode_steps) == (ID, 200)
    monkeypatch.chdir("/")
    again = gymnasium.make(env.spec, render_mode="ansi")
    assert env.reset(seed=0) == again.reset(seed=0)
    assert env.step(2) == again.step(2)
    check_env(again.unwrapped)
    assert envgraph.make(family_file, max_episode_steps=3, observation="multi").reset()[0].tolist() == [0, 0]


def test_step_limit_of_the_family_file_truncates_episodes(family_file: Path, tmp_path: Path) -> None:
    data = json.loads(family_file.read_text(encoding="utf-8"))
    data["texts"]["paper.toml"] = "limit = 5\n" + data["texts"]["paper.toml"]
    path = tmp_path / "short.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    env = envgraph.make(path, 1)
    env.reset(seed=0)
    assert [env.step(3)[3] for _ in range(5)] == [False] * 4 + [True]
    many = envgraph.make_vec(path, num_envs=3, variant=1)
    many.reset(seed=0)
    assert [many.step(np.full(3, 3))[3].tolist() for _ in range(5)][4] == [True] * 3
    with pytest.raises(InvalidArgument, match=r"use `envgraph\.make\('.*short\.json'\)`"):
        gymnasium.make(ID, family=path)


@pytest.mark.parametrize("options", [{}, {"vectorization_mode": "sync"}, {"live": True}])
def test_make_vec_returns_a_vector_environment(family_file: Path, options: dict[str, object]) -> None:
    many = envgraph.make_vec(family_file, num_envs=2, variant="E1", autoreset_mode="SameStep", **options)
    assert isinstance(many, envgraph.env.EnvgraphVectorEnv) == (not options)
    assert many.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode.SAME_STEP
    many.reset(seed=0)
    steps = [many.step(np.array([3, 3])) for _ in range(200)]
    many.close()
    assert steps[-1][3].tolist() == [True, True]
    assert steps[-1][4]["step"].tolist() == [0, 0]
    assert steps[-1][4]["final_info"]["step"].tolist() == [200, 200]


@pytest.mark.parametrize("engine", ["table", "compiled"])
def test_schedule_can_be_a_name_or_an_object_and_covers_all_members(family_file: Path, engine: str) -> None:
    named = envgraph.make_vec(family_file, 8, schedule="plr", engine=engine)
    assert isinstance(named.unwrapped.schedule, Replay)  # type: ignore[attr-defined]
    assert {*named.reset(seed=0)[1]["member"].tolist()} == {*range(6)}
    own = InOrder([100, 100])
    given = envgraph.make_vec(family_file, 3, ["E2", "E5"], schedule=own, engine=engine)
    assert given.unwrapped.schedule is own  # type: ignore[attr-defined]
    assert given.reset(seed=0)[1]["member"].tolist() == [0, 0, 0]


def test_unknown_or_unsupported_schedules_are_refused(family_file: Path) -> None:
    with pytest.raises(InvalidArgument, match="unknown schedule `prl`"):
        envgraph.make_vec(family_file, 2, schedule="prl")
    for options in ({"engine": "live"}, {"vectorization_mode": "sync"}):
        with pytest.raises(InvalidArgument, match="`schedule` cannot be used with"):
            envgraph.make_vec(family_file, 2, schedule="plr", **options)  # type: ignore[arg-type]


def test_vector_of_a_family_stores_the_table_of_each_member_once(family_file: Path) -> None:
    many = envgraph.make_vec(family_file, 4, ["E1", "E6"])
    alone = [envgraph.make(family_file, name).unwrapped.tabular.n_states for name in ("E1", "E6")]  # type: ignore[attr-defined]
    assert many.unwrapped._observation.shape[0] == sum(alone)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "options", [{"engine": "live"}, {"vectorization_mode": "sync"}, {"vectorization_mode": "async"}]
)
def test_vector_of_single_environments_cycles_through_the_members(
    family_file: Path, options: dict[str, object]
) -> None:
    together = envgraph.make_vec(family_file, 3, ["E1", "E6"], max_episode_steps=8, **options)
    alone = [envgraph.make(family_file, name, max_episode_steps=8) for name in ("E1", "E6", "E1")]
    together.reset(seed=5)
    for place, env in enumerate(alone):
        env.reset(seed=5 + place)
    many = together.step(np.full(3, 1))[:4]
    together.close()
    expected = [env.step(1)[:4] for env in alone]
    assert [row.tolist() for row in many] == [[*column] for column in zip(*expected, strict=True)]
    assert expected[0] != expected[1]


def test_wrappers_are_applied_to_each_member_of_a_vector(family_file: Path) -> None:
    wrapped = envgraph.make_vec(
        family_file, 2, ["E1", "E6"], engine="live", wrappers=[gymnasium.wrappers.RecordEpisodeStatistics]
    )
    assert all(env.has_wrapper_attr("return_queue") for env in wrapped.envs)  # type: ignore[attr-defined]


def test_a_single_environment_refuses_a_list_of_variants(family_file: Path) -> None:
    with pytest.raises(InvalidArgument, match=r"a single name or number; use `envgraph\.make_vec`"):
        envgraph.make(family_file, ["E1", "E6"])  # type: ignore[arg-type]
    with pytest.raises(InvalidArgument, match="a single name or number"):
        gymnasium.make_vec(ID, vectorization_mode="sync", family=family_file, variant=["E1"])


def test_invalid_arguments_of_make_and_make_vec_are_reported(family_file: Path) -> None:
    with pytest.raises(InvalidArgument, match="does not belong to domain `keydoor`"):
        gymnasium.make("envgraph/KeyDoor-v0", family=family_file)
    with pytest.raises(InvalidArgument, match="give one of these: a `family`, a `domain`, or"):
        envgraph.make(family_file, domain="keydoor")
    with pytest.raises(InvalidArgument, match="neither `family` nor `domain` is given"):
        envgraph.make()
    with pytest.raises(InvalidArgument, match="there is no run `nowhere`"):
        envgraph.make("nowhere")
    with pytest.raises(InvalidArgument, match="no environment `E9`"):
        envgraph.make_vec(family_file, variant=["E1", "E9"])
    with pytest.raises(InvalidArgument, match="unknown option `varian`; did you mean `variant`"):
        envgraph.make(family_file, varian=2)
    with pytest.raises(InvalidArgument, match="unknown option `obs`"):
        envgraph.make_vec(family_file, obs="flat")
    with pytest.raises(InvalidArgument, match="`num_envs` is '4', but must be an int"):
        envgraph.make_vec(family_file, "4")  # type: ignore[arg-type]
    for live in (False, True):
        with pytest.raises(InvalidArgument, match="unknown autoreset mode 'never'"):
            envgraph.make_vec(family_file, autoreset_mode="never", live=live)
        with pytest.raises(InvalidArgument, match="`num_envs` is 0"):
            envgraph.make_vec(family_file, num_envs=0, live=live)


def test_gymnasium_is_imported_only_when_an_environment_function_is_used() -> None:
    code = "import sys, envgraph; print('gymnasium' in sys.modules); envgraph.make; print('gymnasium' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["False", "True"]


def test_an_environment_without_a_drawing_passes_the_checker(tmp_path: Path) -> None:
    shutil.copytree(bundled_domain("keydoor"), tmp_path / "plain")
    path = tmp_path / "plain" / "keydoor.environment"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("draw grid Cell at (x, y) with hero at hero.at", ""), encoding="utf-8")
    for live in (False, True):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            check_env(envgraph.make(domain=tmp_path / "plain", live=live).unwrapped)


def test_pictures_show_the_map(family_file: Path) -> None:
    env = gymnasium.make(ID, family=family_file, variant="E6", render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    assert isinstance(picture, np.ndarray) and picture.dtype == np.uint8 and picture.ndim == 3
    assert picture.shape[0] == picture.shape[1] and len(np.unique(picture.reshape(-1, 3), axis=0)) > 5


def test_render_mode_is_checked_before_states_are_enumerated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Family, "explored", lambda *_, **__: pytest.fail("the states are visited"))
    for path in bundled_domain("keydoor").glob("*.*"):
        text = path.read_text(encoding="utf-8")
        kept = [line for line in text.splitlines() if not line.strip().startswith("draw ")]
        (tmp_path / path.name).write_text("\n".join(kept), encoding="utf-8")
    for make in (envgraph.make, envgraph.make_vec):
        with pytest.raises(InvalidArgument, match="its behaviour has no `draw`; write a clause"):
            make(domain=str(tmp_path), render_mode="rgb_array")
        with pytest.raises(InvalidArgument, match=r"unknown render mode 'text'; the render modes are .*`rgb_array`"):
            make(domain=str(tmp_path), render_mode="text")


def test_a_vector_of_a_family_object_equals_that_of_its_file(imported: Family, family_file: Path) -> None:
    made = [envgraph.make_vec(one, 4, ["E1", "E2"]) for one in (imported, family_file)]
    assert made[0].action_names == made[1].action_names == ("left", "down", "right", "up")
    seen: list[list[Any]] = []
    for envs in made:
        seen.append([envs.reset(seed=3)[0]])
        for _ in range(2 * (imported.limit or 0)):
            seen[-1] += envs.step(np.arange(4))[:4]
    assert all(map(same, *seen)) and any(part.any() for part in seen[0][4::4])  # truncated by the limit
    for option in ({"vectorization_mode": "sync"}, {"cell": 8}):
        with pytest.raises(
            InvalidArgument, match=f"`{next(iter(option))}` needs a family in a file; use `write_family`"
        ):
            envgraph.make_vec(imported, 4, **option)
    with pytest.raises(InvalidArgument, match="give one of these: a `family`, a `domain`, or"):
        envgraph.make_vec(imported, 4, domain="keydoor")
    with pytest.raises(InvalidArgument, match=r"has no environment `Member\(name='E1'.*there are `E1`, `E2`"):
        envgraph.make_vec(imported, 4, imported.members[0])  # type: ignore[arg-type]


@pytest.mark.parametrize("engine", ["table", "compiled", "live"])
def test_reset_option_switches_to_another_member_until_the_next_switch(family_file: Path, engine: str) -> None:
    env = envgraph.make(family_file, "E2", engine=engine, render_mode="ansi")
    assert env.reset(seed=1)[1]["variant"] == "E2"
    assert env.reset(seed=1, options={"variant": "E5"})[1]["variant"] == "E5"
    copied = pickle.loads(pickle.dumps(env)) if engine == "table" else env
    assert copied.reset(options={"variant": 3})[1]["variant"] == "E3"
    for wanted in ("E5", "E6"):
        env.reset(seed=4, options={"variant": wanted} if wanted == "E6" else None)
        alone = envgraph.make(family_file, env.reset(seed=4)[1]["variant"], engine=engine, render_mode="ansi")
        assert alone.reset(seed=4) == env.reset(seed=4)
        for action in (2, 2, 1, 1, 2):
            assert alone.render() == env.render()
            step = env.step(action)
            assert step == alone.step(action)
            assert step[4]["variant"] == alone.reset(seed=4)[1]["variant"] if step[2] else True
            if step[2]:
                break
    before = env.reset(seed=0)
    with pytest.raises(InvalidArgument, match="has no environment `E9`"):
        env.reset(options={"variant": "E9"})
    with pytest.raises(InvalidArgument, match=r"unknown reset option `varian`: the options are .*`variant`"):
        env.reset(options={"varian": "E9"})
    assert env.reset(seed=0) == before


def test_reset_option_switches_members_of_a_vector(family_file: Path) -> None:
    many = envgraph.make_vec(family_file, 3, ["E1", "E6"])
    assert many.reset(seed=0)[1]["variant"].tolist() == ["E1", "E6", "E1"]
    assert many.reset(options={"variant": "E6"})[1]["variant"].tolist() == ["E6"] * 3
    mask = np.array([True, False, True])
    _, infos = many.reset(options={"variant": ["E1", "E1", 6], "reset_mask": mask})
    assert infos["variant"].tolist() == ["E1", None, "E6"]
    assert many.step(np.full(3, 1))[4]["variant"].tolist() == ["E1", "E6", "E6"]
    with pytest.raises(InvalidArgument, match="members `E1`, `E6`, but not `E2`; make the vector environment with"):
        many.reset(options={"variant": "E2"})
    with pytest.raises(InvalidArgument, match="2 members, but must list one for each of 3"):
        many.reset(options={"variant": ["E1", "E6"]})
    with pytest.raises(InvalidArgument, match="no environment `E9`"):
        many.reset(options={"variant": "E9"})


@pytest.mark.parametrize(
    ("mode", "engine"),
    [
        *((mode, "table") for mode in AutoresetMode),
        (AutoresetMode.NEXT_STEP, "compiled"),
        pytest.param(AutoresetMode.SAME_STEP, "compiled", marks=AT_NIGHT),
        (AutoresetMode.DISABLED, "compiled"),
    ],
)
def test_vector_of_a_family_behaves_like_a_gymnasium_vector_of_its_members(
    verified_file: Path, mode: AutoresetMode, engine: str
) -> None:
    """Step by step the same as Gymnasium's own vector, infos with certificates included."""
    streams = {"streams": "each"} if engine == "compiled" else {}
    shared = {"autoreset_mode": mode, "max_episode_steps": 9, "action_masks": True, "engine": engine}
    ours = envgraph.make_vec(verified_file, 4, ["E6", "E1", "E3"], **shared, **streams)
    theirs = envgraph.make_vec(verified_file, 4, ["E6", "E1", "E3"], vectorization_mode="sync", **shared)
    assert same(ours.reset(seed=1), theirs.reset(seed=1))
    rng, ends = np.random.default_rng(2), 0
    for number in range(30):
        actions = rng.integers(4, size=4)
        found, (seen, rewards, ended, late, infos) = ours.step(actions), theirs.step(actions)
        assert same(found, (seen, rewards, ended, late, infos)), number
        over = found[2] | found[3]
        ends += int(over.sum())
        if number % 10 == 9 or (mode is AutoresetMode.DISABLED and over.any()):
            mask = over if mode is AutoresetMode.DISABLED and over.any() else np.array([True, False, True, True])
            options = {"reset_mask": mask, "variant": f"E{(3, 6)[number % 2]}"}
            assert same(ours.reset(options=dict(options)), theirs.reset(options=dict(options)))
    assert ends > 8


def test_a_saved_family_is_registered_by_name(family_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(family_file.parent)
    name = envgraph.register(family_file.name, name="Saved", observation="multi")
    assert name == envgraph.register(family_file, name="Saved", observation="multi") == "envgraph/Saved-v0"
    monkeypatch.chdir("/")
    env = gymnasium.make(name, variant="E2")
    assert env.reset(seed=0)[1]["variant"] == "E2"
    assert env.spec is not None and env.spec.max_episode_steps == 200
    many = gymnasium.make_vec(name, 2, vectorization_mode="vector_entry_point", variant=["E1", "E2"])
    assert many.reset(seed=0)[0].shape == (2, 2)
    with pytest.raises(InvalidArgument, match="`envgraph/Saved-v0` is already registered for another environment"):
        envgraph.register(family_file, name="Saved")
    with pytest.raises(InvalidArgument, match="`a b` cannot name an environment"):
        envgraph.register(family_file, name="a b")
    with pytest.raises(InvalidArgument, match=f"`{ID}` is already registered"):
        envgraph.register(family_file)  # that is its name, too


@pytest.mark.parametrize("kind", ["image", "graph", "text", "dict", "flat"])
def test_spaces_are_the_same_in_all_members(family_file: Path, kind: str) -> None:
    engine = {"engine": "live"} if kind in ("image", "graph", "text") else {}
    env, other = (envgraph.make(family_file, name, observation=kind, **engine) for name in ("E1", "E6"))
    assert env.observation_space == other.observation_space
    for variant in ("E6", "E1", "E6"):
        seen = env.reset(seed=0, options={"variant": variant})[0]
        assert env.observation_space.contains(seen)
    assert all(map(np.array_equal, seen, other.reset(seed=0)[0]))
