"""Keys of actions, for people who play. Wrong keys are in `tests/golden/environment-check`."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import envgraph
from envgraph.behaviour import KeyIndex, action_keys, indexed_classes, key_bindings
from envgraph.errors import InvalidArgument
from envgraph.lang import data_path
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


def test_further_keys_begin_again_with_the_first_action_and_keys_of_objects_do_not() -> None:
    first = '@key("1", "2", "3", "4") action grab(coin : Coin) = grab(hand, coin, _)'
    engine, behaviour = loaded(f'{first}\n@key("D", "q", "e") @key("f") action drop(n : 1..2) = drop(hand)')
    keys = KeyIndex.of_model(engine.model, indexed_classes(behaviour, engine.model.metamodel))
    found = action_keys(behaviour, keys, engine.model.metamodel)
    assert found == {"grab(a)": ["1"], "grab(b)": ["2"], "grab(c)": ["3"], "drop(1)": ["D", "e"], "drop(2)": ["q", "f"]}
    assert key_bindings([*found], found) == {"1": 0, "2": 1, "3": 2, "d": 3, "e": 3, "q": 4, "f": 4}


def test_actions_without_keys_get_arrows_digits_and_letters() -> None:
    names = ["Left", "move_right", "moveUp", "go(Way::south)", "push(left)", "upload", "go(left, up)"]
    arrows = {"ArrowLeft": 0, "ArrowRight": 1, "ArrowUp": 2, "ArrowDown": 3}
    assert key_bindings(names) == {**arrows, "1": 4, "2": 5, "3": 6}
    many = key_bindings([str(number) for number in range(100)], {"0": ["1"]})
    assert [*many] == [*"123456789abcdefghijklmopstvwxyz"], "the commands of `envgraph play` keep their letters"


def test_environment_without_written_keys_has_digits() -> None:
    found = envgraph.make(domain="jobshop", engine="live").unwrapped.get_keys_to_action()
    assert found == {(ord("1") + number,): number for number in range(4)}


def test_agents_that_act_together_have_no_keys_for_joint_actions(tmp_path: Path) -> None:
    place = shutil.copytree(data_path("rules") / "warehouse", tmp_path / "warehouse")
    text = (place / "warehouse.environment").read_text().replace("limit 300", "agents together\n    limit 300")
    (place / "warehouse.environment").write_text(text)
    env = envgraph.make(model=place / "small_hall.model", environment=place / "warehouse.environment", engine="live")
    with pytest.raises(InvalidArgument, match="no key stands for an action; use `envgraph play`"):
        env.unwrapped.get_keys_to_action()
