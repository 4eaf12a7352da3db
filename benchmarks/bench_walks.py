"""Count the functions and modules that run on the way to a match, a view, a rule, a step.

    python -m benchmarks walks

Each walk is a process of its own. Counted are the functions of envgraph that are called, each once, and the modules
that they are in; comprehensions and the like belong to the functions around them.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from inspect import CO_OPTIMIZED
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NamedTuple

PACKAGE = str(Path(__file__).parents[1] / "envgraph")

PATTERN = "pattern beside(a : RoadTile, b : Tile) { Tile.right(a, b); }"
RULE = "rule burn { lhs { a : RoadTile; } modify { retype a : BurningTile; } }"

Walk = Callable[[], object]


def engine() -> Any:
    """An engine on a small map, to which nothing has been added."""
    import envgraph
    from envgraph.lang import bundled_domain, load_workspace

    path = bundled_domain("burning_forest") / "running_4x4.model"
    return envgraph.Engine(load_workspace([path]).model())


def pattern() -> dict[str, Walk]:
    """A pattern from its text to the first count; then the second one."""
    from envgraph.lang import from_text

    made = engine()

    def walk() -> None:
        made.add(*from_text(PATTERN, "query"))
        assert made.count("beside")

    return {"pattern of a line, text to first count": walk, "second count": lambda: made.count("beside")}


def view() -> dict[str, Walk]:
    """The same, watched, with a change of class; then another one."""
    from envgraph.lang import from_text

    made = engine()
    one = made.model.nodes("RoadTile")[0]

    def walk() -> None:
        made.add(*from_text(PATTERN, "query"))
        made.watch("beside")
        one.retype("BurningTile")
        assert made.count("beside")

    return {"watched, one edit, count": walk, "watched edit": lambda: one.retype("RoadTile")}


def rule() -> dict[str, Walk]:
    """A rule from its text to an application in a transaction that is rolled back; then another application."""
    from envgraph.lang import from_text

    made = engine()

    def walk() -> None:
        made.add(*from_text(RULE, "rules"))
        with suppress(KeyError), made.transaction():
            assert made.apply("burn")
            raise KeyError

    return {"rule of a line, text to rollback": walk, "second apply": lambda: made.apply("burn")}


def member() -> dict[str, Walk]:
    """A member of a stored family to its first step in Gymnasium: where its states are visited, and after; a step."""
    from envgraph.search import generate, make

    run = Path(tempfile.mkdtemp()) / "run.sqlite"
    generate("burning_forest/paper.toml", run, generations=2, population=3, seed=1)
    made: list[Any] = []

    def walk() -> None:
        made.append(make(run))
        made[0].reset(seed=0)
        made[0].step(0)

    return {
        "member, its states visited, to its first step": walk,
        "member, its table kept, to its first step": walk,
        "env.step": lambda: made[0].step(0),
    }


WALKS = {one.__name__: one for one in (pattern, view, rule, member)}


class Sizes(NamedTuple):
    """Names of walks."""

    walks: tuple[str, ...]


FULL = Sizes(tuple(WALKS))
QUICK = Sizes(("rule",))


def counted(walk: Walk) -> tuple[int, int]:
    """Functions and modules of the package that a walk comes through."""
    found: set[CodeType] = set()

    def profile(frame: FrameType, event: str, argument: object) -> None:
        code = frame.f_code
        ours = code.co_filename.startswith(PACKAGE) and not code.co_name.startswith("<")
        if event == "call" and ours and code.co_flags & CO_OPTIMIZED:  # unlike the body of a class
            found.add(code)

    sys.setprofile(profile)
    try:
        walk()
    finally:
        sys.setprofile(None)
    return len(found), len({code.co_filename for code in found})


def main(sizes: Sizes) -> None:
    """Print the figures."""
    print(f"{'':48}{'functions':>10}{'modules':>10}")
    for name in sizes.walks:
        command = [sys.executable, "-m", "benchmarks.bench_walks", name]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=Path(PACKAGE).parent)
        for what, (functions, modules) in json.loads(done.stdout.splitlines()[-1]).items():
            print(f"{what:48}{functions:10}{modules:10}")


if __name__ == "__main__":
    print(json.dumps({what: counted(walk) for what, walk in WALKS[sys.argv[1]]().items()}))
