"""Make all pictures of the documentation again: `make pictures`, or `python -m docs.pictures gallery maze` for some."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

HERE = Path(__file__).parent
SHARED = {"__init__", "__main__", "drawing", "models", "tutorial_files"}


def main() -> None:
    """Run the scripts of this folder that are named on the command line, or all of them."""
    for name in sys.argv[1:] or sorted(path.stem for path in HERE.glob("*.py") if path.stem not in SHARED):
        print(f"docs/pictures/{name}.py", flush=True)
        sys.argv = [name]
        runpy.run_path(str(HERE / f"{name}.py"), run_name="__main__")


main()
