"""The state of an optimisation that strategies work with: try a move, evaluate the new model, keep or undo the move."""

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
"""Callback with the number of tried moves, and a text about the best state."""
Tell = Callable[[int, Archive], None]
Move = tuple[str, Row]

_SHORTENED = 1024
"""Number of kept moves after which a version is committed and dropped, which shortens the undo log."""


class Strategy(Protocol):
    """A search strategy, which calls the methods of a walk until the walk is over."""

    def search(self, walk: Walk) -> None:
        """Run the search. The walk archives the best states."""


class Walk:
    """The current state of a search, its budget, and its archive of the best states.

    After `attempt` a move is open. It must be kept or undone before any other method is called.

    Args:
        engine: the engine, at the initial model.
        moves: names of rules, units and groups.
        appraise: function that evaluates the current model.
        rng: random generator of all choices.
        steps: number of moves that may be tried.
        seconds: the time limit, or None. With a limit the result depends on the machine.
        target: costs at which the search ends, or None.
        tell: callback that is called regularly with the number of tried moves and the archive.
        clock: function that returns seconds since a fixed moment.

    Attributes:
        rng: random generator of all choices.
        steps: number of moves that may be tried.
        spent: number of moves that were tried.
        archive: the best states so far.
        here: evaluation of the current model without the open move.
        start: the initial state.
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
        self._choice: Choice | None = None  # of the current model, with the results of moves from it
        self._tried: dict[Move, Standing | None] = {}
        self._open: tuple[Move, Standing] | None = None
        self._made: tuple[Savepoint, tuple[Firing, ...]] | None = (
            None  # an open move whose result was not cached
        )
        self._reached = False
        self.here = appraise()
        self.start = Found(self.here, engine.commit(), None)
        self._note()

    def over(self) -> bool:
        """Return True if the target is reached, or no moves or no time are left."""
        return self._reached or self.spent >= self.steps or self.time >= 1.0

    @property
    def time(self) -> float:
        """Return the share of the time limit that has passed, from 0 to 1; 0 without a limit."""
        if self._seconds is None:
            return 0.0
        passed = self._clock() - self._began
        return passed / self._seconds if passed < self._seconds else 1.0

    def attempt(self) -> Standing | None:
        """Try a random move, and return the evaluation of the new model. Then `keep` or `undo` must be called.

        A rule is sampled by weight among the rules that match, then a match. If no rule matches, or the move fails or
        applies nothing, the model is unchanged and None is returned. Then no move is open.
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
        """Make a move and leave it open; return the evaluation. If it is refused or changes nothing, return None."""
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
        """Accept the open move: its result becomes the current state. Archive this state if it is not dominated."""
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
        """Undo the open move."""
        assert self._open is not None, "a move is open"
        if self._made is not None:
            self._engine.model.graph.history.rollback(self._made[0])
        self._open = self._made = None

    def found(self) -> Found:
        """Commit the current state and return it."""
        return Found(self.here, self._engine.commit(), self._path)

    def state(self) -> int:
        """Return the hash of the current model. Equal models have equal hashes."""
        return self._engine.model.state_hash()

    def go(self, found: Found) -> None:
        """Check out a state that was found, so that it becomes the current state."""
        self._engine.checkout(found.version, discard=True)
        self.here, self._path, self._choice = found.standing, found.path, None

    def abandon(self) -> None:
        """Undo the open move, if there is one, and check out the initial state."""
        if self._open is not None:
            self.undo()
        self.go(self.start)

    def _note(self) -> None:
        if self.archive.wants(self.here):
            self.archive.put(self.found())
            if self._target is not None and not self.here.violation:
                self._reached = all(a <= b for a, b in zip(self.here.costs, self._target, strict=True))
