"""A walk over models: a move is made, what it leads to is read, and then it is kept or taken back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import monotonic
from typing import Protocol

from numpy.random import Generator

from envgraph.errors import RuleError
from envgraph.graph import Savepoint
from envgraph.rewrite import Engine, Firing
from envgraph.search.optimising._archive import Archive, Found, Path
from envgraph.search.optimising._goals import Standing

Progress = Callable[[int, str], None]
"""Is told how many moves have been tried, and what is best."""
Tell = Callable[[int, Archive], None]


_SHORTENED = 1024
"""Moves that are kept after which a version is made, and let go: what led there takes less memory then."""


class Strategy(Protocol):
    """How models are searched: it calls the verbs of a walk until it is `over`."""

    def search(self, walk: Walk) -> None:
        """Search; what is best is kept by the walk."""


class Walk:
    """Where a search stands, what it has spent, and the best that it has met.

    A move that was tried is open until it is kept or taken back; nothing else may be done before.

    Args:
        engine: stands at the start.
        moves: names of rules, units and groups.
        appraise: says what the present model is worth.
        rng: of all choices.
        steps: how many moves may be tried.
        seconds: for how long; None without end. Then the result depends on the machine.
        target: costs that are good enough: the search ends there.
        tell: is called now and then with how many moves have been tried, and the best states.

    Attributes:
        rng: of all choices.
        steps: how many moves may be tried in all.
        spent: how many have been.
        archive: the best states so far.
        here: what the present state is worth.
        start: the state at which it began.
    """

    def __init__(
        self,
        engine: Engine,
        moves: Sequence[str],
        appraise: Callable[[], Standing],
        rng: Generator,
        *,
        steps: int,
        seconds: float | None = None,
        target: tuple[float, ...] | None = None,
        tell: Tell | None = None,
    ) -> None:
        self.rng, self.steps, self.spent = rng, steps, 0
        self.archive = Archive()
        self._engine, self._moves, self._appraise = engine, tuple(moves), appraise
        self._end = None if seconds is None else monotonic() + seconds
        self._target, self._tell = target, tell
        self._path: Path = None
        self._kept = 0
        self._open: tuple[Savepoint, tuple[Firing, ...], Standing] | None = None
        self._reached = False
        self.here = appraise()
        self.start = Found(self.here, engine.commit(), None)
        self._note()

    def over(self) -> bool:
        """Whether moves, time or the wish for more have run out."""
        return (
            self._reached or self.spent >= self.steps or (self._end is not None and monotonic() >= self._end)
        )

    def attempt(self) -> Standing | None:
        """Make a random move, and say what the state behind it is worth: `keep` it or `undo` it.

        A rule is drawn by weight among those that match, then a match.

        Returns:
            None, and the model as before, if nothing matches or the move is refused.
        """
        engine = self._engine
        self.spent += 1
        if self._tell is not None and not self.spent % 256:
            self._tell(self.spent, self.archive)
        chosen = engine.choose(self._moves, self.rng)
        if chosen is None:
            return None
        savepoint = engine.model.savepoint()
        try:
            firings = engine.fire(*chosen)
            standing = self._appraise() if firings else None
        except RuleError:
            standing = None
        except BaseException:
            engine.model.rollback(savepoint)
            raise
        if standing is None:
            engine.model.rollback(savepoint)
            return None
        self._open = savepoint, firings, standing
        return standing

    def keep(self) -> None:
        """Stay where the open move leads."""
        assert self._open is not None, "a move is open"
        savepoint, firings, self.here = self._open
        self._open = None
        self._engine.model.release(savepoint)
        self._path = (self._path, firings)
        self._kept += 1
        if not self._kept % _SHORTENED:
            self._engine.commit()
        self._note()

    def undo(self) -> None:
        """Take the open move back."""
        assert self._open is not None, "a move is open"
        self._engine.model.rollback(self._open[0])
        self._open = None

    def found(self) -> Found:
        """The present state, to come back to."""
        return Found(self.here, self._engine.commit(), self._path)

    def state(self) -> int:
        """A number for the present state; equal states have one number."""
        return self._engine.model.state_hash()

    def go(self, found: Found) -> None:
        """Stand at a state that was found."""
        self._engine.checkout(found.version, discard=True)
        self.here, self._path = found.standing, found.path

    def abandon(self) -> None:
        """Take the open move back, if there is one, and stand at the start."""
        if self._open is not None:
            self.undo()
        self.go(self.start)

    def _note(self) -> None:
        if self.archive.wants(self.here):
            self.archive.put(self.found())
            if self._target is not None and not self.here.violation:
                self._reached = all(a <= b for a, b in zip(self.here.costs, self._target, strict=True))
