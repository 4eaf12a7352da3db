"""Changes of a family as a whole: a rule at one match in several members at once."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.random import Generator

from envgraph.errors import RuleError
from envgraph.search._store import Trace
from envgraph.search.curricula._levels import Level, Levels

Family = tuple[Level, ...]


class Moves:
    """Draws changes of families.

    A change draws a member and an application of a mutation there, as the genetic algorithm does, and repeats it, at
    the same objects, in an interval of the members: all before that one, all behind it, itself alone, or any interval
    around it. Where the rule does not match it is left out. The target is never changed. A move is one to three
    changes; either all members that it touches are valid, different from all others, and as diverse as demanded, or
    nothing is changed.

    Args:
        levels: of the members.
        demanded: the least diversity of a family, or None.
    """

    def __init__(self, levels: Levels, demanded: float | None = None) -> None:
        self._levels, self._demanded = levels, demanded

    def draw(self, family: Family, rng: Generator) -> Family | None:
        """Another family, or None if what was drawn is none."""
        drafts = list(family)
        changed: dict[int, Trace] = {}
        for _ in range(min(3, int(rng.geometric(0.6)))):
            self._change(drafts, changed, rng)
        for place, trace in changed.items():
            self._levels.go_to(family[place].version)
            if not self._levels.replayed(trace):
                return None
            level = self._levels.here(family[place].trace + trace)
            if level is None:
                return None
            drafts[place] = level
        return tuple(drafts) if self.allowed(drafts) and drafts != [*family] else None

    def allowed(self, family: Sequence[Level]) -> bool:
        """Whether all members are different, and the family is as diverse as demanded."""
        return len({level.state for level in family}) == len(family) and (
            self._demanded is None or self._levels.diversity(family) >= self._demanded
        )

    def _change(self, family: Sequence[Level], changed: dict[int, Trace], rng: Generator) -> None:
        """Draw one change: adds what is to be applied to each of the members."""
        levels, last = self._levels, len(family) - 2
        place = int(rng.integers(last + 1))
        levels.go_to(family[place].version)
        if not levels.replayed(changed.get(place, ())):
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
                levels.go_to(family[other].version)
                if not (levels.replayed(changed.get(other, ())) and levels.replayed(firings)):
                    continue
            changed[other] = changed.get(other, ()) + firings
