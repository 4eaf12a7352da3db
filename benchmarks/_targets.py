"""Targets of the search for families that teach: models that are drawn at random, and a few made by hand.

A model is drawn again until it satisfies the constraints of the domain's family file and its shortest plan has at least
as many steps as `LEAST` says, so that trivial ones are left out. Nothing else chooses among them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from shutil import copytree
from typing import Final, NamedTuple

import numpy as np
from numpy.random import Generator

from envgraph.env.compiled import explore_fast
from envgraph.errors import LoadError
from envgraph.lang import data_path
from envgraph.search import Domain
from envgraph.solve import optimal_episode

LEAST: Final = {"burning_forest": 1, "network": 6, "lava": 15, "keydoor": 12, "sokoban": 12}
"""The least number of steps of a plan for a target."""
MODELS: Final = {
    "burning_forest": "target_8x8",
    "network": "long_way",
    "lava": "vault",
    "keydoor": "two_rooms",
    "sokoban": "small",
}
DRAWS: Final = 200
FIXED: Final = '"startTileFixedLocation", "goalTileFixedLocation", "waterTileFixedLocation", '


class Target(NamedTuple):
    """A model of a bundled domain.

    Attributes:
        name: of the target.
        domain: whose family file is used.
        drawn: makes the text of a model.
        seed: of the random numbers.
    """

    name: str
    domain: str
    drawn: Callable[[Generator], str]
    seed: int


def written(target: Target, folder: Path) -> Path:
    """Write the domain with the target as its model to a folder; return the family file."""
    copied = copytree(data_path("rules", target.domain), folder / target.domain)
    path, name = copied / "family.toml", MODELS[target.domain]
    path.write_text(path.read_text("utf-8").replace(FIXED, ""), "utf-8")
    rng = np.random.default_rng(target.seed)
    for _ in range(DRAWS):
        (copied / f"{name}.model").write_text(target.drawn(rng), "utf-8")
        if plan_length(path) >= LEAST[target.domain]:
            return path
    raise ValueError(f"{target.name}: no valid model in {DRAWS} draws")


def plan_length(path: Path) -> int:
    """Return the steps of a shortest plan of the initial model of a family file, 0 where it is not valid."""
    try:
        domain = Domain.load(str(path))
        domain.check_initial()
    except LoadError:
        return 0
    assert domain.behaviour is not None
    table = explore_fast(domain.engine(), domain.behaviour, domain.keys()).tabular
    return len(optimal_episode(table, domain.behaviour.limit or 200))


def forest(size: int, fire: float, seed: int) -> Target:
    """Return a square forest: a share burns, half of the rest is vegetation, the goal is in the corner opposite."""
    return Target(f"forest {size}x{size} {seed}", "burning_forest", partial(_forest, size, fire), seed)


def _forest(size: int, fire: float, rng: Generator) -> str:
    rest = (1 - fire) / 2
    grid = rng.choice(list("RVB"), p=[rest, rest, fire], size=(size, size))
    grid[0, 0], grid[-1, -1], grid[tuple(rng.integers(1, size - 1, 2))] = "S", "G", "W"
    return f"""import "burning_forest.metamodel"
