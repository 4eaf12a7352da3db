"""The command line in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

SECONDS = 60


def run(
    directory: Path,
    *arguments: object,
    python: Sequence[str] = ("-m", "envgraph"),
    before: Callable[[], None] | None = None,
    wrapper: Sequence[str] = (),
) -> subprocess.CompletedProcess[str]:
    """Run a command; it may fail, but says why.

    Args:
        directory: where.
        arguments: of `envgraph`.
        python: what the interpreter is told instead of the module.
        before: called in the new process, for limits.
        wrapper: a command that runs it.
    """
    command = [*wrapper, sys.executable, *python, *map(str, arguments)]
    done = subprocess.run(
        command, cwd=directory, capture_output=True, text=True, errors="replace", timeout=SECONDS,
        check=False, preexec_fn=before,
    )  # fmt: skip
    said = done.stdout + done.stderr
    assert "Traceback" not in said, f"{' '.join(map(str, arguments))}: {said[-1500:]}"
    assert done.returncode <= 0 or done.stderr.strip() or done.stdout.strip(), f"{arguments} says nothing"
    return done


def good(done: subprocess.CompletedProcess[str]) -> str:
    """The output of a command that must succeed."""
    assert done.returncode == 0, f"{' '.join(done.args[1:])}: {done.stderr[-1500:]}"
    return done.stdout
