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
from envgraph.errors import visible

FIRST_LINE = 5.0
"""Seconds until the first progress line if standard error is no terminal; each further line waits twice as long."""

Show = Callable[[str], None]
Tell = Callable[[str], None]


@dataclass(slots=True)
class _Work:
    """A stack of progress texts, one for each nested piece of work, the outermost first.

    Attributes:
        counted: the texts of the last `counting` block, and how many times in a row it was entered.
    """

    show: Show
    texts: list[str] = field(default_factory=list)
    counted: tuple[list[str], int] = ([], 0)

    def begun(self, what: str) -> int:
        """Note that `counting` begins with a text, and return how many times in a row it began with the same texts."""
        key = [*self.texts, what]
        self.counted = key, self.counted[1] + 1 if key == self.counted[0] else 1
        return self.counted[1]


_under_way: ContextVar[_Work | None] = ContextVar("envgraph_under_way", default=None)


@contextmanager
def telling(show: Show | None = None) -> Iterator[Tell]:
    """Yield a function that shows a progress text; inside another such block the text is appended to the outer texts.

    Args:
        show: receives the whole text, if this is the outermost block. By default a terminal shows one changing line,
            which is cleared at the end. A file or a pipe gets a line after 5 s, 10 s, 20 s and so on.
    """
    work = _under_way.get()
    if work is not None:
        with _inside(work) as tell:
            yield tell
        return
    terminal = sys.stderr is not None and sys.stderr.isatty()
    work = _Work(show or (_write_over if terminal else _Seldom(monotonic())))
    token = _under_way.set(work)
    try:
        with _inside(work) as tell:
            yield tell
    finally:
        _under_way.reset(token)
        if show is None and terminal:
            sys.stderr.write("\r\033[K")
            sys.stderr.flush()


@contextmanager
def counting(what: str) -> Iterator[Callable[[int, int], None]]:
    """Yield a function of a count and a number of outcomes that shows the text `what: count`, and outcomes above 0.

    If the same counter begins again, as for the next model, the text also shows the number of the model.
    """
    work = _under_way.get()
    number = 1 if work is None else work.begun(what)
    what = what if number == 1 else f"{what}, model {number:,}"
    with telling() as tell:
        yield lambda count, outcomes: tell(
            f"{what}: {count:,}" + (f", {outcomes:,} outcomes" if outcomes else "")
        )


@contextmanager
def _inside(work: _Work) -> Iterator[Tell]:
    place = len(work.texts)
    work.texts.append("")

    def tell(text: str) -> None:
        work.texts[place] = visible(text)
        work.show("; ".join(filter(None, work.texts)))

    try:
        yield tell
    finally:
        del work.texts[place:]


def _write_over(text: str) -> None:
    sys.stderr.write(f"\r{text}\033[K")
    sys.stderr.flush()


@dataclass(slots=True)
class _Seldom:
    """A writer of progress lines to standard error: one after 5 s, then one whenever the elapsed time has doubled."""

    begun: float
    due: float = FIRST_LINE

    def __call__(self, text: str) -> None:
        passed = monotonic() - self.begun
        if passed >= self.due and sys.stderr is not None:
            self.due = 2 * passed
            sys.stderr.write(f"{text} ({timedelta(seconds=int(passed))})\n")
            sys.stderr.flush()
