"""Long trials with random mistakes, faults and programs: `make campaign`.

Each campaign runs for its share of the time and prints how many cases it tried. What fails is printed with the number
that makes it again: `python -m tests.campaigns readers --case 17`. Exit code 1 if anything failed.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator

from tests.campaigns import (
    caches,
    disks,
    encodings,
    environments,
    exporters,
    kills,
    programs,
    readers,
    stores,
    writers,
)
from tests.campaigns.cases import Outcome, explore

CAMPAIGNS = {
    "readers": readers,
    "encodings": encodings,
    "programs": programs,
    "environments": environments,
    "exporters": exporters,
    "stores": stores,
    "kills": kills,
    "writers": writers,
    "disks": disks,
    "caches": caches,
}


def main() -> int:
    """Run the campaigns, and say what they found."""
    parser = argparse.ArgumentParser(prog="python -m tests.campaigns", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"some of {', '.join(CAMPAIGNS)}; by default all")
    parser.add_argument("--seconds", type=float, default=60, help="for each of them (60)")
    parser.add_argument("--first", type=int, default=0, help="number of the first case (0)")
    parser.add_argument("--case", type=int, help="only this case")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in CAMPAIGNS]
    if unknown:
        parser.error(f"no campaign {', '.join(unknown)}; there are {', '.join(CAMPAIGNS)}")
    failed = 0
    for name in options.names or CAMPAIGNS:
        started = time.monotonic()
        CAMPAIGNS[name].prepare()
        outcome = Outcome()
        for number in numbers(options.first, options.case, started + options.seconds):
            explore(CAMPAIGNS[name].campaign, number, outcome)
        print(f"{name:10} {time.monotonic() - started:.0f} s, {outcome.summary()}", flush=True)
        kinds: dict[str, list[int]] = {}
        for number, problem in outcome.failures:
            kinds.setdefault(problem, []).append(number)
        for problem, cases in kinds.items():
            print(
                f"  {len(cases)} times: {problem}\n    python -m tests.campaigns {name} --case {cases[0]}",
                flush=True,
            )
        failed += len(outcome.failures)
    return min(failed, 1)


def numbers(first: int, only: int | None, deadline: float) -> Iterator[int]:
    """The cases to try: one, or as many as there is time for."""
    if only is not None:
        yield only
        return
    while time.monotonic() < deadline:
        yield first
        first += 1


if __name__ == "__main__":
    sys.exit(main())
