"""The example domains as engines."""

from __future__ import annotations

from pathlib import Path

from envgraph.lang import TextFiles, load_workspace
from envgraph.rewrite import Engine

ROOT = Path(__file__).parents[3]
SAMPLES = ROOT / "tests" / "golden" / "shared"

FILES = {
    "burning_forest": ROOT / "rules" / "burning_forest",
    "keydoor": SAMPLES,
    "network": SAMPLES / "network",
    "warehouse": SAMPLES / "warehouse",
}

TWO_ROOMS = '''
import "keydoor.metamodel"

model two_rooms : keydoor {
    maze : Maze {
        cells = grid cell {
            legend "#" = Wall, "." = Floor, X = Exit,
                   r = Floor { item = Key { colour = ::red } },
                   R = Door { colour = ::red }
            column x next east
            row y next south
            rows """
                #######
                #..#..#
                #.r#.X#
                #..R..#
                #######
                """
        }
        hero = hero : Hero { at = cell[1, 1] }
    }
}
'''


def domain(name: str, model: str) -> Engine:
    """An engine on a model of a domain with all its rules."""
    texts = {}
    for suffix in ("metamodel", "query", "rules"):
        texts[f"{name}.{suffix}"] = (FILES[name] / f"{name}.{suffix}").read_text()
    path = FILES[name] / f"{model}.model"
    texts[f"{model}.model"] = TWO_ROOMS if model == "two_rooms" else path.read_text()
    files = TextFiles(texts)
    return load_workspace([f"{name}.rules", f"{model}.model"], files=files).engine()
