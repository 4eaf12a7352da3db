"""Long work says on standard error how far it has come: visiting states, generations, agents that learn.

Work inside of work is shown behind it: "environments: 2 of 6, E3; states of Triage: 1,200".
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
"""Seconds until the first line where nobody sits at a terminal; each further one comes after twice the time."""

Show = Callable[[str], None]
Tell = Callable[[str], None]


@dataclass(slots=True)
class _Work:
    """What is under way: a text for each piece of work, the outermost first.

    Attributes:
        counted: what was counted last, with the texts around it, and how often that has begun.
    """

    show: Show
    texts: list[str] = field(default_factory=list)
    counted: tuple[list[str], int] = ([], 0)

    def begun(self, what: str) -> int:
        """How often something is counted, this time included, while the texts around it stay as they are."""
        key = [*self.texts, what]
        self.counted = key, self.counted[1] + 1 if key == self.counted[0] else 1
        return self.counted[1]


_under_way: ContextVar[_Work | None] = ContextVar("envgraph_under_way", default=None)


@contextmanager
def telling(show: Show | None = None) -> Iterator[Tell]:
    """Call what this gives with a text now and then; with none at all, work inside of it is shown as one.

    Args:
        show: shows a text, if this is the outermost work; else a terminal has a line that changes, gone at the end, and
            a file or a pipe has plain lines, one after 5 s, the next ones after 10 s, 20 s and so on.
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
    """`telling` of work that counts something of a model, and the outcomes of that, if there are any.

    What is counted for one model after the other has the number of the model, from the second one on.
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
    """Shows few of the texts, as lines: the times between them grow."""

    begun: float
    due: float = FIRST_LINE

    def __call__(self, text: str) -> None:
        passed = monotonic() - self.begun
        if passed >= self.due and sys.stderr is not None:
            self.due = 2 * passed
            sys.stderr.write(f"{text} ({timedelta(seconds=int(passed))})\n")
            sys.stderr.flush()
