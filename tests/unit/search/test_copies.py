"""Copies of environments and of what they are made of: they go on alike, and by themselves."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import VectorEnv

import envgraph
from envgraph.env import EnvgraphLiveEnv, Simulator
from envgraph.search import Components, Domain, Gini, generate, open_family, write_family

COPIES: dict[str, Callable[[Any], Any]] = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda one: pickle.loads(pickle.dumps(one)),
}

Maker = Callable[[Path], Any]


def single_environment_maker(**options: Any) -> Maker:
    return lambda family: envgraph.make(family, "E1", **options)


def domain_environment_maker(domain: str, **options: Any) -> Maker:
    return lambda family: envgraph.make(domain=domain, **options)


def vector_environment_maker(**options: Any) -> Maker:
    return lambda family: envgraph.make_vec(family, 4, ["E1", "E2"], max_episode_steps=9, **options)


ENVIRONMENTS: dict[str, Maker] = {
    "table": single_environment_maker(engine="table", render_mode="ansi"),
    "compiled": single_environment_maker(engine="compiled", render_mode="ansi"),
    "live": single_environment_maker(engine="live", render_mode="ansi"),
    "limit and masks": single_environment_maker(
        engine="live", action_masks=True, observation="dict", max_episode_steps=5
    ),
    "images": single_environment_maker(engine="live", observation="image"),
    "graphs": single_environment_maker(engine="compiled", observation="graph"),
    "history": vector_environment_maker(engine="compiled", observation="flat", history=3),
    "history, padded graphs": single_environment_maker(engine="compiled", observation="padded_graph", history=2),
    "texts": single_environment_maker(observation="text"),
    "rewards apart": domain_environment_maker("keydoor", engine="live", rewards=True),
    "random": domain_environment_maker("triage", engine="live"),
    "random, compiled": domain_environment_maker("triage", engine="compiled"),
    "turns": domain_environment_maker("warehouse", engine="live", render_mode="ansi"),
    "turns, compiled": domain_environment_maker("warehouse", engine="compiled", render_mode="ansi"),
    "tables": vector_environment_maker(engine="table", schedule="plr"),
    "programs": vector_environment_maker(engine="compiled", schedule="learning_progress"),
    "threads": vector_environment_maker(engine="compiled", streams="each", threads=2, autoreset_mode="SameStep"),
    "side by side": lambda family: envgraph.make_vec(
        family, 2, ["E1", "E2"], max_episode_steps=9, vectorization_mode="sync", engine="live"
    ),
    "side by side, of a model": lambda family: envgraph.make_vec(domain="keydoor", num_envs=2, live=True),
}


@pytest.fixture(scope="module")
def family(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("family")
    generate("burning_forest/paper.toml", folder / "run.sqlite", overrides=["search.generations=2"])
    (folder / "family.json").write_text(write_family(open_family(folder / "run.sqlite")))
    return folder / "family.json"


@pytest.fixture
def interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiling takes seconds, and what is copied is the same."""
    monkeypatch.setattr("envgraph.env.compiled.programs._compiled_program.has_numba", lambda: False)


def played(env: Any, steps: int, seed: int) -> list[str]:
    """What random actions give, and what that looks like; episodes begin anew without a seed."""
    rng, actions, found = np.random.default_rng(seed), env.action_space, list[Any]()
    for _ in range(steps):
        action = rng.integers(actions.nvec) if isinstance(env, VectorEnv) else int(rng.integers(actions.n))
        found += [env.step(action), env.render()]
        if not isinstance(env, VectorEnv) and (found[-2][2] or found[-2][3]):
            found.append(env.reset())
    return [str(one) for one in found]


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("kind", ENVIRONMENTS)
def test_copied_environments_step_like_the_original_and_do_not_change_it(kind: str, family: Path) -> None:
    original = ENVIRONMENTS[kind](family)
    unbegun = [made(original) for made in COPIES.values()]
    original.reset(seed=5)
    begun = played(original, 7, seed=1)
    copies = [made(original) for made in COPIES.values()]
    copies.append(copy.deepcopy(copies[-1]))
    found = [played(env, 30, seed=2) for env in copies]
    assert [*found, played(original, 30, seed=2)] == 4 * [found[0]]
    assert len({*found[0]}) > 5
    for env in unbegun:
        env.reset(seed=5)
        assert played(env, 7, seed=1) == begun
        env.close()


