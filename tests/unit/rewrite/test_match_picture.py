"""Matches as pictures: their objects, highlighted, and what is near."""

import envgraph


def test_a_match_shows_its_objects_and_their_neighbours():
    engine = envgraph.open("burning_forest")
    match = engine.matches("burningTile")[3]
    made = match.picture(references=["right", "left", "down", "up"])
    assert {node.title: node.highlight_names for node in made.nodes if node.highlight_names is not None} == {
        "forest : Forest": ("forest",),
        f"BurningTile#{match.tile.id}": ("tile",),
    }
    near = {match.tile.right, match.tile.left, match.tile.up, match.tile.down} - {None}
    assert len(made.nodes) == 2 + len(near)
    assert match.to_dot(distance=0).count("penwidth") == 2


def test_a_match_can_be_drawn(monkeypatch):
    monkeypatch.setenv("PATH", "")
    engine = envgraph.open("burning_forest")
    match = engine.first("solvable")
    assert match.to_svg(distance=0).count('stroke-width="3"/>') == 2
    assert engine.model.to_dot(highlight=match).count('penwidth="3"') == 2