model target_8x8 : burning_forest {{
    forest : Forest {{
        states = grid tile {{ column x next right row y next down rows \"\"\"
{_rows(grid)}
\"\"\" }}
        agent = truck : FireTruck {{ currentState = tile[0, 0] }}
    }}
}}
"""


def _network(rng: Generator) -> str:
    """Twelve routers in random order: a chain of seven to nine hops, the others beside it, ten links that lead back."""
    names: list[str] = rng.permutation(list("abcdefghijkl")).tolist()
    hops = int(rng.integers(7, 10))
    links = [(place, place + 1) for place in range(hops)]
    for other in range(hops + 1, len(names)):
        here = int(rng.integers(hops))
        links += [(here, other), (other, int(rng.integers(here + 1)))]
    back = [(here, there) for here in range(1, hops) for there in range(here - 1)]
    links += [back[place] for place in rng.permutation(len(back))[:5]]
    routers = "".join(f'{name} : "{name}"; ' for name in sorted(names))
    lines = "".join(f"{names[a]}, {names[b]}; " for a, b in dict.fromkeys(links))
    return f"""import "network.metamodel"
model long_way : network {{
    net : Network {{
        routers = table Router (name) {{ {routers} }}
        links = table Link (from, to) {{ {lines} }}
        packet = parcel : Packet {{ at = {names[0]}, destination = {names[hops]} }}
    }}
}}
"""


def _two_rooms(width: int, height: int, rng: Generator) -> tuple[np.ndarray[tuple[int, int], np.dtype[np.str_]], int]:
    """Return two rooms and the column of the wall between them, which has a door `R`."""
    grid = np.full((height, width), ".")
    grid[[0, -1]] = grid[:, [0, -1]] = "#"
    wall = int(rng.integers(3, width - 3))
    grid[:, wall] = "#"
    grid[int(rng.integers(1, height - 1)), wall] = "R"
    return grid, wall


def _keydoor(rng: Generator) -> str:
    """Nine by seven cells, a fifth of the floor is wall; key and hero are on the left, the exit on the right."""
    grid, wall = _two_rooms(9, 7, rng)
    grid[(grid == ".") & (rng.random(grid.shape) < 0.2)] = "#"
    hero, key = _places(rng, 1, wall, 2)
    (leave,) = _places(rng, wall + 1, 8, 1)
    grid[hero], grid[key], grid[leave] = ".", "r", "X"
    return f"""import "keydoor.metamodel"
model two_rooms : keydoor {{
    maze : Maze {{
        cells = grid cell {{
            legend "#" = Wall, "." = Floor, X = Exit,
                   r = Floor {{ item = Key {{ colour = ::red }} }}, R = Door {{ colour = ::red }}
            column x next east row y next south rows \"\"\"
{_rows(grid)}
\"\"\"
        }}
        hero = hero : Hero {{ at = cell[{hero[1]}, {hero[0]}] }}
    }}
}}
"""


def _lava(rng: Generator) -> str:
    """Eight or nine by five cells; a quarter of the floor on the right is lava; the key is in a box on the left."""
    grid, wall = _two_rooms(int(rng.integers(8, 10)), 5, rng)
    right = np.arange(grid.shape[1]) > wall
    grid[(grid == ".") & right & (rng.random(grid.shape) < 0.25)] = "~"
    hero, box = _places(rng, 1, wall, 2, 5)
    (goal,) = _places(rng, wall + 1, grid.shape[1] - 1, 1, 5)
    grid[goal] = "G"
    return f"""import "lava.metamodel"
model vault : lava {{
    cave : Cave {{
        cells = grid cell {{
            legend "#" = Wall, "." = Floor, "~" = Lava, G = Goal, R = Door {{ colour = ::red }}
            column x next east row y next south rows \"\"\"
{_rows(grid)}
\"\"\"
        }}
        things = [
            key : Key {{ colour = ::red }},
            Box {{ colour = ::yellow, at = cell[{box[1]}, {box[0]}], inside = key }},
        ]
        hero = hero : Hero {{ at = cell[{hero[1]}, {hero[0]}] }}
    }}
}}
"""


def _sokoban(rng: Generator) -> str:
    """A hall of seven by seven with two boxes, two goals and walls on a sixth of the floor."""
    grid = np.full((7, 7), "_")
    grid[(grid == "_") & (rng.random(grid.shape) < 1 / 6)] = "#"
    grid[[0, -1]] = grid[:, [0, -1]] = "#"
    worker, *others = _places(rng, 1, 6, 5)
    grid[worker] = "@"
    for place, letter in zip(others, "$$..", strict=True):
        grid[place] = letter
    return _hall(_rows(grid))


def _hall(rows: str) -> str:
    return f"""import "sokoban.metamodel"
model small : sokoban {{
    hall : Hall {{
        cells = grid cell {{
            legend "#" = Wall, "_" = Floor, "." = Goal,
                   "$" = Floor {{ box = true }}, "*" = Goal {{ box = true }},
                   "@" = Floor {{ worker = Worker {{ }} }}, "+" = Goal {{ worker = Worker {{ }} }}
            column x next east row y next south rows \"\"\"
{rows}
\"\"\"
        }}
    }}
}}
"""


def _places(rng: Generator, first: int, end: int, count: int, height: int = 7) -> list[tuple[int, int]]:
    """Return different cells (row, column) with columns from `first` to before `end`, inside the outer walls."""
    cells = [(row, column) for row in range(1, height - 1) for column in range(first, end)]
    return [cells[place] for place in rng.permutation(len(cells))[:count]]


def _rows(grid: np.ndarray[tuple[int, int], np.dtype[np.str_]]) -> str:
    return "\n".join("".join(row) for row in grid)


def _drawn(domain: str, drawn: Callable[[Generator], str]) -> Callable[[int], Target]:
    return lambda seed: Target(f"{domain} {seed}", domain, drawn, seed)


DRAWN: Final[dict[str, Callable[[int], Target]]] = {
    "network": _drawn("network", _network),
    "lava": _drawn("lava", _lava),
    "keydoor": _drawn("keydoor", _keydoor),
    "sokoban": _drawn("sokoban", _sokoban),
}

KEYDOOR_LARGE: Final = """###########
#...#.....#
#.#.#....##
#...#.#...#
#..rR.....#
#.#.#...#.#
##.##.....#
##..#.#.X##
###########"""

LAVA_ROOM: Final = """##########
#..#..~..#
#..#.~...#
#..R...~.#
#..#.~..G#
##########"""

HALL: Final = """########
#___#__#
#_$_$__#
#@_#_..#
#__#___#
########"""


def known() -> Iterator[Target]:
    """Yield targets for all controls: three random networks, two halls, a room of lava, a large maze."""
    yield from (DRAWN["network"](seed) for seed in (3001, 3002, 3003))
    yield DRAWN["sokoban"](3001)
    yield Target("hall 8x6", "sokoban", partial(_given, _hall(HALL)), 0)
    yield Target("lava room", "lava", partial(_given, _replaced("lava", LAVA_ROOM)), 0)
    yield Target("keydoor 11x9", "keydoor", partial(_given, _replaced("keydoor", KEYDOOR_LARGE)), 0)


def _replaced(domain: str, rows: str) -> str:
    """Return the bundled model of a domain with other rows; in the room of lava hero and box stand elsewhere."""
    text = (data_path("rules", domain) / f"{MODELS[domain]}.model").read_text("utf-8")
    before, _, after = text.split('"""')
    text = f'{before}"""\n{rows}\n"""{after}'
    if domain == "lava":
        text = text.replace("at = cell[1, 3]", "at = cell[2, 4]").replace("at = cell[1, 1]", "at = cell[1, 2]")
    return text


def _given(text: str, rng: Generator) -> str:
    return text