@pytest.mark.parametrize("how", COPIES)
def test_families_domains_tables_and_programs_can_be_copied(how: str, family: Path) -> None:
    made = COPIES[how]
    whole = open_family(family)
    twin = made(whole)
    assert twin == whole and twin is not whole and twin.keys == whole.keys
    assert twin.members[0]._family is twin and write_family(twin) == write_family(whole)
    table = whole.explored(whole.members[0]).tabular
    for other in (twin.explored(twin.member("E1")).tabular, made(table)):
        assert all(np.array_equal(getattr(table, name), getattr(other, name)) for name in ("next_state", "reward"))
    own = made(whole.domain)
    assert own.initial().state_hash() == whole.domain.initial().state_hash()
    assert own.spec.name == whole.domain.spec.name and own.overrides == whole.domain.overrides
    program = made(whole.program(whole.members[:2]))
    assert program.source == whole.program(whole.members[:2]).source
    derived = open_family(family.with_name("run.sqlite"))  # of models that are made by replaying rules
    assert [one.model for one in made(derived).members] == [one.model for one in derived.members]


@pytest.mark.parametrize("how", COPIES)
def test_copied_engine_continues_the_random_choices_of_the_original(how: str) -> None:
    engine = Domain.load("burning_forest").engine()
    rule = engine.rules[0]
    engine.rng.random(3)
    other = COPIES[how](engine)
    assert other.seed == engine.seed and other.rules == engine.rules and other.step_limit == engine.step_limit
    assert other.rng.random() == engine.rng.random()
    before = engine.model.state_hash()
    assert other.apply(rule) is not None
    assert other.model.state_hash() != before == engine.model.state_hash()
    other.check_integrity()
    assert engine.copy().rng.random() == Domain.load("burning_forest").engine().rng.random()


def make_custom_diversity(options: Any, context: Any) -> Gini:
    return Gini()


@pytest.mark.parametrize("how", COPIES)
def test_custom_components_can_be_copied(how: str) -> None:
    found = COPIES[how](Components().with_("diversity", "mine", make_custom_diversity))
    assert found.diversity["mine"] is make_custom_diversity and found.measure is Components().measure


def test_a_pickled_program_is_compiled_from_its_text(family: Path) -> None:
    pytest.importorskip("numba")
    env = envgraph.make(family, "E1", engine="compiled")
    env.reset(seed=1)
    assert played(pickle.loads(pickle.dumps(env)), 30, seed=2) == played(env, 30, seed=2)


def test_environments_that_cannot_be_copied_raise_an_error_and_stay_usable() -> None:
    engine = Domain.load("keydoor").engine()
    behaviour = Domain.load("keydoor").behaviour
    assert behaviour is not None
    env = EnvgraphLiveEnv(Simulator(engine, behaviour))
    env.reset(seed=0)
    door = engine.model.nodes()[0]
    door.delete()
    with pytest.raises(
        TypeError, match="`KeyDoor` cannot be copied in this episode: its model was changed from outside"
    ):
        copy.deepcopy(env)
    env.reset(seed=0)
    engine.unit(lambda engine: True, name="helper")
    with pytest.raises(TypeError, match="cannot be copied: its engine has event rules or Python functions"):
        pickle.dumps(env)
    assert env.step(0) is not None
    several = envgraph.make_vec(domain="keydoor", num_envs=2, vectorization_mode="async")
    for made in COPIES.values():
        with pytest.raises(TypeError, match=r'cannot be copied: use `vectorization_mode="sync"`'):
            made(several)
    several.reset(seed=0)
    several.step(np.zeros(2, dtype=np.int64))
    several.close()
