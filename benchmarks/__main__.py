"""Run every benchmark, or those named on the command line: `python -m benchmarks [match learn ...]`.

Each module `bench_<name>.py` has a `main()` that prints its figures with units and ratios. Machines are noisy:
compare numbers of one run only.
"""

from __future__ import annotations

import platform
import sys
from importlib import import_module
from pathlib import Path


def available() -> list[str]:
    """Names of the benchmarks, sorted."""
    return sorted(path.stem.removeprefix("bench_") for path in Path(__file__).parent.glob("bench_*.py"))


def main(names: list[str]) -> int:
    """Run the named benchmarks, all of them when none is named."""
    known = available()
    unknown = [name for name in names if name not in known]
    if unknown:
        print(f"unknown benchmark: {', '.join(unknown)}; there are: {', '.join(known)}", file=sys.stderr)
        return 1
    print(f"Python {platform.python_version()} on {platform.machine()}")
    for name in names or known:
        print(f"\n== {name}")
        import_module(f"benchmarks.bench_{name}").main()
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
