"""The state of an optimisation that strategies work with: try a move, evaluate the new model, keep or undo the move."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import monotonic
from typing import TYPE_CHECKING, Protocol

from envgraph.errors import RuleError
from envgraph.graph import Savepoint
from envgraph.rewrite import Engine, Firing, Row, RuleChoice
from envgraph.search.optimising._goals import ConstrainedCosts
from envgraph.search.optimising._pareto_archive import FoundState, MovePath, ParetoArchive

if TYPE_CHECKING:
    from numpy.random import Generator

Progress = Callable[[int, str], None]
"""Callback with the number of tried moves, and a text about the best state."""
ProgressCallback = Callable[[int, ParetoArchive], None]
RuleMatch = tuple[str, Row]

_KEPT_PER_COMMIT = 1024
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
        most_moves: number of moves that may be tried.
        moves_tried: number of moves that were tried.
        archive: the best states so far.
        current_costs: evaluation of the current model without the open move.
        initial_state: the initial state.
    """

    def __init__(
        self,
        engine: Engine,
        moves: Sequence[str],
        appraise: Callable[[], ConstrainedCosts],
        rng: Generator,
        steps: int,
        seconds: float | None = None,
        *,
        target: tuple[float, ...] | None = None,
        tell: ProgressCallback | None = None,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self.rng, self.most_moves, self.moves_tried = rng, steps, 0
        self.archive = ParetoArchive()
        self._engine, self._moves, self._appraise = engine, tuple(moves), appraise
        self._clock, self._began, self._seconds = clock, clock(), seconds
        self._target, self._tell = target, tell
        self._path: MovePath = None
        self._kept = 0
        runners, named = engine.catalog.runners, (name for move in moves for name in engine.catalog.group(move))
        self._deterministic_rules = frozenset(
            name for name in named if name in runners and runners[name].is_deterministic
        )
        self._choice: RuleChoice | None = None  # of the current model, with the results of moves from it
        self._known_results: dict[RuleMatch, ConstrainedCosts | None] = {}
        self._open_move: tuple[RuleMatch, ConstrainedCosts] | None = None
        self._open_savepoint: tuple[Savepoint, tuple[Firing, ...]] | None = (
            None  # an open move whose result was not cached
        )
        self._is_target_reached = False
        self.current_costs = appraise()
        self.initial_state = FoundState(self.current_costs, engine.commit(), None)
        self._archive_current()

    def over(self) -> bool:
        """Return True if the target is reached, or no moves or no time are left."""
        return self._is_target_reached or self.moves_tried >= self.most_moves or self.time_share >= 1.0

    @property
    def time_share(self) -> float:
        """Return the share of the time limit that has passed, from 0 to 1; 0 without a limit."""
        if self._seconds is None:
            return 0.0
        passed = self._clock() - self._began
        return passed / self._seconds if passed < self._seconds else 1.0

    def attempt(self) -> ConstrainedCosts | None:
        """Try a random move, and return the evaluation of the new model. Then `keep` or `undo` must be called.

        A rule is sampled by weight among the rules that match, then a match. If no rule matches, or the move fails or
        applies nothing, the model is unchanged and None is returned. Then no move is open.
        """
        self.moves_tried += 1
        if self._tell is not None and not self.moves_tried % 256:
            self._tell(self.moves_tried, self.archive)
        if self._choice is None:
            self._choice, self._known_results = self._engine.choice(self._moves, self._engine.watched), {}
        chosen = self._choice.draw(self.rng)
        if chosen is None:
            return None
        if chosen not in self._known_results:
            standing = self._try_move(chosen)
            if chosen[0] in self._deterministic_rules:
                self._known_results[chosen] = standing
            return standing
        standing = self._known_results[chosen]
        if standing is not None:
            self._open_move = chosen, standing
        return standing

    def _try_move(self, chosen: RuleMatch) -> ConstrainedCosts | None:
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
        self._open_move, self._open_savepoint = (chosen, standing), (savepoint, firings)
        return standing

    def keep(self) -> None:
        """Accept the open move: its result becomes the current state. Archive this state if it is not dominated."""
        assert self._open_move is not None, "a move is open"
        chosen, self.current_costs = self._open_move
        if self._open_savepoint is None:
            firings = self._engine.fire(*chosen)
        else:
            savepoint, firings = self._open_savepoint
            self._engine.model.graph.history.release(savepoint)
        self._open_move = self._open_savepoint = self._choice = None
        self._path = (self._path, firings)
        self._kept += 1
        if not self._kept % _KEPT_PER_COMMIT:
            self._engine.commit()
        self._archive_current()

    def undo(self) -> None:
        """Undo the open move."""
        assert self._open_move is not None, "a move is open"
        if self._open_savepoint is not None:
            self._engine.model.graph.history.rollback(self._open_savepoint[0])
        self._open_move = self._open_savepoint = None

    def commit_state(self) -> FoundState:
        """Commit the current state and return it."""
        return FoundState(self.current_costs, self._engine.commit(), self._path)

    def current_state_hash(self) -> int:
        """Return the hash of the current model. Equal models have equal hashes."""
        return self._engine.model.state_hash()

    def check_out(self, found: FoundState) -> None:
        """Check out a state that was found, so that it becomes the current state."""
        self._engine.checkout(found.version, discard=True)
        self.current_costs, self._path, self._choice = found.costs, found.path, None

    def restore_initial_state(self) -> None:
        """Undo the open move, if there is one, and check out the initial state."""
        if self._open_move is not None:
            self.undo()
        self.check_out(self.initial_state)

    def _archive_current(self) -> None:
        if self.archive.accepts(self.current_costs):
            self.archive.add_state(self.commit_state())
            if self._target is not None and not self.current_costs.violation:
                self._is_target_reached = all(
                    a <= b for a, b in zip(self.current_costs.costs, self._target, strict=True)
                )
