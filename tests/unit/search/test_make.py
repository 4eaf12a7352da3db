"""What `make` shares between calls, how long it may visit states, and what it can be given."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

import gymnasium
import pytest
from gymnasium.envs.registration import EnvSpec

import envgraph
from envgraph.cli import main
from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv
from envgraph.env.compiled import CompiledEnv
from envgraph.env.compiled.layout._compiled_costs import CompiledCosts
from envgraph.errors import EvaluationError, InvalidArgument, LoadError
from envgraph.lang import bundled_domain
from envgraph.search import generate, make_environment, make_vector_environment, write_family
from envgraph.search.families import _lazy_family


@pytest.fixture
def domain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of a domain, and a cache of its own."""
    monkeypatch.setenv("ENVGRAPH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copytree(bundled_domain("keydoor"), tmp_path / "doors"))


@pytest.fixture
def without_numba(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")


def compiled(*arguments: Any, **options: Any) -> CompiledEnv:
    env = envgraph.make(*arguments, **options, engine="compiled").unwrapped
    assert isinstance(env, CompiledEnv)
    return env


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new), "utf-8")


# --- shared between calls


@pytest.mark.usefixtures("without_numba")
def test_environments_of_the_same_files_share_a_program_and_step_by_themselves(domain: Path) -> None:
    one, other = (compiled(domain=str(domain), render_mode="ansi") for _ in range(2))
    assert one.program is other.program
    assert one.reset(seed=1)[0] == other.reset(seed=1)[0] and one.render() == (before := other.render())
    for action in range(9):
        one.step(action)
    assert one.render() != before == other.render()
    engines = [env.program.live_counterpart(0).simulator.engine for env in (one, other)]
    assert engines[0] is not engines[1]  # so that threads may draw both


@pytest.mark.usefixtures("without_numba")
@pytest.mark.parametrize("engine", ["table", "compiled", "live"])
def test_an_edited_file_is_read_again(domain: Path, engine: str) -> None:
    def reward() -> float:
        env = envgraph.make(domain=str(domain), engine=engine)
        env.reset(seed=0)
        return float(env.step(0)[1])

    assert [reward(), reward()] == [-0.01, -0.01]
    edit(domain / "keydoor.environment", "each step reward -0.01", "each step reward -0.02")
    assert reward() == -0.02
    (domain / "keydoor.query").rename(domain / "hidden")
    with pytest.raises(LoadError, match="there is no such file"):
        reward()
    (domain / "hidden").rename(domain / "keydoor.query")
    edit(domain / "keydoor.environment", "each step reward -0.02", "each step reward -0.01")
    assert reward() == -0.01


@pytest.mark.usefixtures("without_numba")
def test_members_of_an_edited_family_file_are_made_anew(domain: Path) -> None:
    file = domain / "family.json"
    file.write_text(write_family(generate("keydoor/diverse.toml", domain / "run.sqlite", generations=0)), "utf-8")
    programs = [compiled(file, name).program for name in (1, 2, 1)]
    assert programs[0] is programs[2] is not programs[1]
    edit(file, "each step reward -0.01", "each step reward -0.02")
    again = compiled(file, 1).program
    assert again is not programs[0] and again.source != programs[0].source


def test_only_the_last_families_stay_in_memory(domain: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_lazy_family, "SHARED_FAMILIES", 2)
    for name in ("keydoor", str(domain), "taxi", "keydoor"):
        envgraph.make(domain=name, engine="live")
    assert [place[1].split("/")[-2] for place in _lazy_family._shared_families] == ["taxi", "keydoor"]


# --- how many outcomes are visited


@pytest.mark.usefixtures("without_numba")
def test_a_table_that_takes_the_live_engine_long_is_made_only_if_it_is_asked_for(
    domain: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_lazy_family, "OUTCOMES_FOR_A_TABLE", 200)  # there are 216
    make = partial(make_environment, str(domain))
    for _ in range(2):
        with pytest.warns(UserWarning, match=r"`KeyDoor` has more than 200 outcomes .*; a program that Python runs is"):
            assert isinstance(make(), CompiledEnv)
    with pytest.warns(UserWarning, match="more than 100 outcomes"):
        make_vector_environment(2, family=_family(domain), variant=[1, 2])
    monkeypatch.setattr(_lazy_family, "OUTCOMES_FOR_A_TABLE", 216)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert isinstance(make(), EnvgraphEnv)
        monkeypatch.setattr(_lazy_family, "OUTCOMES_FOR_A_TABLE", 200)
        assert isinstance(make(engine="table"), EnvgraphEnv)
        assert isinstance(make(), EnvgraphEnv)  # its table is cached now


