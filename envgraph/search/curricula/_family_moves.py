"""Moves in the space of families: apply one rule at one match in several members at once."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.random import Generator

from envgraph.errors import RuleError
from envgraph.search._run_store import Trace
from envgraph.search.curricula._model_levels import LevelFactory, ModelLevel

Family = tuple[ModelLevel, ...]


class FamilyMoves:
    """A sampler of neighbours of a family.

    A change samples a member and an application of a mutation there, as the genetic algorithm does. The application is
    repeated, at the same objects, in an interval of members. The interval ends at this member, begins at it, contains
    it alone, or is random around it. Members in which the rule does not match are skipped. The target is never changed.

    A move consists of one to three changes. It succeeds if all changed members are valid, all members are distinct, and
    the family has the demanded diversity.

    Args:
        levels: makes the members.
        demanded: the least diversity of a family, or None.
    """

    def __init__(self, levels: LevelFactory, demanded: float | None = None) -> None:
        self._levels, self._demanded = levels, demanded

    def sample_move(self, family: Family, rng: Generator) -> Family | None:
        """Sample a move, and return the changed family. Return None if the move fails or changes no member."""
        drafts = list(family)
        changed: dict[int, Trace] = {}
        for _ in range(min(3, int(rng.geometric(0.6)))):
            self._sample_change(drafts, changed, rng)
        for place, trace in changed.items():
            self._levels.check_out(family[place].version)
            if not self._levels.try_apply_all(trace):
                return None
            level = self._levels.commit_if_member(family[place].trace + trace)
            if level is None:
                return None
            drafts[place] = level
        return tuple(drafts) if self.is_allowed(drafts) and drafts != [*family] else None

    def is_allowed(self, family: Sequence[ModelLevel]) -> bool:
        """Return True if all members are distinct and the family has the demanded diversity, if one is demanded."""
        return len({level.state for level in family}) == len(family) and (
            self._demanded is None or self._levels.family_diversity(family) >= self._demanded
        )

    def _sample_change(self, family: Sequence[ModelLevel], changed: dict[int, Trace], rng: Generator) -> None:
        """Sample one change, and append its rule applications to `changed`, by the place of each member.

        `changed` stays the same if no rule can be applied.
        """
        levels, last = self._levels, len(family) - 2
        place = int(rng.integers(last + 1))
        levels.check_out(family[place].version)
        if not levels.try_apply_all(changed.get(place, ())):
            return
        levels.engine.rng = rng  # for the choices inside units
        chosen = levels.engine.choose(levels.problem.mutations, rng)
        if chosen is None:
            return
        try:
            firings = levels.engine.fire(*chosen)
        except RuleError:
            return
        kind = rng.random()
        first = 0 if kind < 0.25 else place if kind < 0.85 else int(rng.integers(place + 1))
        end = place if kind < 0.5 else last if kind < 0.75 else place
        if kind >= 0.85:
            end = int(rng.integers(place, last + 1))
        for other in range(first, end + 1):
            if other != place:
                levels.check_out(family[other].version)
                if not (levels.try_apply_all(changed.get(other, ())) and levels.try_apply_all(firings)):
                    continue
            changed[other] = changed.get(other, ()) + firings
