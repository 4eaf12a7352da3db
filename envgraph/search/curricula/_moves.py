"""Changes of a family as a whole: a rule at one match in several members at once, crossover, and exchange."""

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
    around it. Where the rule does not match it is left out. A crossover repeats in one member some of what made another
    one different, at the same objects: all members descend from the target, so an object is the same in all of them.
    The target is never changed. A move is one to three changes or crossovers, or the exchange of two members in the
    order; either all members that it touches are valid, different from all others, and as diverse as demanded, or
    nothing is changed.

    Args:
        levels: of the members.
        demanded: the least diversity of a family, or None.
        crossover: the share of the changes that are crossovers.
        exchange: the share of the moves that exchange two members.
    """

    def __init__(
        self, levels: Levels, demanded: float | None = None, *, crossover: float = 0.0, exchange: float = 0.0
    ) -> None:
        self._levels, self._demanded = levels, demanded
        self._crossover, self._exchange = crossover, exchange

    def draw(self, family: Family, rng: Generator) -> Family | None:
        """Another family, or None if what was drawn is none."""
        drafts = list(family)
        changed: dict[int, Trace] = {}
        if self._exchange and len(family) > 2 and rng.random() < self._exchange:
            one, other = rng.permutation(len(family) - 1)[:2].tolist()
            drafts[one], drafts[other] = drafts[other], drafts[one]
            return tuple(drafts)
        for _ in range(min(3, int(rng.geometric(0.6)))):
            crossing = self._crossover > 0 and rng.random() < self._crossover
            (self._cross if crossing else self._change)(drafts, changed, rng)
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

    def _cross(self, family: Sequence[Level], changed: dict[int, Trace], rng: Generator) -> None:
        """Draw one crossover: adds what of the steps that only another member has can be repeated in a member."""
        levels = self._levels
        place, other = int(rng.integers(len(family) - 1)), int(rng.integers(len(family)))
        mine, theirs = family[place].trace, family[other].trace
        shared = next(
            (at for at, (one, two) in enumerate(zip(mine, theirs, strict=False)) if one != two),
            min(len(mine), len(theirs)),
        )
        steps = theirs[shared:]
        if not steps:
            return
        first, end = sorted(rng.integers(len(steps) + 1, size=2).tolist())
        levels.go_to(family[place].version)
        if not levels.replayed(changed.get(place, ())):
            return
        repeated = tuple(step for step in steps[first:end] if levels.replayed((step,)))
        if repeated:
            changed[place] = changed.get(place, ()) + repeated
