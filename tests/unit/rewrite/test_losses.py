"""What a rule or unit may take away."""

from __future__ import annotations

import pytest

import envgraph
from envgraph.errors import InvalidArgument
from tests.unit.env.coins import RULES, loaded

MORE = "\nunit some(coin : Coin) { try { lose(coin); } else { turn(); } }\nunit both(coin : Coin) { some(coin); }\n"


@pytest.fixture(scope="module")
def engine() -> envgraph.Engine:
    return loaded("action turn = turn()", texts={"coins.rules": RULES + MORE})[0]


@pytest.mark.parametrize(
    ("name", "cls", "known", "deeds"),
    [
        ("lose", "Coin", {}, ["delete"]),
        ("lose", "Coin", {"coin": True}, ["delete"]),
        ("lose", "Coin", {"coin": False}, []),
        ("lose", "Hand", {}, []),
        ("lose", None, {}, ["delete"]),
        ("turn", "Coin", {}, []),
        ("both", "Coin", {}, ["delete"]),  # however deep in units
    ],
)
def test_actions_that_may_delete_objects_are_found(
    engine: envgraph.Engine, name: str, cls: str | None, known: dict[str, bool], deeds: list[str]
) -> None:
    found = engine.catalog.losses(name, cls, known)
    assert [loss.action for loss in found] == deeds
    assert all(loss.rule == "coins.lose" and loss.span and loss.span.text == "coin" for loss in found)


def test_an_unknown_name_is_an_error(engine: envgraph.Engine) -> None:
    with pytest.raises(InvalidArgument, match="looose"):
        engine.catalog.losses("looose", None, {})
