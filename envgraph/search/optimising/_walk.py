"""A walk over models: a move is made, what it leads to is read, and then it is kept or undone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import monotonic
from typing import TYPE_CHECKING, Protocol

from envgraph.errors import RuleError
from envgraph.graph import Savepoint
from envgraph.rewrite import Choice, Engine, Firing, Row
from envgraph.search.optimising._archive import Archive, Found, Path
from envgraph.search.optimising._goals import Standing

if TYPE_CHECKING:
    from numpy.random import Generator

Progress = Callable[[int, str], None]
"""Called with how many moves have been tried, and what is best."""
Tell = Callable[[int, Archive], None]
Move = tuple[str, Row]

_SHORTENED = 1024
"""Moves that are kept after which a version is made, and let go: what led there takes less memory then."""


class Strategy(Protocol):
    """How models are searched: it calls the verbs of a walk until it is `over`."""

    def search(self, walk: Walk) -> None:
        """Search; what is best is kept by the walk."""


class Walk:
    """Where a search stands, what it has spent, and the best that it has met.

    A move that was tried is open until it is kept or undone; nothing else may be done before.

    Args:
        engine: stands at the start.
        moves: names of rules, units and groups.
        appraise: says what the present model is worth.
        rng: of all choices.
        steps: how many moves may be tried.
        seconds: the time limit; None for no limit. With a limit the result depends on the machine.
        target: costs that are good enough: the search ends there.
        tell: is called now and then with how many moves have been tried, and the best states.
        clock: returns seconds since some fixed moment.

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
        steps: int,
        seconds: float | None = None,
        *,
        target: tuple[float, ...] | None = None,
        tell: Tell | None = None,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self.rng, self.steps, self.spent = rng, steps, 0
        self.archive = Archive()
        self._engine, self._moves, self._appraise = engine, tuple(moves), appraise
        self._clock, self._began, self._seconds = clock, clock(), seconds
        self._target, self._tell = target, tell
        self._path: Path = None
        self._kept = 0
        runners, named = (
            engine.catalog.runners,
            (name for move in moves for name in engine.catalog.group(move)),
        )
        self._certain = frozenset(name for name in named if name in runners and runners[name].certain)
        self._choice: Choice | None = None  # of the present state, and what moves from it have led to
        self._tried: dict[Move, Standing | None] = {}
        self._open: tuple[Move, Standing] | None = None
        self._made: tuple[Savepoint, tuple[Firing, ...]] | None = (
            None  # an open move that is not known already
        )
        self._reached = False
        self.here = appraise()
        self.start = Found(self.here, engine.commit(), None)
        self._note()

    def over(self) -> bool:
        """Whether moves, time or the wish for more have run out."""
        return self._reached or self.spent >= self.steps or self.time >= 1.0

    @property
    def time(self) -> float:
        """Return the share of the time limit that has passed, from 0 to 1; 0 without a limit."""
        if self._seconds is None:
            return 0.0
        passed = self._clock() - self._began
        return passed / self._seconds if passed < self._seconds else 1.0

    def attempt(self) -> Standing | None:
        """Make a random move, and say what the state behind it is worth: `keep` it or `undo` it.

        A rule is drawn by weight among those that match, then a match.

        Returns:
            None, and the model as before, if nothing matches or the move is refused.
        """
        self.spent += 1
        if self._tell is not None and not self.spent % 256:
            self._tell(self.spent, self.archive)
        if self._choice is None:
            self._choice, self._tried = self._engine.choice(self._moves, self._engine.watched), {}
        chosen = self._choice.draw(self.rng)
        if chosen is None:
            return None
        if chosen not in self._tried:
            standing = self._try(chosen)
            if chosen[0] in self._certain:
                self._tried[chosen] = standing
            return standing
        standing = self._tried[chosen]
        if standing is not None:
            self._open = chosen, standing
        return standing

    def _try(self, chosen: Move) -> Standing | None:
        """Make a move that is open then; None, and the model as before, if it is refused or does nothing."""
        model = self._engine.model
        savepoint = model.graph.history.savepoint()
        try:
            firings = self._engine.fire(*chosen)
            standing = self._appraise() if firings else None
        except RuleError:
            standing = None
        except BaseException:
            model.graph.history.rollback(savepoint)
            raise
        if standing is None:
            model.graph.history.rollback(savepoint)
            return None
        self._open, self._made = (chosen, standing), (savepoint, firings)
        return standing

    def keep(self) -> None:
        """Stay where the open move leads."""
        assert self._open is not None, "a move is open"
        chosen, self.here = self._open
        if self._made is None:
            firings = self._engine.fire(*chosen)
        else:
            savepoint, firings = self._made
            self._engine.model.graph.history.release(savepoint)
        self._open = self._made = self._choice = None
        self._path = (self._path, firings)
        self._kept += 1
        if not self._kept % _SHORTENED:
            self._engine.commit()
        self._note()

    def undo(self) -> None:
        """Take the open move back."""
        assert self._open is not None, "a move is open"
        if self._made is not None:
            self._engine.model.graph.history.rollback(self._made[0])
        self._open = self._made = None

    def found(self) -> Found:
        """The present state, to come back to."""
        return Found(self.here, self._engine.commit(), self._path)

    def state(self) -> int:
        """A number for the present state; equal states have one number."""
        return self._engine.model.state_hash()

    def go(self, found: Found) -> None:
        """Stand at a state that was found."""
        self._engine.checkout(found.version, discard=True)
        self.here, self._path, self._choice = found.standing, found.path, None

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
