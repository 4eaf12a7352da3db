"""The widget that plays a level: messages of a view are answered, and its traits say how the level was played."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import gymnasium
import pytest

import envgraph
from envgraph.errors import InvalidArgument
from envgraph.lang import open_workspace
from envgraph.notebook import Player, play
from envgraph.search import Family, generate


class View:
    """A view of a player without a browser."""

    def __init__(self, player: Player, monkeypatch: pytest.MonkeyPatch) -> None:
        self.player = player
        self.sent: list[dict[str, Any]] = []
        monkeypatch.setattr(player, "send", self.sent.append)

    def ask(self, method: str, **params: Any) -> dict[str, Any]:
        """Return the answer to a request."""
        message = {"jsonrpc": "2.0", "id": f"v {len(self.sent)}", "method": method, "params": params}
        self.player._handle_custom_msg(message, [])
        answer = self.sent[-1]
        assert answer["id"] == message["id"]
        return answer


def names(state: dict[str, Any]) -> list[str]:
    return [one["name"] for one in state["actions"]]


@pytest.fixture(scope="module")
def family(tmp_path_factory: pytest.TempPathFactory) -> Family:
    place = tmp_path_factory.mktemp("run") / "run.sqlite"
    return generate("burning_forest/paper.toml", place, generations=0, population=3)


def test_a_view_plays_to_the_end_with_the_best_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    player = play("burning_forest")
    seen: list[int] = []
    player.observe(lambda change: seen.append(change["new"]), "steps")
    view = View(player, monkeypatch)
    state = view.ask("page/play/start", seed=0)["result"]
    assert state["steps"] == 0 and "<svg" in state["picture"]["svg"]
    state = view.ask("page/play/step", action=names(state).index("down"))["result"]
    assert player.actions == ("down",) and player.steps == 1 and player.total == pytest.approx(state["reward"])
    assert view.ask("page/play/undo")["result"]["steps"] == player.steps == 0 and player.actions == ()
    while not player.end:
        state = view.ask("page/play/policy", policy="best")["result"]
    assert player.end == "success" and player.steps == len(player.actions) == 16 >= state["best"]["shortest"] == 14
    assert seen == [1, 0, *range(1, 17)]
    assert view.ask("page/play/step", action=0)["error"]["message"] == "the episode is over"


def test_actions_of_several_agents_have_their_names(monkeypatch: pytest.MonkeyPatch) -> None:
    player = play("warehouse")
    view = View(player, monkeypatch)
    agent = view.ask("page/play/start", seed=0)["result"]["agent"]
    state = view.ask("page/play/policy", policy="random")["result"]
    assert player.actions == (state["chosenName"],) and player.actions[0].startswith(f"{agent}: ")


@pytest.mark.parametrize(
    ("method", "params", "message"),
    [
        ("page/play/step", {"action": 99}, "action 99 is not in 0..5"),
        ("page/save", {}, "there is no method `page/save`"),
    ],
)
def test_wrong_requests_are_answered_by_errors(
    monkeypatch: pytest.MonkeyPatch, method: str, params: dict[str, Any], message: str
) -> None:
    error = View(play("lava"), monkeypatch).ask(method, **params)["error"]
    assert error["message"] == message and "Traceback" not in str(error)


def test_whatever_holds_a_level_can_be_played(family: Family) -> None:
    workspace = open_workspace("burning_forest")
    engine = workspace.engine()
    levels = [
        (family, f"{family.name}, {family.members[-1].name}"),
        (family.members[0], f"{family.name}, E1"),
        (workspace, "target_8x8"),
        (Path("rules/burning_forest"), "target_8x8"),
        (envgraph.make(domain="burning_forest"), "target_8x8"),
        (gymnasium.make("envgraph/BurningForest-v0"), "target_8x8"),
    ]
    for level, title in levels:
        player = play(level)
        assert player.session.title == title and player.steps == 0, title
        assert player.session.limit == 200
    player, before = play(engine, workspace.behaviour()), engine.model.state_hash()
    player.request("page/play/step", action=0)
    assert engine.model.state_hash() == before, "the engine's own model is not played"


def test_a_member_of_a_run_that_was_made_is_played(family: Family, tmp_path: Path) -> None:
    run = tmp_path / "run.sqlite"
    made = generate("burning_forest/paper.toml", run, generations=0, population=3)
    assert play(envgraph.make(str(run), variant="E2")).session.title == f"{made.name}, E2"


@pytest.mark.parametrize(
    ("level", "message"),
    [
        (7, "a int cannot be played"),
        (gymnasium.make("CartPole-v1"), "cannot be played"),
        (envgraph.open("lava"), "an engine has no environment; write `play"),
        ("railway", "the files do not define exactly one environment"),
    ],
)
def test_what_cannot_be_played_is_explained(level: object, message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        play(level)


def test_missing_widgets_are_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "envgraph.notebook._player", None)
    with pytest.raises(InvalidArgument, match=r"needs anywidget; pip install 'envgraph\[notebook\]'"):
        play("lava")


def test_pages_without_a_kernel_show_a_picture() -> None:
    data, _ = play("lava")._repr_mimebundle_()
    assert "application/vnd.jupyter.widget-view+json" in data
    assert data["text/html"].startswith("<svg") and data["text/html"].endswith("vault: run this notebook to play.</p>")
