"""Maps of FrozenLake: a domain that is one gives the map that it was made of, others are refused."""

from __future__ import annotations

import json

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.toy_text.frozen_lake import MAPS

from envgraph.env import EnvgraphEnv, ExploredEnvironment, explore, frozen_lake_arguments
from envgraph.errors import InvalidArgument
from envgraph.lang import TextFiles, load_workspace

METAMODEL = """
metamodel lake
class Lake { contains Tile[*] tiles  contains Walker[1] walker }
@key(y, x)
abstract class Tile {
    int x
    int y
    refers Tile[0..1] east opposite west
    refers Tile[0..1] west opposite east
    refers Tile[0..1] south opposite north
    refers Tile[0..1] north opposite south
}
class Ice extends Tile  class Hole extends Tile  class Goal extends Tile  class Start extends Tile
class Walker { refers Tile[1] at  int tired }
"""
QUERY = """
package lake
import "lake.metamodel"
pattern drowned(walker : Walker) { Walker.at(walker, hole); Hole(hole); }
pattern there(walker : Walker) { Walker.at(walker, goal); Goal(goal); }
pattern onStart(walker : Walker) { Walker.at(walker, start); Start(start); }
"""
RULES = """
package lake
import "lake.query"
rule west(walker : Walker) { lhs { walker -at-> here : Tile -west-> next : Tile; } modify { set walker.at = next; } }
rule south(walker : Walker) { lhs { walker -at-> here : Tile -south-> next : Tile; } modify { set walker.at = next; } }
rule east(walker : Walker) { lhs { walker -at-> here : Tile -east-> next : Tile; } modify { set walker.at = next; } }
rule north(walker : Walker) { lhs { walker -at-> here : Tile -north-> next : Tile; } modify { set walker.at = next; } }
rule tire(walker : Walker) { lhs { check walker.tired < 1; } modify { set walker.tired = 1; } }
"""
SURE = """
    action left = west(walker)  action down = south(walker)  action right = east(walker)  action up = north(walker)
"""
SLIPPERY = """
    action left  = 0.1: north(walker) | 0.8: west(walker)  | 0.1: south(walker)
    action down  = 0.1: west(walker)  | 0.8: south(walker) | 0.1: east(walker)
    action right = 0.1: south(walker) | 0.8: east(walker)  | 0.1: north(walker)
    action up    = 0.1: east(walker)  | 0.8: north(walker) | 0.1: west(walker)
"""
ENDS = """
    on find drowned(walker) reward -1.0 terminate failure
    on find there(walker) reward 2.0 terminate success
"""


def lake(actions: str, more: str = "", rows: list[str] | None = None, ends: str = ENDS) -> ExploredEnvironment:
    shown = "\n".join(" " * 12 + row for row in rows or MAPS["4x4"])
    model = f'''
    import "lake.metamodel"
    model lake : lake {{
        lake : Lake {{
            tiles = grid tile {{
                column x next east
                row y next south
                legend S = Start, F = Ice, H = Hole, G = Goal
                rows """
{shown}
            """
            }}
            walker = Walker {{ at = tile[0, 0] }}
        }}
    }}
    '''
    environment = f"""
    import "lake.query"
    import "lake.rules"
    environment Lake(walker : Walker) {{
        {actions} {ends} {more}
        observe walker.at among Tile
        draw grid Tile at (x, y) with walker at walker.at
    }}
    """
    files = {"lake.metamodel": METAMODEL, "lake.query": QUERY, "lake.rules": RULES, "lake.model": model}
    files["lake.environment"] = environment
    workspace = load_workspace(["lake.model", "lake.environment"], files=TextFiles(files))
    return explore(workspace.engine(), workspace.behaviour(), pictures=True)


@pytest.mark.parametrize("name", ["4x4", "8x8"])
def test_exported_lake_has_the_map_and_rewards_of_its_source(name: str) -> None:
    found = frozen_lake_arguments(lake(SURE, rows=MAPS[name], more="each step reward -0.5"), 60)
    assert found == {
        "desc": MAPS[name],
        "is_slippery": False,
        "success_rate": pytest.approx(1.0 / 3.0),
        "reward_schedule": [1.5, -1.5, -0.5],
        "max_episode_steps": 60,
    }


def test_exported_slippery_lake_has_its_success_rate() -> None:
    found = frozen_lake_arguments(lake(SLIPPERY), None)
    assert (found["is_slippery"], found["success_rate"]) == (True, 0.8)
    assert found["desc"] == MAPS["4x4"]


def test_exported_frozen_lake_steps_like_the_environment() -> None:
    explored = lake(SURE)
    arguments = json.loads(json.dumps(frozen_lake_arguments(explored, None)))
    ours, theirs = EnvgraphEnv(explored.tabular), gymnasium.make("FrozenLake-v1", **arguments)
    actions = np.random.default_rng(0)
    for seed in range(30):
        (seen, _), (cell, _) = ours.reset(seed=seed), theirs.reset(seed=seed)
        ended = False
        while not ended:
            assert seen == cell
            action = actions.integers(4)
            (seen, reward, ended, _, _), (cell, gain, over, _, _) = ours.step(action), theirs.step(action)
            assert (reward, ended) == (gain, over)


@pytest.mark.parametrize(
    ("explored", "told"),
    [
        (lambda: lake(SURE + "action wait = nothing()"), "it has 5 actions"),
        (lambda: lake(SURE, more="each step apply 0.5: tire(walker)"), "several of its states have the walker"),
        (lambda: lake(SURE.replace("west", "east", 1)), "`left` at column 0, row 0 leads to column 1, row 0"),
        (lambda: lake(SURE.replace("west(walker)", "west(walker) else reward -1.0", 1)), "`down` at column 0, row 0"),
        (lambda: lake(SURE, more="on find onStart(walker) reward -0.5"), "`down` at column 0, row 0 leads to"),
        (lambda: lake(SLIPPERY.replace("0.8: west", "0.7: west")), "`left` at column"),
        (lambda: ExploredEnvironment(lake(SURE).tabular, ()), "it has no pictures"),
    ],
    ids=["five", "more", "crossed", "bump", "reward", "chance", "undrawn"],
)  # fmt: skip
def test_environments_that_are_no_frozen_lake_are_refused(explored: object, told: str) -> None:
    with pytest.raises(InvalidArgument, match=f"this environment is not a map of FrozenLake: {told}"):
        frozen_lake_arguments(explored(), None)  # type: ignore[operator]
