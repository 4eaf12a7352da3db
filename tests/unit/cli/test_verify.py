"""`envgraph verify` of a family whose members have actions about objects that other members have."""

from __future__ import annotations

import re
from itertools import count
from pathlib import Path

import pytest

import envgraph as package
from envgraph.env import TooManyStates
from envgraph.search import Family, RunStore, format_measure, open_family
from envgraph.search.runs import _certificates_check
from envgraph.solve import _sampling, certify
from tests.unit.cli.test_commands import DOORS, Envgraph, envgraph, ok

__all__ = ["envgraph"]

FILES = {
    "lamps.metamodel": """
metamodel lamps
class Room { contains Lamp[*] lamps }
@key(x) class Lamp { int x
bool on = false }
""",
    "lamps.model": 'import "lamps.metamodel"\nmodel m : lamps { room : Room { lamps = Lamp { x = 0 } } }',
    "lamps.query": 'package lamps\nimport "lamps.metamodel"\npattern dark(lamp : Lamp) { Lamp.on(lamp, false); }',
    "lamps.rules": """
package lamps
import "lamps.query"
rule light(lamp : Lamp) { lhs { find dark(lamp); } modify { set lamp.on = true; } }
rule buy {
    lhs { room : Room; n == count Lamp(_); check n < 3; }
    modify { create room -lamps-> lamp : Lamp { x = n }; }
}
""",
    "lamps.environment": """
import "lamps.rules"
environment Lamps() {
    action light(lamp : Lamp) = light(lamp)
    on neg find dark(_) terminate success
    observe lamp.on for lamp : Lamp
    limit 3 steps
}
""",
    "family.toml": """
model = "lamps.model"
environment = "lamps.environment"
measures.luck = { kind = "random_success" }
diversity = { kind = "variance", of = "luck" }
mutation.rules = ["lamps.buy"]
search = { population = 2, generations = 20 }
""",
}


def test_verify_explains_measures_of_a_random_walk_in_the_model_alone(envgraph: Envgraph) -> None:
    for name, text in FILES.items():
        Path("lamps").mkdir(exist_ok=True)
        Path("lamps", name).write_text(text)
    ok(envgraph("generate", "lamps", "--name", "run"))
    shown = ok(envgraph("verify", "run")).out
    assert shown.splitlines()[-1].startswith(
        "measure `luck` of `E2` differs: its random walk uses only actions of the model"
    )


def test_a_small_measure_is_not_shown_as_zero() -> None:
    assert format_measure((0.0, 2.28e-5, 0.25)) == ("0.000", "2.28e-05", "0.250")


def test_an_infinite_return_is_shown_reported_and_exported(envgraph: Envgraph) -> None:
    """Earlier versions kept the sum of such rewards: as null, since JSON has no infinity."""
    for name, text in FILES.items():
        Path("lamps").mkdir(exist_ok=True)
        Path("lamps", name).write_text(text)
    ok(envgraph("generate", "lamps", "--name", "run"))
    ok(envgraph("verify", "run"))
    with RunStore.open(Path("runs", "run", "run.sqlite"), writing=True) as store:
        kept = {str(number): {**said, "optimal_return": None} for number, said in store.certificates.items()}
        store.set_setting("certificates", kept)
    ok(envgraph("export", "run", "-o", "family.json"))
    for family in ("run", "family.json"):
        assert "not finite" in ok(envgraph("show", family)).out
        ok(envgraph("report", family, "-o", "page.html"))
        assert "not finite" in Path("page.html").read_text(encoding="utf-8")
        ok(envgraph("export", family, "--format", "python", "-o", Path(family).stem + "_package"))
    assert "not finite" in ok(envgraph("verify", "run", "--resume")).out
    known = open_family("family.json").members
    assert known and all(one.certificates["optimal_return"] is None for one in known)


