"""Restore a state of a program in a live engine, to draw it or to reproduce an error message."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numpy.typing import NDArray

from envgraph.env._simulator import Simulator
from envgraph.env.compiled.layout._member_data import MemberData
from envgraph.env.compiled.layout._program_layout import TURN, ProgramLayout
from envgraph.env.compiled.layout._relations import FeatureRows
from envgraph.env.compiled.layout._symbols import (
    WORD_BITS,
    AttributeColumn,
    ClassSet,
    LinkColumn,
    LinkMatrix,
    object_numbers,
)
from envgraph.metamodel import Reference

StateArray = NDArray[Any]


class LiveCounterpart:
    """A live engine of a member that can be put into states of the compiled program.

    Args:
        simulator: a simulator of the member in its initial state.
        member: the member as numbers.
        layout: the layout of the program.
        offsets: where the program's columns begin.
    """

    def __init__(self, simulator: Simulator, member: MemberData, layout: ProgramLayout, offsets: StateArray) -> None:
        self.simulator = simulator
        self._member = member
        self._objects = [*member.object_ids]
        self._columns = [(column, int(offsets[number])) for column, number in layout.columns()]
        for column, _ in self._columns:
            column.fill(member, 0)  # caches the relations of the initial state

    @contextmanager
    def in_state(self, state: StateArray, floats: StateArray) -> Iterator[Simulator]:
        """Put the model into a state for the duration of the `with` block, then roll it back; yield the simulator."""
        model = self.simulator.engine.model
        turn = self.simulator.turn
        savepoint = model.graph.history.savepoint()
        try:
            self._restore(state, floats)
            self.simulator.turn = int(state[TURN])
            yield self.simulator
        finally:
            model.graph.history.rollback(savepoint)
            self.simulator.turn = turn

    def _restore(self, state: StateArray, floats: StateArray) -> None:
        member, model, objects = self._member, self.simulator.engine.model, self._objects
        for column, _ in self._columns:
            if isinstance(column, LinkColumn | LinkMatrix):
                for source, target in member.rows(FeatureRows(column.reference)):
                    node = member.object_ids[int(source)]
                    if isinstance(column.reference, Reference):
                        model.graph.unlink(node, column.reference, member.object_ids[int(target)])
                    else:
                        model.graph.set_value(node, column.reference, ())
        del objects[len(member.object_ids) :]
        self._restore_classes(state)
        for column, start in self._columns:
            if isinstance(column, ClassSet):
                continue
            if isinstance(column, LinkMatrix):
                self._restore_links(column, state[start:])
                continue
            for place, number in enumerate(object_numbers(member, column.classes)):
                value = (floats if column.is_float else state)[start + place]
                if number >= len(objects) or not model.graph.alive(node := objects[number]):
                    continue
                if isinstance(column, AttributeColumn):
                    if not model.metamodel.is_a(model.graph.class_of(node), column.attribute.owner):
                        continue
                    model.graph.set_value(node, column.attribute, member.decode(value, column.attribute.type))
                elif value >= 0:
                    other = objects[int(value)]
                    ends = (node, other) if column.belongs_to_sources else (other, node)
                    model.graph.link(ends[0], column.reference, ends[1])

    def _restore_links(self, matrix: LinkMatrix, cells: StateArray) -> None:
        graph, feature, targets = self.simulator.engine.model.graph, matrix.reference, matrix.targets
        columns = object_numbers(self._member, targets)
        for place, source in enumerate(object_numbers(self._member, matrix.sources)):
            row = cells[place * len(columns) : (place + 1) * len(columns)]
            held = [target for target, count in zip(columns, row, strict=True) for _ in range(count)]
            if isinstance(feature, Reference):
                for target in held:
                    graph.link(self._objects[source], feature, self._objects[target])
            elif held:
                values = [self._member.decode(number, feature.type) for number in held]
                graph.set_value(self._objects[source], feature, values)  # type: ignore[arg-type]

    def _restore_classes(self, state: StateArray) -> None:
        member, model = self._member, self.simulator.engine.model
        found: dict[int, str | None] = {}
        for column, start in self._columns:
            if isinstance(column, ClassSet):
                for place, number in enumerate(object_numbers(member, column.group)):
                    found.setdefault(number, None)
                    if int(state[start + place // WORD_BITS]) >> (place % WORD_BITS) & 1:
                        found[number] = column.cls
        for number, cls in found.items():
            if number in member.reserved_numbers:
                if cls is not None:
                    self._objects.append(model.graph.new(cls))
                continue
            node = member.object_ids[number]
            if cls is None:
                model.graph.delete(node, "spo")
            else:
                model.graph.retype(node, cls)
