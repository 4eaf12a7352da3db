"""What listeners of a view are told."""

from __future__ import annotations

from envgraph.match import Row, ViewMatcher
from tests.unit.match.forest import forest, library


def test_changes_before_a_subscription_are_not_notified() -> None:
    model = forest()
    matcher = ViewMatcher(model, library())
    matcher.watch("burningTile", "fireDensity")
    tile = model.nodes("RoadTile")[0]
    tile.retype("BurningTile")
    told: list[tuple[list[Row], list[Row]]] = []
    matcher.listen("burningTile", lambda appeared, disappeared: told.append((appeared, disappeared)))
    matcher.listeners.deliver()
    assert told == []
    tile.retype("RoadTile")
    matcher.listeners.deliver()
    ((appeared, disappeared),) = told
    assert appeared == []
    assert [row[1] for row in disappeared] == [tile.id]
