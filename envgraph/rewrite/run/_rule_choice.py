"""The options of a random choice in one state of a model, cached for drawing several times in this state."""

from __future__ import annotations

from collections.abc import Container, Sequence

from envgraph.rewrite._matches import Row
from envgraph.rewrite.run._rule_runner import Randomness, RuleRunner, draw_index
from envgraph.rewrite.run._unit_programs import UnitProgram
from envgraph.rewrite.run._unit_runtime import draw_weighted


class RuleChoice:
    """The rules with a match in the current state, the units, and the cached matches of drawn rules.

    The cache is valid only in this state, for example again after a rollback.

    Args:
        alternatives: rules and units; units always take part with their weight.
        watched: watched patterns, whose matches are not cached because reading them takes constant time.
    """

    def __init__(self, alternatives: Sequence[RuleRunner | UnitProgram], watched: Container[str]) -> None:
        self._live = [one for one in alternatives if isinstance(one, UnitProgram) or one.exists()]
        self._weights = [one.weight for one in self._live]
        self._watched = watched
        self._rows: dict[str, Sequence[Row]] = {}

    def draw(self, rng: Randomness) -> tuple[str, Row] | None:
        """Draw a rule by weight, then one of its matches uniformly, and return its name and the match.

        Returns:
            For a unit, its name and an empty match; None if there is no unit and no rule with a match.
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
        return chosen.name, rows[draw_index(rng, len(rows))]