@pytest.mark.usefixtures("without_numba")
def test_drawing_the_states_of_a_table_takes_long_too(domain: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_lazy_family, "OUTCOMES_FOR_A_TABLE", 220)
    monkeypatch.setattr(CompiledCosts, "picture_outcomes", 10)
    with pytest.warns(UserWarning, match="`KeyDoor` has more than 22 states"):
        assert isinstance(make_environment(str(domain), render_mode="ansi"), CompiledEnv)
    assert isinstance(make_environment(str(domain)), EnvgraphEnv)


def _family(domain: Path) -> Path:
    file = domain / "family.json"
    file.write_text(write_family(generate("keydoor/diverse.toml", domain / "run.sqlite", generations=0)), "utf-8")
    return file


def test_a_behaviour_that_is_not_compiled_is_live_if_a_table_takes_long(
    domain: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    edit(domain / "keydoor.environment", "take(hero)", "grab(hero)")
    with (domain / "keydoor.rules").open("a") as file:
        file.write("\nunit grab(hero : Hero) { try { take(hero); grab(hero); } }\n")
    monkeypatch.setattr(_lazy_family, "OUTCOMES_FOR_A_TABLE", 100)
    with pytest.warns(UserWarning, match="has more than 100 outcomes .* calls itself; the live engine is used instead"):
        assert isinstance(make_environment(str(domain)), EnvgraphLiveEnv)
    assert make_vector_environment(2, str(domain)).reset(seed=0)[1]["state"].tolist() == [0, 0]  # live is no vector


# --- what it can be given


def test_a_model_and_an_environment_need_no_family_file(domain: Path) -> None:
    files = {"model": domain / "two_rooms.model", "environment": domain / "keydoor.environment"}
    every: list[dict[str, Any]] = [{"domain": "doors"}, {"domain": domain}, {**files}]
    wanted = envgraph.make(domain="doors").reset(seed=0)[0]
    (domain / "family.toml").unlink()
    for file in domain.glob("*.toml"):
        file.unlink()
    for number, given in enumerate(every):
        spec = envgraph.make(**given).spec
        assert spec is not None and spec.max_episode_steps == 100
        assert gymnasium.make(EnvSpec.from_json(spec.to_json())).reset(seed=0)[0] == wanted
        assert envgraph.make_vec(num_envs=2, **given, engine="compiled").reset(seed=0)[0].tolist() == [wanted, wanted]
        assert gymnasium.make(envgraph.register(**given, name=f"Doors{number}")).reset(seed=0)[0] == wanted


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: envgraph.make(model="doors/two_rooms.model"),
            "give one of these: .* a `model` with its `environment`",
        ),
        (lambda: envgraph.make(domain="doors", model="a", environment="b"), "give one of these"),
        (
            lambda: envgraph.make(domain="doors"),
            "`doors` has no family file, but 2 models and 1 environments; name one",
        ),
        (lambda: envgraph.make(model="doors/x.model", environment="doors/keydoor.environment"), "no such file"),
        (
            lambda: envgraph.make(model="doors/keydoor.query", environment="doors/keydoor.environment"),
            "define 0 models, but must define one",
        ),
        (
            lambda: envgraph.make(model="doors/two_rooms.model", environment="doors/keydoor.query"),
            "do not define exactly one environment; their environments are none",
        ),
        (lambda: envgraph.make("doors"), "there is no run `doors` in runs; it is a domain: use .*domain='doors'"),
        (lambda: envgraph.make("keydoor"), "no run `keydoor` in runs; it is a domain: use .*domain='keydoor'"),
        (lambda: envgraph.make("nowhere"), "there is no run `nowhere` in runs; run `envgraph generate`"),
        (lambda: envgraph.make(domain="railway"), "has no `family.toml`"),
        (lambda: envgraph.make(cast(Any, ["E1"])), "`family` is a list, but must be a family file, .*`make_vec` also"),
    ],
)
def test_what_make_cannot_find_is_reported(domain: Path, make: Callable[[], Any], message: str) -> None:
    (domain / "family.toml").unlink()
    shutil.copy(domain / "two_rooms.model", domain / "other.model")
    with pytest.raises((InvalidArgument, LoadError), match=message):
        make()


def test_a_search_asks_for_the_family_file(
    domain: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (domain / "family.toml").unlink()
    monkeypatch.setattr("sys.argv", ["envgraph", "generate", "doors"])
    assert main() == 1
    assert "doors/family.toml:1:1: there is no such file" in capsys.readouterr().err


def test_random_functions_are_answered_with_how_chance_is_written(domain: Path) -> None:
    edit(domain / "keydoor.environment", "each step reward -0.01", "each step reward random()")
    with pytest.raises((LoadError, EvaluationError), match=r"unknown function `random`[\s\S]*hint: write chance in an"):
        envgraph.make(domain=str(domain))
