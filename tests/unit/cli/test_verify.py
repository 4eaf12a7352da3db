"""`envgraph verify` of a family whose members have actions about objects that other members have."""

from __future__ import annotations

from pathlib import Path

from envgraph.search import RunStore, format_measure, open_family
from tests.unit.cli.test_commands import Envgraph, envgraph, ok

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
