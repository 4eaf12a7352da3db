"""Collect the statements of a rule that act on one match, of the rule itself or of one of its blocks."""

from __future__ import annotations

from collections.abc import Sequence

from envgraph import code
from envgraph.env.compiled._blocks import Blocks, Frame, Slots
from envgraph.env.compiled._matching import Matching
from envgraph.env.compiled._statements import Statements
from envgraph.rewrite.plans import RulePlan


class Site(Statements):
    """The statements of a rule, and the match that they act on: first the rule's match, after `enter` one of a block.

    Args:
        matching: emits code that finds matches of blocks, and that reads the model.
        plan: the plan of the rule.
        slots: code for the values of the rule's match, by position in the plan.
        leave: the return statement of the function if the rule is refused.

    Attributes:
        rule: the frame of the rule.
        frame, slots: the frame of the current rule or block, and code for the values of its match.
        row: the variable for the number of the current match among those of its block; None for the rule's match.
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
        """Set the current match, on which later statements act: its frame, the values of its slots, and its row."""
        self.frame, self.slots, self.row = frame, slots, row

    def unless(self, test: code.Expression) -> None:
        """Emit code that refuses the rule unless the test is true."""
        self.fail_if(code.inverse(test), "REFUSED")

    def sure(self, slot: int, cls: str) -> bool:
        own = self.frame.classes.get(slot)
        return own is not None and self.facts.metamodel.is_a(own, cls)
