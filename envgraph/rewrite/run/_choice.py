"""What can be done in one state of a model, to draw from as often as the model comes back to that state."""

from __future__ import annotations

from collections.abc import Container, Sequence

from envgraph.rewrite._match import Row
from envgraph.rewrite.run._run import draw_weighted
from envgraph.rewrite.run._runner import Randomness, RuleRunner, draw
from envgraph.rewrite.run._units import UnitProgram


class Choice:
    """The rules that match in the present state, units, and of drawn rules the matches.

    Only in that state it is true: after a rollback, not after a change that is kept.

    Args:
        alternatives: rules and units; units take part with their weight, always.
        watched: patterns whose matches need not be kept here, since asking for them takes constant time.
    """

    def __init__(self, alternatives: Sequence[RuleRunner | UnitProgram], watched: Container[str]) -> None:
        self._live = [one for one in alternatives if isinstance(one, UnitProgram) or one.exists()]
        self._weights = [one.weight for one in self._live]
        self._watched = watched
        self._rows: dict[str, Sequence[Row]] = {}

    def draw(self, rng: Randomness) -> tuple[str, Row] | None:
        """Draw a rule by weight, then one of its matches uniformly: its name and the match.

        Returns:
            For a unit an empty match; None if there is neither a unit nor a rule with a match.
        """
        if not self._live:
            return None
        chosen = self._live[draw_weighted(rng, self._weights)]
        if isinstance(chosen, UnitProgram):
            return chosen.name, ()
        rows = self._rows.get(chosen.name)
        if rows is None:
            rows = chosen.live_rows()
            if chosen.pattern not in self._watched:
                self._rows[chosen.name] = rows
        return chosen.name, rows[draw(rng, len(rows))]
