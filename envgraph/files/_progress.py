"""Show the progress of long work on standard error: explored states, generations, training agents.

The progress of nested work is appended: "environments: 2 of 6, E3; states of Triage: 1,200".
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import field
from datetime import timedelta
from time import monotonic

from envgraph.code import dataclass
from envgraph.errors import escape_unprintable

FIRST_LINE_SECONDS = 5.0
"""Seconds until the first progress line if standard error is no terminal; each further line waits twice as long."""

ShowProgress = Callable[[str], None]
ReportProgress = Callable[[str], None]


@dataclass(slots=True)
class _ProgressStack:
    """A stack of progress texts, one for each nested piece of work, the outermost first.

    Attributes:
        last_counted: the texts of the last `report_counting` block, and how many times in a row it was entered.
    """

    show: ShowProgress
    texts: list[str] = field(default_factory=list)
    last_counted: tuple[list[str], int] = ([], 0)

    def count_begin(self, what: str) -> int:
        """Note that `report_counting` begins with a text, and return how many times in a row it began with the same
        texts.
        """
        key = [*self.texts, what]
        self.last_counted = key, self.last_counted[1] + 1 if key == self.last_counted[0] else 1
        return self.last_counted[1]


_current_progress: ContextVar[_ProgressStack | None] = ContextVar("envgraph_under_way", default=None)


@contextmanager
def report_progress(show: ShowProgress | None = None) -> Iterator[ReportProgress]:
    """Yield a function that shows a progress text; inside another such block the text is appended to the outer texts.

    Args:
        show: receives the whole text, if this is the outermost block. By default a terminal shows one changing line,
            which is cleared at the end. A file or a pipe gets a line after 5 s, 10 s, 20 s and so on.
    """
    work = _current_progress.get()
    if work is not None:
        with _nested_progress(work) as tell:
            yield tell
        return
    terminal = sys.stderr is not None and sys.stderr.isatty()
    work = _ProgressStack(show or (_overwrite_line if terminal else _SparseWriter(monotonic())))
    token = _current_progress.set(work)
    try:
        with _nested_progress(work) as tell:
            yield tell
    finally:
        _current_progress.reset(token)
        if show is None and terminal:
            sys.stderr.write("\r\033[K")
            sys.stderr.flush()


@contextmanager
def report_counting(what: str) -> Iterator[Callable[[int, int], None]]:
    """Yield a function of a count and a number of outcomes that shows the text `what: count`, and outcomes above 0.

    If the same counter begins again, as for the next model, the text also shows the number of the model.
    """
    work = _current_progress.get()
    number = 1 if work is None else work.count_begin(what)
    what = what if number == 1 else f"{what}, model {number:,}"
    with report_progress() as tell:
        yield lambda count, outcomes: tell(f"{what}: {count:,}" + (f", {outcomes:,} outcomes" if outcomes else ""))


@contextmanager
def _nested_progress(work: _ProgressStack) -> Iterator[ReportProgress]:
    place = len(work.texts)
    work.texts.append("")

    def tell(text: str) -> None:
        work.texts[place] = escape_unprintable(text)
        work.show("; ".join(filter(None, work.texts)))

    try:
        yield tell
    finally:
        del work.texts[place:]


def _overwrite_line(text: str) -> None:
    sys.stderr.write(f"\r{text}\033[K")
    sys.stderr.flush()


@dataclass(slots=True)
class _SparseWriter:
    """A writer of progress lines to standard error: one after 5 s, then one whenever the elapsed time has doubled."""

    start_time: float
    next_output_seconds: float = FIRST_LINE_SECONDS

    def __call__(self, text: str) -> None:
        passed = monotonic() - self.start_time
        if passed >= self.next_output_seconds and sys.stderr is not None:
            self.next_output_seconds = 2 * passed
            sys.stderr.write(f"{text} ({timedelta(seconds=int(passed))})\n")
            sys.stderr.flush()
