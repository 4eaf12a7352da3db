"""The match that statements are about: what its slots are, and what is written so far."""

from __future__ import annotations

from collections.abc import Sequence

from envgraph import code
from envgraph.env.compiled._blocks import Blocks, Frame, Slots
from envgraph.env.compiled._matching import Matching
from envgraph.env.compiled._statements import Statements
from envgraph.rewrite.plans import RulePlan


class Site(Statements):
    """The statements of a rule, and the match that they are about: of the rule first.

    Args:
        matching: finds matches of blocks, and reads the model.
        plan: of the rule.
        slots: variables for the slots of the match.
        leave: what the function returns where the rule is refused.

    Attributes:
        rule: the frame of the rule.
        frame, slots: the rule or block at hand, and variables for the slots of its match.
        row: the place of that match among those of a block.
    """

    def __init__(
        self, matching: Matching, plan: RulePlan, slots: Sequence[code.Expression], leave: code.Return
    ) -> None:
        super().__init__(leave)
        self.facts = matching.facts
        self.plan = plan
        self.blocks = Blocks(matching, plan, dict(enumerate(slots)), leave)
        self.rule = self.blocks.frames[0]
        self.enter(self.rule, self.rule.slots, None)

    def enter(self, frame: Frame, slots: Slots, row: code.Local | None) -> None:
        """From now on statements are about a match of a frame."""
        self.frame, self.slots, self.row = frame, slots, row

    def unless(self, test: code.Expression) -> None:
        """The rule is refused unless something holds."""
        self.fail_if(code.inverse(test), "REFUSED")

    def sure(self, slot: int, cls: str) -> bool:
        own = self.frame.classes.get(slot)
        return own is not None and self.facts.metamodel.is_a(own, cls)
