"""Cases of campaigns, each in a process of its own with limits on time and memory."""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from random import Random

Campaign = Callable[[Random], "str | tuple[str, Mapping[str, int]]"]
"""One case: what kind it was, for the statistics, and what else it counts; an exception is a failure."""

SECONDS = 120
"""Of a case; five times as many where a machine has more to do. Campaigns have narrower limits for what they call."""
MEGABYTES = 300
"""By which the memory of a case may grow."""


@dataclass
class Outcome:
    """What a campaign has found."""

    kinds: Counter[str] = field(default_factory=Counter)
    counts: Counter[str] = field(default_factory=Counter)
    failures: list[tuple[int, str]] = field(default_factory=list)
    slowest: float = 0.0

    def summary(self) -> str:
        """Figures, in one line, or two if cases count something."""
        kinds = ", ".join(f"{kind} {count}" for kind, count in sorted(self.kinds.items()))
        counts = ", ".join(f"{name} {count:,}" for name, count in self.counts.most_common())
        line = f"{sum(self.kinds.values())} cases ({kinds}), {len(self.failures)} failed, slowest {self.slowest:.1f} s"
        return f"{line}\n  {counts}" if counts else line


def explore(campaign: Campaign, number: int, outcome: Outcome) -> None:
    """Try one case; equal numbers are equal cases."""
    sys.stdout.flush()
    reader, writer = os.pipe()
    started = time.monotonic()
    child = os.fork()
    if child == 0:
        os.close(reader)
        os.setsid()  # what the case starts ends with it
        _try(campaign, number, writer)
    os.close(writer)
    with open(reader, encoding="utf-8", errors="replace") as lines:
        told = lines.read()
    os.waitpid(child, 0)
    outcome.slowest = max(outcome.slowest, time.monotonic() - started)
    word, _, rest = told.partition(" ")
    if word == "ok":
        kind, counts = json.loads(rest)
        outcome.kinds[kind] += 1
        outcome.counts.update(counts)
    else:
        outcome.kinds["failed"] += 1
        outcome.failures.append((number, rest if word == "failed" else "killed: too much memory, or a crash"))


def _try(campaign: Campaign, number: int, writer: int) -> None:
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    size = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()  # noqa: SIM115
    resource.setrlimit(resource.RLIMIT_AS, (size + 8 * MEGABYTES * 2**20,) * 2)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    signal.alarm(5 * SECONDS)
    for each in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(each, _late)
    try:
        result = campaign(Random(f"envgraph {number}"))
        grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory) // 1024
        assert grown < MEGABYTES, f"the memory grew by {grown} MB"
        told = f"ok {json.dumps((result, {}) if isinstance(result, str) else result)}"
    except BaseException as problem:
        place = traceback.extract_tb(problem.__traceback__)[-1]
        told = f"failed {type(problem).__name__}: {problem} ({os.path.basename(place.filename)}:{place.lineno})"
    os.write(writer, told[:60_000].encode(errors="replace"))
    os._exit(0)


def _late(number: int, frame: object) -> None:
    raise TimeoutError(f"more than {SECONDS} s")
