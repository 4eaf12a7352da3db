"""Levels are played: by hand, by policies, back again, with agents, and on members of runs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import envgraph
from envgraph.lang import TextFiles, bundled_domain, bundled_domains, load_workspace
from envgraph.page import Target
from tests.profile import NIGHTLY
from tests.unit.page.browser import Page, Refused

PLAYABLE = [one for one in bundled_domains() if any(bundled_domain(one).glob("*.environment"))]
SUMMARY = "kind,label,runs,success_rate,success_low,success_high,mean_return\ncurriculum,E1-E3,20,0.932,0.8,0.99,9.5\n"
PLAYED = PLAYABLE if NIGHTLY else ["lava", "network", "triage", "warehouse"]


@pytest.mark.parametrize("domain", PLAYED)
def test_steps_are_those_of_the_environment_and_can_be_undone(domain: str) -> None:
    page = Page(domain)
    page.ask("page/open")
    states = [page.ask("page/play/start", seed=3)]
    while len(states) < 8 and not (states[-1]["terminated"] or states[-1]["truncated"]):
        assert any(one["allowed"] for one in states[-1]["actions"])
        states.append(page.ask("page/play/policy", policy="random"))
        state = states[-1]
        assert state["chosenName"] and state["steps"] == len(states) - 1
        assert sum(state["rewards"].values()) == pytest.approx(state["reward"])
        assert state["total"] == pytest.approx(sum(one["reward"] for one in states))
        json.dumps(state, allow_nan=False)
    for state in reversed(states[:-1]):
        assert page.ask("page/play/undo") == state
    assert page.ask("page/play/undo") == states[0]
    assert page.ask("page/play/step", action=states[1]["chosen"]) == states[1]  # the same outcome


def test_a_level_is_solved_by_the_best_policy_and_its_certificate_is_exact() -> None:
    page = Page("keydoor")
    page.ask("page/open")
    page.ask("page/play/start")
    state = page.ask("page/play/policy", policy="best")
    best, values = state["best"], state["values"]
    assert len(values) == len(state["actions"]) and max(values) == best["value"] and best["discount"] == 0.99
    assert page.ask("page/play/policy", policy="best")["chosen"] == values.index(max(values))  # values of the next step
    assert page.ask("page/play/undo") == state
    assert (best["solvable"], best["shortest"], best["limit"]) == (True, 9, 100)
    assert best["text"].startswith("Solvable in 9 steps. A random walk succeeds with probability")
    assert page.ask("page/certificate").items() <= best.items()
    while not state["terminated"]:
        state = page.ask("page/play/policy", policy="best")
    assert (state["steps"], state["end"], state["values"]) == (9, "success", None)
    assert state["reason"] == "on find atExit(hero) reward 1.0 terminate success"
    assert state["total"] == pytest.approx(best["optimal"]) and state["rewards"] == {
        "each step": -0.01,
        "atExit": 1.0,
    }
    assert not any(one["allowed"] for one in state["actions"])
    with pytest.raises(Refused, match="the episode is over"):
        page.ask("page/play/step", action=0)
    with pytest.raises(Refused, match="the episode is over"):
        page.ask("page/play/policy", policy="best")


def test_keys_and_the_limit_are_those_of_the_environment() -> None:
    texts = (one for one in bundled_domain("sokoban").glob("s*.*") if one.suffix != ".toml")
    files = {one.name: one.read_text("utf-8").replace("limit 120 steps", "limit 3 steps") for one in texts}
    page = Page(Target("short", TextFiles(files), "."))
    page.ask("page/open")
    state = page.ask("page/play/start", environment="Sokoban", model="small")
    assert state["title"] == "Sokoban, small"
    assert {one["name"]: one["keys"] for one in state["actions"]}["go(west)"] == ["ArrowLeft"]
    for action in (0, 2, 0):  # west and east again
        state = page.ask("page/play/step", action=action)
    assert (state["truncated"], state["terminated"], state["reason"]) == (True, False, "limit 3 steps")


def test_the_shown_model_is_played_after_rules_were_applied_to_it() -> None:
    page = Page("sokoban")
    page.ask("page/open")
    rule = next(one["name"] for one in page.ask("page/open")["rules"] if one["name"].endswith("build"))
    page.ask("page/apply", rule=rule, index=0)
    shown = page.ask("page/picture")["svg"]
    assert page.ask("page/play/start")["picture"]["svg"] == shown
    assert page.ask("page/play/start", model="small")["picture"]["svg"] != shown


def test_a_level_with_too_many_states_has_sampled_results(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("envgraph.page._certificate.MAX_OUTCOMES", 50)
    page = Page("burning_forest")
    page.ask("page/open")
    found = page.ask("page/certificate", environment="BurningForest", model="running_4x4")
    assert found["solvable"] is None and found["states"] is None and 0.0 <= found["randomWalk"] <= 1.0
    assert "has more than 50 outcomes of actions" in found["text"] and "Of 100 sampled random walks" in found["text"]
    page.ask("page/play/start")
    with pytest.raises(Refused, match="the best policy of this level is not known") as error:
        page.ask("page/play/policy", policy="best")
    assert error.value.data["hint"] == "watch the random policy instead"


def test_agents_act_one_after_the_other_and_together() -> None:
    page = Page("warehouse")
    page.ask("page/open")
    state = page.ask("page/play/start")
    assert state["agent"] == "left" and page.ask("page/play/step", action=4)["agent"] == "right"
    files = {
        one.name: one.read_text("utf-8") for one in bundled_domain("warehouse").glob("*.*") if one.suffix != ".toml"
    }
    name = "warehouse.environment"
    files[name] = files[name].replace("limit 300", "agents together\n    limit 300")
    together = Page(Target("together", TextFiles(files), "."))
    assert together.ask("page/open")["errors"] == 0
    together.ask("page/play/start")
    waiting = together.ask("page/play/step", action=0)
    assert (waiting["steps"], waiting["agent"]) == (0, "right")
    assert together.ask("page/play/step", action=0)["steps"] == 1
    state = together.ask("page/play/policy", policy="random")
    assert state["steps"] == 2 and state["chosenName"].startswith("left: ")


def test_requests_that_make_no_sense_are_refused_with_a_reason() -> None:
    page = Page("sokoban")
    for method in ("step", "undo", "policy"):
        with pytest.raises(Refused, match="nothing is played"):
            page.ask(f"page/play/{method}")
    page.ask("page/open")
    wrong: list[tuple[str, dict[str, Any], str]] = [
        ("start", {"environment": "Sokobann"}, "there is no environment `Sokobann`"),
        ("start", {"model": "big"}, "there is no model `big`"),
        ("start", {"member": "E1"}, "no run is open"),
        ("start", {"seed": "x"}, "`seed` must be a whole number, not 'x'"),
        ("step", {"action": 4}, "action 4 is not in 0..3"),
        ("step", {"action": "west"}, "`action` must be the number of an action, not 'west'"),
        ("policy", {"policy": "clever"}, "there is no policy `clever`"),
    ]
    for method, params, message in wrong:
        if method != "start":
            page.ask("page/play/start")
        with pytest.raises(Refused, match=message):
            page.ask(f"page/play/{method}", **params)
    bare = Page("railway")
    bare.ask("page/open")
    with pytest.raises(Refused, match="the folder has no environment"):
        bare.ask("page/play/start")


def test_a_search_makes_a_run_whose_members_are_shown_and_played(tmp_path: Path) -> None:
    page = Page("keydoor", runs=tmp_path)
    opened = page.ask("page/open")
    assert page.ask("page/run/list") == {"runs": [], "open": None}
    uri = next(one["uri"] for one in opened["files"] if one["name"] == "diverse.toml")
    begun = page.ask("page/search/start", family=uri, seed=1, generations=1)
    search = page.connection.session.search
    assert search is not None and begun["generations"] == 1
    search.join(60)
    (last,) = (one for one in page.notifications("page/search/progress") if one["done"])
    assert last["run"] == begun["run"] and last["members"][0]["svg"].startswith("<svg") and last["bins"]
    for folder in ("training/500", "training/500/stages"):
        (tmp_path / last["run"] / folder).mkdir(parents=True)
        (tmp_path / last["run"] / folder / "summary.csv").write_text(SUMMARY, "utf-8")
    run = page.ask("page/run/open", name=last["run"])
    (table,) = run["training"]
    assert table["title"] == "500 steps on each environment"
    assert table["rows"] == [["E1-E3", "curriculum", "20", "93.2%", "80.0% to 99.0%", "9.5"]]
    names = [one["name"] for one in run["members"]]
    assert names[-1] == run["target"]["name"] and [one["name"] for one in run["lineage"]] == names
    grown = next(one for one in run["lineage"] if one["steps"])
    assert "(" in grown["steps"][0] and run["measures"][0] == {"name": "members", "value": len(names)}
    picture = page.ask("page/select", member=grown["name"])
    assert picture["member"] == grown["name"] and picture["kind"] == "grid"
    state = page.ask("page/play/start", member=grown["name"], seed=1)
    assert state["picture"]["svg"] == picture["svg"] and state["title"].endswith(f", {grown['name']}")
    family = envgraph.search.open_family(tmp_path / last["run"])
    assert page.ask("page/certificate", member=grown["name"])["text"].startswith("Solvable in ")
    assert [one["name"] for one in page.ask("page/open")["members"]] == [one.name for one in family.members]
    assert page.ask("page/select", model="two_rooms")["member"] is None
    (listed,) = page.ask("page/run/list")["runs"]
    assert (listed["name"], listed["members"]) == (last["run"], len(names))
    served = Page(str(tmp_path / last["run"]))
    assert served.ask("page/open")["title"] == last["run"] and served.ask("page/run/open") == run
    assert served.ask("page/matches", pattern=opened["patterns"][0]["name"])["count"] >= 0
    assert served.ask("page/run/list") == {"runs": [listed], "open": last["run"]}
    (tmp_path / "rooms.json").write_text(envgraph.search.write_family(family), "utf-8")
    runs = Page(str(tmp_path / "rooms.json")).ask("page/run/list")
    assert runs["open"] == runs["runs"][0]["name"] == "rooms" and runs["runs"][0]["members"] == len(names)


def test_a_search_is_stopped_and_wrong_ones_are_refused(tmp_path: Path) -> None:
    page = Page("keydoor", runs=tmp_path)
    page.ask("page/open")
    with pytest.raises(Refused, match="no search is running"):
        page.ask("page/search/stop")
    with pytest.raises(Refused, match="is not a family file of this folder"):
        page.ask("page/search/start", family=(tmp_path / "x.toml").as_uri())
    with pytest.raises(Refused, match="no run is open"):
        page.ask("page/run/open")
    for name, message in (("../x", "is not the name of a run"), ("x", "there is no run `x`")):
        with pytest.raises(Refused, match=message):
            page.ask("page/run/open", name=name)
    uri = next(one["uri"] for one in page.ask("page/open")["files"] if one["name"] == "diverse.toml")
    begun = page.ask("page/search/start", family=uri, generations=5000)
    other = Page("keydoor", runs=tmp_path)
    other.ask("page/open")
    assert other.ask("page/search/start", family=uri, generations=5000)["run"] == f"{begun['run']}-2"
    other.connection.close()
    with pytest.raises(Refused, match="another search is running"):
        page.ask("page/search/start", family=uri)
    page.ask("page/search/stop")
    search = page.connection.session.search
    assert search is not None
    search.join(60)
    last = page.notifications("page/search/progress")[-1]
    assert last["stopped"] and not search.is_running and last["run"] in (None, begun["run"])
    stopped = other.connection.session.search
    assert stopped is not None
    stopped.join(60)
    assert all((one / "run.sqlite").exists() for one in tmp_path.iterdir())  # no empty directory is left


def test_a_page_in_memory_has_no_runs() -> None:
    files = {one.name: one.read_text("utf-8") for one in bundled_domain("keydoor").glob("*.*")}
    page = Page(Target("keydoor", TextFiles(files), "."))
    assert page.ask("page/open")["errors"] == 0 and load_workspace(["."], files=TextFiles(files)).models
    assert page.ask("page/run/list") == {"runs": [], "open": None}
    with pytest.raises(Refused, match="a search needs a folder on the disk"):
        page.ask("page/search/start")
    with pytest.raises(Refused, match="there are no runs here"):
        page.ask("page/run/open", name="x")
