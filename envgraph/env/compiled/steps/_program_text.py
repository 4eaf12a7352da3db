"""Emit the program of a behaviour: the functions `emit_begin`, `step_one`, `may_one` and `look` for one environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from envgraph import code
from envgraph.behaviour import Behaviour, KeyIndex, OnRefused, key_attributes, ranged_classes
from envgraph.code import dataclass
from envgraph.env.compiled.effects._renumbering import emit_tidy_body
from envgraph.env.compiled.layout._model_changes import ModelChanges, StaticPatterns, plans_of
from envgraph.env.compiled.layout._not_compiled import NotCompiled
from envgraph.env.compiled.layout._program_layout import STATE, ZERO, L, ProgramLayout, emit_call
from envgraph.env.compiled.matching._inlining import inline_functions
from envgraph.env.compiled.matching._match_emitter import MatchEmitter
from envgraph.env.compiled.matching._model_reading import ModelReader, ProgramModule
from envgraph.env.compiled.steps._clause_terms import ACTION, ClauseEmitter
from envgraph.env.compiled.steps._joint_actions import JointStepEmitter
from envgraph.env.compiled.steps._move_code import MoveEmitter, RuleSet
from envgraph.env.compiled.steps._observation_code import COMPONENTS
from envgraph.env.compiled.steps._step_code import TOTAL_REWARD, ActingAgent, AgentEffect, StepEmitter
from envgraph.env.compiled.steps._turn_taking import TurnStepEmitter
from envgraph.match.plan import CallGraph, LiveSizes, Planner
from envgraph.rewrite import Engine

ENTRIES: Final = ("begin", "step_one", "may_one", "look", "places")
"""The functions of a program that `kernels` calls."""


@dataclass(frozen=True, slots=True)
class ProgramText:
    """The functions of a program, and the sizes and names that its callers need.

    Attributes:
        functions: callees before their callers.
        layout: the tables and columns.
        levels, width: number of regions of the row buffers, and of columns in a row; see `ProgramModule`.
        action_names: the names of the actions, in the order of their numbers.
        shape: the number of values of each component of an observation.
        observation_names: the names of these components.
    """

    functions: tuple[code.Function, ...]
    layout: ProgramLayout
    levels: int
    width: int
    action_names: tuple[str, ...]
    shape: tuple[int, ...]
    observation_names: tuple[str, ...]


def emit_program(
    engine: Engine,
    behaviour: Behaviour,
    keys: KeyIndex,
    layout: ProgramLayout,
    seats: Sequence[tuple[str, int]] = (),
) -> ProgramText:
    """Return the functions of a behaviour's program, and the sizes and names that callers need.

    Args:
        engine: of the domain. It has the patterns and rules, and plans depend on the sizes of its model.
        behaviour: resolved, without errors.
        keys: the index of each object over the family.
        layout: the tables and columns that the program needs are added to it.
        seats: the name and block number of each agent that acts together with the others.

    Raises:
        NotCompiled: the behaviour has a construct that is not compiled.
        EvaluationError: agents that act together have too many joint actions.
    """
    return _ProgramWriter(engine, behaviour, keys, layout, seats).emit()


class _ProgramWriter:
    def __init__(
        self,
        engine: Engine,
        behaviour: Behaviour,
        keys: KeyIndex,
        layout: ProgramLayout,
        seats: Sequence[tuple[str, int]],
    ) -> None:
        self._behaviour = behaviour
        self._layout = layout
        self._metamodel = engine.model.metamodel
        library = engine.library
        plans = plans_of(engine, behaviour)
        self._changes = ModelChanges.from_plans(plans, library)
        layout.created_classes = self._changes.created
        layout.reuses_numbers = self._changes.reuses_numbers
        self._check_keys()
        calls = CallGraph(library)
        static = StaticPatterns(self._changes, library, calls)
        sizes = LiveSizes(library, engine.model.graph.store)
        self._module = ProgramModule()
        self._facts = ModelReader(self._module, layout, self._changes, library, sizes)
        matching = MatchEmitter(self._facts, Planner(library, calls, sizes, static), static, calls)
        self._clauses = ClauseEmitter(engine, behaviour, keys, matching)
        self._step: JointStepEmitter | MoveEmitter | TurnStepEmitter
        if isinstance(behaviour, RuleSet):
            self._step = MoveEmitter(self._clauses, behaviour)
        elif behaviour.together:
            self._step = JointStepEmitter(self._clauses, seats)
        else:
            self._step = TurnStepEmitter(self._clauses)

    def _check_keys(self) -> None:
        """Raise `NotCompiled` if a rule changes the key of an object that may have an index."""
        for cls in ranged_classes(self._behaviour, self._metamodel):
            for attribute in key_attributes(self._metamodel, cls):
                for each in self._changes.possible_classes(cls):
                    if (attribute.index, each) in self._changes.set_attributes:
                        span = self._changes.set_attributes[attribute.index, each]
                        raise NotCompiled(f"a rule that changes a key (`{attribute}`)", span)

    def emit(self) -> ProgramText:
        """Emit all functions of the program, and return them with the sizes and names that callers need."""
        step, may, look = self._step.emit_bodies()
        if self._changes.created_group is not None:
            self._add_function("tidy", (), emit_tidy_body(self._facts, self._changes.created_group))
        self._add_function("begin", (), self._emit_begin())
        self._add_function("step_one", (ACTION,), step)
        self._add_function("may_one", (ACTION,), may)
        self._add_function("look", (COMPONENTS,), look)
        self._module.functions.append(code.Function("places", (L,), self._layout.emit_offsets()))
        levels = max(self._module.levels.values())
        functions = inline_functions(self._module.functions, ENTRIES, self._module.new_local)
        names, seen = self._step.action_names, self._step.observation_names
        return ProgramText(functions, self._layout, levels, self._module.width, names, self._step.shape, seen)

    def _add_function(self, name: str, parameters: tuple[code.Local, ...], body: code.Body) -> None:
        self._module.functions.append(code.Function(name, (*STATE, *parameters), body))

    def _emit_begin(self) -> code.Body:
        clauses = self._clauses
        with self._module.emitting_function():
            writer, (scope, types, _) = clauses.new_writer(code.Return(ZERO)), clauses.scope(None)
            nobody = ActingAgent(scope, [], [], lambda: (ACTION, []), None, TOTAL_REWARD)
            handled = any(isinstance(effect, OnRefused) for effect in self._behaviour.effects)
            for reset in self._behaviour.resets:
                effects = [reset.as_effect, *([OnRefused()] if handled else [])]
                StepEmitter(writer, [nobody], [AgentEffect(one, types, 0, True) for one in effects]).emit_step()
            clauses.emit_check_needed(writer, scope, None)
            self._step.emit_begin(writer)
            clauses.emit_tidy(writer)
            writer.append(code.Return(ZERO))
            name = self._module.add_function("start", (), writer.all_statements())
        return (code.Return(emit_call(name)),)
