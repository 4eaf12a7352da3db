"""Collect the statements of a rule that act on one match, of the rule itself or of one of its blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from envgraph import code
from envgraph.env.compiled.effects._block_matches import BlockMatches, MatchFrame, Slots
from envgraph.env.compiled.effects._statement_list import StatementList
from envgraph.env.compiled.layout._program_layout import ONE, ZERO
from envgraph.env.compiled.matching._match_emitter import MatchEmitter
from envgraph.rewrite.plans import RulePlan


class MatchStatements(StatementList):
    """The statements of a rule, and the match that they act on: first the rule's match, after `set_match` one of a
    block.

    Args:
        matching: emits code that finds matches of blocks, and that reads the model.
        plan: the plan of the rule.
        slots: code for the values of the rule's match, by position in the plan.
        error_return: the return statement of the function if the rule is refused.

    Attributes:
        rule: the frame of the rule.
        frame, slots: the frame of the current rule or block, and code for the values of its match.
        match_row: the variable for the number of the current match among those of its block; None for the rule's match.
    """

    def __init__(
        self,
        matching: MatchEmitter,
        plan: RulePlan,
        slots: Sequence[code.Expression],
        error_return: code.Return,
    ) -> None:
        super().__init__(error_return)
        self.facts = matching.facts
        self.plan = plan
        self.blocks = BlockMatches(matching, plan, dict(enumerate(slots)), error_return)
        self.rule = self.blocks.frames[0]
        self.set_match(self.rule, self.rule.slots, None)

    def set_match(self, frame: MatchFrame, slots: Slots, row: code.Local | None) -> None:
        """Set the current match, on which later statements act: its frame, the values of its slots, and its row."""
        self.frame, self.slots, self.match_row = frame, slots, row

    def append_refuse_unless(self, test: code.Expression) -> None:
        """Emit code that refuses the rule unless the test is true."""
        self.append_fail_if(code.emit_not(test), "REFUSED")

    def emit_any_deleted(self, test: Callable[[code.Expression, str], code.Expression | None]) -> code.Expression:
        """Emit code that tests the objects that all matches delete. Return an expression that is true if any passes.

        `test` returns the test of an object of a class, or None if no object of the class passes.
        """
        found: list[code.Expression] = []
        for frame in self.blocks.frames:
            row = self.facts.module.new_local("r")
            loads, slots = self.blocks.load_match(frame, row)
            nodes = ((slots[delete.node], frame.plan.classes[delete.node] or "") for delete in frame.plan.deletes)
            tests = [passes for node, cls in nodes if (passes := test(node, cls)) is not None]
            if frame.outer is None:
                found += tests
            elif tests:
                flag = self.facts.module.new_local("f")
                body = (code.If(code.emit_joined("or", tests, False), (code.Assign(flag, ONE),)),)
                self.append(code.Assign(flag, ZERO), *self.blocks.loop_over_matches(frame, row, loads, body))
                found.append(code.emit_equal(flag, ONE))
        return code.emit_joined("or", found, False)

    def has_certain_class(self, slot: int, cls: str) -> bool:
        own = self.frame.classes.get(slot)
        return own is not None and self.facts.metamodel.is_a(own, cls)
