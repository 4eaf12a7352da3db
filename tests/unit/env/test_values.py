"""Observations of values of queries, of ints as numbers, and of patterns for each literal of an enum."""

from __future__ import annotations

import numpy as np
import pytest

from envgraph.env import EnvgraphLiveEnv, FloatRange, ImageView, Simulator, TextView
from envgraph.env._flat_observations import FlatLayout
from tests.unit.env.corners.yard import Yard

QUERY = """
pattern lies(s : Spot, i : Item) { Item.at(i, s); }
pattern load(s : Spot, w : float) { Item.at(i, s); Item.weight(i, w); }
pattern label(s : Spot, n : int) { Item.at(i, s); Item.id(i, n); }
pattern kindAt(s : Spot, kind : Kind) { Item.at(i, s); Item.kind(i, kind); }
"""
RULES = """
rule put(i : Item, s : Spot) { lhs { i : Item; s : Spot; } modify { set i.at = s; } }
@semantics(spo) rule lose(i : Item) { lhs { i : Item; } modify { delete i; } }
@semantics(spo) rule fill { lhs { s : Spot; check s.x == 3; } modify { delete s; } }
"""
ACTIONS = """
action put(i : Item, s : Spot) = put(i, s)
action lose(i : Item) = lose(i)
action fill = fill()
on find lies(_, _) terminate success
"""


def simulator(clauses: str) -> Simulator:
    """Return a simulator of the yard with some `observe` clauses. Items 0 and 1 are at spot 1, item 2 at spot 2."""
    made = Simulator(*Yard(RULES, ACTIONS + clauses, QUERY).opened())
    made.reset(np.random.default_rng(0))
    return made


def observed(made: Simulator) -> list[int | float]:
    """Return the components of the observation, floats as numbers."""
    parts = [component.read() for component in made.current_agent.behaviour.components]
    shape = made.observation_shape
    numbers = (float(FlatLayout([size]).encode(np.array([part]))[0]) for part, size in zip(parts, shape, strict=True))
    return [
        round(number, 4) if isinstance(size, FloatRange) else part
        for part, size, number in zip(parts, shape, numbers, strict=True)
    ]


@pytest.mark.parametrize(
    ("clause", "wanted"),
    [
        ("sum find label(_, #) in 0..9", [3]),
        ("sum find label(_, #) in 1..2", [1]),
        ("sum find load(_, #) in 0.0..9", [3]),
        ("min find label(_, #) in -1..9", [1]),
        ("max find label(s, #) in -1..9 for s : Spot", [0, 2, 3, 0]),
        ("sum find label(s, #) in -1..9 for s : Spot", [1, 2, 3, 1]),
        ("max find label(s, #) in 0.5..9 for s : Spot", [0.5, 1, 2, 0.5]),
        ("avg find label(s, #) in -1.0..9 for s : Spot", [-1, 0.5, 2, -1]),
        ("adam.hunger in 0.0..48.0", [3]),
        ("adam.hunger in 0..2.5", [2.5]),
        ("i.id in 0.0..9.0 for i : Item", [0, 1, 2, 3, 4]),
        ("find kindAt(s, kind) for s : Spot, kind : Kind", [0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 1, 0]),
        ("find kindAt(_, kind) for kind : Kind if find kindAt(_, kind)", [1, 2, 1]),
    ],
)
def test_values_are_those_of_the_query_cut_to_the_range(clause: str, wanted: list[float]) -> None:
    assert observed(simulator(f"observe {clause}")) == wanted


def test_values_of_missing_objects_and_of_no_match_are_the_low_end() -> None:
    made = simulator(
        "observe max find label(s, #) in -1..9 for s : Spot observe sum find load(s, #) in 1.5..9 for s : Spot"
    )
    for action in ("fill", "lose(2)"):
        made.step(made.action_names.index(action), np.random.default_rng(0))
    assert observed(made) == [0, 2, 0, 0, 1.5, 2.75, 1.5, 1.5]


def test_components_are_named_by_aggregate_and_literal() -> None:
    made = simulator("observe sum find load(s, #) in 0.0..9 for s : Spot observe find kindAt(_, kind) for kind : Kind")
    wanted = ["s[0] sum load(s, #)", "s[3] sum load(s, #)", "kindAt(_, ::zebra)", "kindAt(_, ::mole)"]
    assert [made.observation_names[place] for place in (0, 3, 4, 6)] == wanted
    lines = TextView(made.behaviour).observe(made).splitlines()
    assert lines[1] == "s[1] sum load(s, #): 2.75" and lines[4] == "kindAt(_, ::zebra): yes"


def test_images_have_a_channel_for_each_value_and_literal() -> None:
    clauses = """
        observe sum find load(_, #) in 0.0..5.5
        observe sum find load(s, #) in 0.0..5.5 for s : Spot
        observe max find label(s, #) in 0..4 for s : Spot
        observe find kindAt(s, kind) for kind : Kind, s : Spot
        draw grid Spot at (x, n)
    """
    env = EnvgraphLiveEnv(simulator(clauses), observation="image")
    image, _ = env.reset(seed=0)
    assert isinstance(env.view, ImageView)
    assert env.view.channels[-4:] == ("max label(s, #)", *(f"kindAt(s, ::{kind})" for kind in ("zebra", "ant", "mole")))
    total, load, label, *kinds = np.moveaxis(image, -1, 0)[-6:]
    assert (total == 139).all() and load[0, 1] == 128
    assert label[0].tolist()[:2] == [51, 102]
    assert [kind[0, 1] for kind in kinds] == [255, 127, 255]
