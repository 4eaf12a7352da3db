"""Emit the step of behaviours whose agents take turns, or that have a single agent without an object."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest

from envgraph import code
from envgraph.env._observing import component_names
from envgraph.env.compiled._clauses import ACTION, SELF, Clauses
from envgraph.env.compiled._layout import NOBODY, ONE, TURN, ZERO, call, cell, plus
from envgraph.env.compiled._observations import SEEN, Observations
from envgraph.env.compiled._turn import ACTED, END, NOTHING, TOTAL, Clause, Turn
from envgraph.env.compiled._writer import Writer


class Turns:
    """An emitter of the functions of a step in which one agent acts.

    Args:
        clauses: the clauses of the behaviour.

    Attributes:
        action_names: the names of the actions.
        shape, observation_names: the sizes and names of the observation's components. With several `agent` blocks, the
            first component is the block number of the agent whose turn it is.
    """

    def __init__(self, clauses: Clauses) -> None:
        self._clauses = clauses
        self.action_names = tuple(clauses.moves[0].names)
        sizes = [clauses.sizes(clauses.observed(block)) for block in clauses.blocks]
        lead = (len(clauses.blocks),) if len(clauses.blocks) > 1 else ()
        self.shape: tuple[int, ...] = (*lead, *(max(each) for each in zip_longest(*sizes, fillvalue=1)))
        self.observation_names = component_names(clauses.behaviour, clauses.keys, len(self.shape))

    def bodies(self) -> tuple[code.Body, code.Body, code.Body]:
        """Return the bodies of three functions: do a step, test if an action would have an effect, and observe."""
        blocks = range(len(self._clauses.blocks))
        return (
            self._dispatched([*map(self._turn, blocks)], (ACTION,), NOTHING),
            self._dispatched([*map(self._clauses.may, blocks)], (ACTION,), code.Return(ZERO)),
            self._dispatched([*map(self._look, blocks)], (SEEN,), code.Return(ZERO)),
        )

    def begin(self, writer: Writer) -> None:
        """Emit code that gives the turn to the first agent whose object exists, or no code if all always exist."""
        agents = self._clauses.behaviour.agents
        if not all(self._clauses.changes.fixed_class(agent.cls) for agent in agents):
            self._advance(writer, code.Operation("-", (self._clauses.seat("count"), ONE)))

    def _dispatched(
        self, functions: Sequence[str], arguments: tuple[code.Local, ...], nothing: code.Return
    ) -> code.Body:
        """Return code that calls the function of the `agent` block of the agent whose turn it is."""
        agents = self._clauses.behaviour.agents
        if not agents:
            return (code.Return(call(functions[0], NOBODY, *arguments)),)
        turn, block = code.Local("turn", "int"), code.Local("block", "int")
        body: list[code.Statement] = [code.Assign(turn, cell(TURN))]
        body.append(code.Assign(SELF, self._clauses.seat("object", turn)))
        if len(agents) == 1:
            return (*body, code.Return(call(functions[0], SELF, *arguments)))
        body.append(code.Assign(block, self._clauses.seat("block", turn)))
        for number, function in enumerate(functions):
            called = code.Return(call(function, SELF, *arguments))
            body.append(code.If(code.equal(block, code.Constant(number)), (called,)))
        return (*body, nothing)

    def _turn(self, block: int) -> str:
        clauses = self._clauses
        with clauses.module.writing():
            writer, own = clauses.writer(NOTHING), clauses.blocks[block]
            player = clauses.player(writer, block, SELF, ACTION, TOTAL)
            turn = Turn(writer, [player], [Clause(*each, 0, False) for each in clauses.effects(own)])
            turn.write()
            clauses.check_needed(writer, player.scope, turn.did)
            if clauses.behaviour.agents:
                self._advance(writer, cell(TURN))
            clauses.tidy(writer)
            writer.add(code.Return(code.tuple_of(TOTAL, END, ACTED)))
            return clauses.module.add("turn", (SELF, ACTION), writer.written())

    def _look(self, block: int) -> str:
        clauses, own = self._clauses, self._clauses.blocks[block]
        with clauses.module.writing():
            writer = clauses.writer(code.Return(ZERO))
            observations = Observations(writer, clauses.keys, self.shape)
            if len(clauses.blocks) > 1:
                observations.see(code.Constant(block))
            observations.write(clauses.observed(own), clauses.scope(own)[0])
            observations.end()
            return clauses.module.add("look", (SELF, SEEN), writer.written())

    def _advance(self, writer: Writer, turn: code.Expression) -> None:
        """Emit code that gives the turn to the next agent whose object exists; without such an agent it stays."""
        count, agents = self._clauses.seat("count"), self._clauses.behaviour.agents
        if all(self._clauses.changes.fixed_class(agent.cls) for agent in agents):
            writer.add(code.Assign(cell(TURN), code.Operation("%", (plus(turn, 1), count))))
            return
        place, node = writer.module.fresh("turn"), writer.module.fresh("v", "object")
        there = [self._clauses.facts.is_instance(node, agent.cls) for agent in agents]
        blocks = [
            code.equal(self._clauses.seat("block", place), code.Constant(block))
            for block in range(len(agents))
        ]
        tests = [code.Operation("and", pair) for pair in zip(blocks, there, strict=True)]
        each = (
            code.Assign(place, code.Operation("%", (plus(place, 1), count))),
            code.Assign(node, self._clauses.seat("object", place)),
            code.If(code.joined("or", tests, False), (code.Assign(cell(TURN), place), code.Leave("break"))),
        )
        writer.assign(place, turn)
        writer.add(code.For(writer.module.fresh("_"), code.call("range", count), each))
