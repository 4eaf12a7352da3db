"""Keys of actions: what `gymnasium.utils.play` takes. Wrong keys are in `tests/golden/environment-check`."""

from __future__ import annotations

from pathlib import Path

import pytest

import envgraph
from envgraph.behaviour import KeyIndex, action_keys, indexed_classes
from envgraph.errors import InvalidArgument
from envgraph.search import generate, open_family, write_family
from tests.unit.env.coins import loaded

RIGHT, LEFT, DOWN, UP = range(2**30 + 79, 2**30 + 83)


@pytest.mark.parametrize("engine", ["table", "live"])
def test_keys_are_given_in_the_order_of_the_actions(engine: str) -> None:
    env = envgraph.make(domain="keydoor", engine=engine)
    keys = (LEFT, DOWN, RIGHT, UP, ord("a"), ord("s"), ord("d"), ord("w"), 13)
    assert env.unwrapped.get_keys_to_action() == {(key,): number for number, key in enumerate(keys)}


def test_keys_of_a_family_are_kept_with_its_tables(tmp_path: Path) -> None:
    generate("burning_forest/paper.toml", tmp_path / "run.sqlite", overrides=["search.generations=1"])
    (tmp_path / "family.json").write_text(write_family(open_family(tmp_path / "run.sqlite")))
    wanted = {(LEFT,): 0, (DOWN,): 1, (RIGHT,): 2, (UP,): 3}
    for _ in range(2):  # the second time everything is in the cache
        assert envgraph.make(tmp_path / "family.json").unwrapped.get_keys_to_action() == wanted


def test_keys_of_a_parameter_over_objects_belong_to_the_first_objects() -> None:
    first = '@key("1", "2") action grab(coin : Coin) = grab(hand, coin, _)'
    engine, behaviour = loaded(f'{first}\n@key("D", "q") action drop(n : 1..2) = drop(hand)')
    keys = KeyIndex.of_model(engine.model, indexed_classes(behaviour, engine.model.metamodel))
    found = action_keys(behaviour, keys, engine.model.metamodel)
    assert found == {"grab(a)": ord("1"), "grab(b)": ord("2"), "drop(1)": ord("d"), "drop(2)": ord("q")}


def test_environment_without_keys_says_how_to_give_them() -> None:
    with pytest.raises(InvalidArgument, match="no action of this environment has a key; write `@key"):
        envgraph.make(domain="jobshop", engine="live").unwrapped.get_keys_to_action()