def refuse_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let environments have too many states for a table."""

    def too_many(family: Family, _: object, **__: object) -> None:
        raise TooManyStates(family.behaviour, 3)

    monkeypatch.setattr(Family, "explored", too_many)


def write_lamps(lamps: int) -> None:
    """Write the domain, with several lamps and with a reward for light."""
    several = ", ".join(f"Lamp {{ x = {x} }}" for x in range(lamps))
    changes = {"Lamp { x = 0 }": f"[{several}]", "terminate success": "reward 1.0 terminate success"}
    Path("lamps").mkdir(exist_ok=True)
    for name, text in FILES.items():
        for before, after in changes.items():
            text = text.replace(before, after)
        Path("lamps", name).write_text(text)


@pytest.mark.parametrize("is_compiled", [True, False])
def test_sampled_values_have_intervals_around_the_exact_ones(
    envgraph: Envgraph, monkeypatch: pytest.MonkeyPatch, is_compiled: bool
) -> None:
    write_lamps(2)
    ok(envgraph("generate", "lamps", "--name", "run"))
    family = open_family("runs/run")
    exact, legal = [], []
    for table in (family.explored(one).tabular for one in family.members):
        masks = table.action_masks
        exact.append(certify(table, limit=3))
        legal.append(certify(table, masks / masks.sum(axis=1, keepdims=True), limit=3))
    monkeypatch.setattr(_certificates_check, "has_numba", lambda: is_compiled)
    monkeypatch.setattr(_sampling, "PROGRAM_STEPS", 6_000)
    monkeypatch.setattr(_sampling, "LIVE_STEPS", 3_000)
    episodes = 2_000 if is_compiled else 1_000
    with monkeypatch.context() as patch:
        refuse_tables(patch)
        shown = ok(envgraph("verify", "run")).out
        found = ok(envgraph("verify", "run", "--format", "json")).json
    assert "`E1`, `E2`: environment `Lamps` has more than 3 states; sampled means have 95 % intervals" in shown
    assert shown.count(f" (sampled, {episodes:,} episodes)  ") == shown.count("not computed  same") == 2
    assert shown.count(" (sampled), return ") == 2 * is_compiled
    assert isinstance(found, dict)
    for one, known, masked in zip(found["members"], exact, legal, strict=True):
        values = one["certificates"]
        assert ("sampled_legal_success" in values) == is_compiled
        if is_compiled:
            assert values["sampled_success"] < values["sampled_legal_success"]
            assert values["sampled_legal_success_low"] <= masked.success <= values["sampled_legal_success_high"]
            assert values["sampled_legal_return_low"] <= masked.policy_return <= values["sampled_legal_return_high"]
        assert (values["random_success"], values["optimal_return"], values["sampled_episodes"]) == (
            None,
            None,
            episodes,
        )
        assert values["sampled_success_low"] <= known.random_success <= values["sampled_success_high"]
        assert values["sampled_return_low"] <= known.policy_return <= values["sampled_return_high"]
        assert values["shortest_plan"] == values["plan_found"] == len(one["plan"]["actions"]) == known.shortest_plan
        assert values["plan_return"] == one["plan"]["total_reward"] == 1.0
        assert one["differences"] == [] and one["states"] is None


def test_the_shortest_walk_is_a_plan_if_the_search_finds_none(
    envgraph: Envgraph, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_lamps(2)
    ok(envgraph("generate", "lamps", "--name", "run"))
    monkeypatch.setattr(_certificates_check, "_PLAN_OUTCOMES", 1)
    refuse_tables(monkeypatch)
    found = ok(envgraph("verify", "run", "--format", "json")).json
    assert isinstance(found, dict)
    for one in found["members"]:
        assert (one["certificates"]["shortest_plan"], one["plan"]["exact"]) == (None, False)
        assert one["certificates"]["plan_found"] == one["plan"]["steps"] == len(one["plan"]["actions"]) <= 3
        assert one["certificates"]["plan_return"] == 1.0
    assert "  at most 2  " in ok(envgraph("show", "run")).out


def test_sampled_values_are_kept_apart_from_exact_ones(envgraph: Envgraph, monkeypatch: pytest.MonkeyPatch) -> None:
    write_lamps(2)
    ok(envgraph("generate", "lamps", "--name", "run"))
    monkeypatch.setattr(_sampling, "PROGRAM_STEPS", 600)
    with monkeypatch.context() as patch:
        refuse_tables(patch)
        ok(envgraph("verify", "run"))
    ok(envgraph("export", "run", "-o", "family.json"))
    ok(envgraph("report", "run"))
    texts = ok(envgraph("show", "run")).out, ok(envgraph("show", "family.json")).out
    assert all("sampled, 200 episodes" in text for text in (*texts, Path("runs/run/report.html").read_text("utf-8")))
    _, info = package.make("family.json", variant="E2").reset(seed=0)
    assert info["certificates"]["random_success"] is None and info["certificates"]["sampled_episodes"] == 200.0
    assert info["certificates"] == open_family("runs/run").member("E2").certificates
    resumed = ok(envgraph("verify", "run", "--resume")).out
    assert resumed.count("same (verified earlier)") == 2 and "(sampled, 200 episodes)" in resumed
    assert "sampled" not in ok(envgraph("verify", "run")).out + ok(envgraph("show", "run")).out


def test_of_many_environments_a_sample_is_verified(envgraph: Envgraph) -> None:
    ok(envgraph(*DOORS, "--population", 5))
    shown = ok(envgraph("verify", "run", "--members", 3)).out.splitlines()
    assert [row.split()[0] for row in shown[2:5]] == ["E1", "E3", "E5"]
    assert shown[5:] == [
        "left out: 2 of 5 environments; those above are evenly spaced in their order; `--members 5` verifies all"
    ]
    rest = ok(envgraph("verify", "run", "--resume", "--format", "json")).json
    assert isinstance(rest, dict) and rest["left_out"] == 0
    assert [one["states"] is None for one in rest["members"]] == [True, False, True, False, True]


def test_results_do_not_depend_on_the_number_of_workers(envgraph: Envgraph) -> None:
    ok(envgraph(*DOORS, "--population", 3))
    found = []
    for workers in (1, 2):
        shown = ok(envgraph("verify", "run", "--workers", workers)).out
        with RunStore.open(Path("runs", "run", "run.sqlite"), writing=True) as store:
            found.append((shown, list(store.certificates.items())))
            store.set_setting("certificates", {})
    assert found[0] == found[1] and len(found[0][1]) == 3


def test_progress_counts_sampled_episodes_and_states(envgraph: Envgraph, monkeypatch: pytest.MonkeyPatch) -> None:
    write_lamps(2)
    ok(envgraph("generate", "lamps", "--name", "run"))
    monkeypatch.setattr(_sampling, "PROGRAM_STEPS", 600)
    times = (3.0**tick for tick in count())
    monkeypatch.setattr("envgraph.files._progress.monotonic", lambda: next(times))
    refuse_tables(monkeypatch)
    said = ok(envgraph("verify", "run")).err
    assert re.search(r"^environments: 1 of 2, E1; plan of Lamps: states: \d+ ", said, re.MULTILINE)
    assert re.search(r"^environments: 1 of 2, E1; sampled episodes of Lamps: 200 ", said, re.MULTILINE)
