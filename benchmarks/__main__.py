"""Run every benchmark, or those that are named: `python -m benchmarks [--quick] [NAME ...]`.

Each module `bench_<name>.py` has a `main(sizes)` that prints its figures with units and ratios, the sizes `FULL` and
`QUICK` for it, and perhaps `PEERS`: modules that it compares with where they are installed. Machines are noisy: compare
numbers of one run only.
"""

from __future__ import annotations

import ast
import platform
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from traceback import print_exc

from benchmarks._peers import left_out


def available() -> dict[str, str]:
    """Return the names of the benchmarks, sorted, each with the first line of its docstring."""
    found = {}
    for path in sorted(Path(__file__).parent.glob("bench_*.py")):
        text = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
        found[path.stem.removeprefix("bench_")] = text.partition("\n")[0]
    return found


def no_such(name: str, known: Iterable[str]) -> str:
    """Return a sentence about an unknown name, with the known name that is most like it."""
    close = get_close_matches(name, known, 1)
    return f"there is no benchmark `{name}`" + (f"; did you mean `{close[0]}`?" if close else "")


def run(name: str, quick: bool) -> str | None:
    """Run a benchmark; return its error, or None if it succeeds."""
    try:
        benchmark = import_module(f"benchmarks.bench_{name}")
        missing = left_out(getattr(benchmark, "PEERS", ()))
        if missing:
            print(missing)
        benchmark.main(benchmark.QUICK if quick else benchmark.FULL)
    except (Exception, SystemExit) as error:
        print_exc()
        return f"{type(error).__name__}: {error}"
    return None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the named benchmarks, all of them when none is named; return 1 if one fails."""
    known = available()
    listed = "\n".join(f"  {name:14}{line}" for name, line in known.items())
    parser = ArgumentParser(
        "python -m benchmarks",
        description="Run the named benchmarks, or all of them.",
        epilog=f"benchmarks:\n{listed}",
        formatter_class=RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="a benchmark of the list below")
    parser.add_argument(
        "--quick", action="store_true", help="use tiny sizes, to see that it runs: the figures mean nothing"
    )
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in known]
    if unknown:
        parser.exit(2, "".join(f"{no_such(name, known)}\n" for name in unknown) + f"{parser.epilog}\n")
    tiny = ", tiny sizes: the figures mean nothing" if options.quick else ""
    print(f"Python {platform.python_version()} on {platform.machine()}{tiny}")
    failed: dict[str, str] = {}
    for name in options.names or known:
        print(f"\n== {name}", flush=True)
        error = run(name, options.quick)
        if error is not None:
            failed[name] = error
    for name, error in failed.items():
        print(f"\n{name} failed: {error}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
