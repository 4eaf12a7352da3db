"""Emit the step of agents that act together: one joint action holds an action of each agent."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain

from envgraph import code
from envgraph.behaviour import Agent, Observation
from envgraph.env._observing import joint_component_names
from envgraph.env._prepared import Types
from envgraph.env._together import in_order, joint_names
from envgraph.env.compiled._clauses import ACTION, Clauses
from envgraph.env.compiled._layout import ONE, ZERO, call
from envgraph.env.compiled._observations import SEEN, Observations
from envgraph.env.compiled._turn import END, NOTHING, TOTAL, Clause, Turn
from envgraph.env.compiled._writer import Writer


class Joint:
    """An emitter of a step in which all agents act; see the docstring of `Simulator`.

    Args:
        clauses: the clauses of the behaviour.
        seats: names of the agents, and the numbers of their blocks.

    Raises:
        EvaluationError: there are too many joint actions.

    Attributes:
        action_names: the names of the joint actions.
        shape, observation_names: sizes and names of the components of an observation: those of each agent, then the
            shared ones.
    """

    def __init__(self, clauses: Clauses, seats: Sequence[tuple[str, int]]) -> None:
        self._clauses, self._seats = clauses, seats
        self.action_names = joint_names([name for name, _ in seats], clauses.moves[0].names)
        blocks = clauses.blocks
        own = [clauses.sizes(self._seen(blocks[number], shared=False)) for _, number in seats]
        self.shape = (*chain(*own), *clauses.sizes(self._seen(blocks[0], shared=True)))
        self.observation_names = joint_component_names(clauses.behaviour, clauses.keys, seats)

    def bodies(self) -> tuple[code.Body, code.Body, code.Body]:
        """Return the bodies of three functions: a step, the test if a joint action is allowed, and the observations."""
        return self._step(), self._may(), self._look()

    def begin(self, writer: Writer) -> None:
        """Do nothing: agents that act together have no first agent."""

    def _step(self) -> code.Body:
        clauses, fresh = self._clauses, self._clauses.module.fresh
        with clauses.module.writing():
            writer, players = clauses.writer(NOTHING), []
            for block, node, digit in self._digits(writer):
                there = self._there(writer, node, block)
                players.append(clauses.player(writer, block, node, digit, fresh("total", "float"), there))
            turn = Turn(writer, players, list(self._in_order()))
            turn.write()
            clauses.check_needed(writer, players[0].scope, turn.did)
            clauses.tidy(writer)
            writer.add(code.Return(code.tuple_of(TOTAL, END, ONE)))
            name = clauses.module.add("turn", (ACTION,), writer.written())
        return (code.Return(call(name, ACTION)),)

    def _may(self) -> code.Body:
        """Return the body of a test that each existing agent can do its part of a joint action, or can do nothing."""
        clauses = self._clauses
        may = [*map(clauses.may, range(len(clauses.blocks)))]
        names = code.Constant(len(clauses.moves[0].names))
        with clauses.module.writing():
            writer = clauses.writer(code.Return(ONE))
            for block, node, digit in self._digits(writer):
                there, other = self._there(writer, node, block), clauses.module.fresh("a")
                idle = [] if there is None else [code.equal(there, ONE)]
                idle.append(code.equal(call(may[block], node, digit), ZERO))
                could = code.If(call(may[block], node, other), (code.Return(ZERO),))
                others = code.For(other, code.call("range", names), (could,))
                writer.add(code.If(code.joined("and", idle, True), (others,)))
            writer.add(code.Return(ONE))
            name = clauses.module.add("may", (ACTION,), writer.written())
        return (code.Return(call(name, ACTION)),)

    def _digits(self, writer: Writer) -> Iterator[tuple[int, code.Local, code.Local]]:
        """Emit assignments of each agent's object and of its own action, decoded from the number of the joint action.

        Yields the number of the agent's block, and the two variables.
        """
        left, names = self._clauses.module.fresh("left"), code.Constant(len(self._clauses.moves[0].names))
        writer.assign(left, ACTION)
        for place, (_, block) in enumerate(self._seats):
            node, digit = self._object(writer, place), self._clauses.module.fresh("a")
            writer.assign(digit, code.Operation("%", (left, names)))
            writer.assign(left, code.call("quotient", left, names))
            yield block, node, digit

    def _object(self, writer: Writer, place: int) -> code.Local:
        """Emit an assignment of the object of the agent at `place` among all agents, and return its variable."""
        node = self._clauses.module.fresh("self", "object")
        writer.assign(node, self._clauses.seat("object", code.Constant(place)))
        return node

    def _there(self, writer: Writer, node: code.Local, block: int) -> code.Local | None:
        """Emit a variable that is 1 if an agent's object exists; return None if it always exists."""
        cls = self._clauses.behaviour.agents[block].cls
        if self._clauses.changes.fixed_class(cls):
            return None
        there = self._clauses.module.fresh("there")
        writer.assign(there, code.Choice(self._clauses.facts.is_instance(node, cls), ONE, ZERO))
        return there

    def _in_order(self) -> Iterator[Clause]:
        effects = [self._clauses.effects(self._clauses.blocks[block]) for _, block in self._seats]
        ours = {id(effect) for effect in self._clauses.behaviour.effects}
        written = [[(effect, id(effect) in ours) for effect, _ in own] for own in effects]
        for number, place in in_order(written):
            effect, types = effects[number][place]
            yield Clause(effect, types, number, written[number][place][1])

    def _look(self) -> code.Body:
        clauses = self._clauses
        with clauses.module.writing():
            writer = clauses.writer(code.Return(ZERO))
            observations = Observations(writer, clauses.keys, self.shape)
            for place, (_, number) in enumerate(self._seats):
                block, node = clauses.blocks[number], self._object(writer, place)
                observations.write(self._seen(block, shared=False), clauses.scope(block, node)[0])
            observations.write(self._seen(clauses.blocks[0], shared=True), clauses.scope(None)[0])
            observations.end()
            name = clauses.module.add("look", (SEEN,), writer.written())
        return (code.Return(call(name, SEEN)),)

    def _seen(self, block: Agent | None, *, shared: bool) -> list[tuple[Observation, Types]]:
        """Return a block's own observation clauses, or if `shared`, the clauses that all blocks share."""
        ours = {id(observation) for observation in self._clauses.behaviour.observations}
        return [each for each in self._clauses.observed(block) if (id(each[0]) in ours) is shared]
