"""Emit the program of a behaviour: the functions `begin`, `step_one`, `may_one` and `look` for one environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from envgraph import code
from envgraph.behaviour import Behaviour, KeyIndex, indexed_classes, key_attributes
from envgraph.code import dataclass
from envgraph.env.compiled._changes import Changes, StaticPatterns, plans_of
from envgraph.env.compiled._clauses import ACTION, Clauses
from envgraph.env.compiled._facts import Facts, Module
from envgraph.env.compiled._inlining import inlined
from envgraph.env.compiled._joint import Joint
from envgraph.env.compiled._layout import STATE, ZERO, L, Layout, call
from envgraph.env.compiled._matching import Matching
from envgraph.env.compiled._observations import SEEN
from envgraph.env.compiled._refused import NotCompiled
from envgraph.env.compiled._tables import indexable
from envgraph.env.compiled._tidying import tidied
from envgraph.env.compiled._turn import TOTAL, Clause, Player, Turn
from envgraph.env.compiled._turns import Turns
from envgraph.errors import Span
from envgraph.match.plan import CallGraph, LiveSizes, Planner
from envgraph.metamodel import Attribute
from envgraph.rewrite import Engine
from envgraph.rewrite.plans import Increase, RulePlan, SetValue

ENTRIES: Final = ("begin", "step_one", "may_one", "look", "places")
"""The functions of a program that `kernels` calls."""


@dataclass(frozen=True, slots=True)
class Text:
    """The functions of a program, and the sizes and names that its callers need.

    Attributes:
        functions: callees before their callers.
        layout: the tables and columns.
        levels, width: number of regions of the row buffers, and of columns in a row; see `Module`.
        action_names: the names of the actions, in the order of their numbers.
        shape: the number of values of each component of an observation.
        observation_names: the names of these components.
    """

    functions: tuple[code.Function, ...]
    layout: Layout
    levels: int
    width: int
    action_names: tuple[str, ...]
    shape: tuple[int, ...]
    observation_names: tuple[str, ...]


def written(
    engine: Engine,
    behaviour: Behaviour,
    keys: KeyIndex,
    layout: Layout,
    seats: Sequence[tuple[str, int]] = (),
) -> Text:
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
    return _Program(engine, behaviour, keys, layout, seats).text()


class _Program:
    def __init__(
        self,
        engine: Engine,
        behaviour: Behaviour,
        keys: KeyIndex,
        layout: Layout,
        seats: Sequence[tuple[str, int]],
    ) -> None:
        self._behaviour = behaviour
        self._layout = layout
        self._metamodel = engine.model.metamodel
        library = engine.library
        plans = plans_of(engine, behaviour)
        self._changes = Changes.of(plans, self._metamodel)
        layout.created = self._changes.created
        layout.renumbered = self._changes.recurring
        self._check(plans)
        calls = CallGraph(library)
        static = StaticPatterns(self._changes, library, calls)
        sizes = LiveSizes(library, engine.model.graph.store)
        self._module = Module()
        self._facts = Facts(self._module, layout, self._changes, library, sizes)
        matching = Matching(self._facts, Planner(library, calls, sizes, static), static, calls)
        self._clauses = Clauses(engine, behaviour, keys, matching)
        self._step = Joint(self._clauses, seats) if behaviour.together else Turns(self._clauses)

    def _check(self, plans: Sequence[RulePlan]) -> None:
        """Raise `NotCompiled` if a rule creates objects of an indexed class with keys, or changes key attributes."""
        for cls in indexed_classes(self._behaviour, self._metamodel):
            key = key_attributes(self._metamodel, cls)
            if key and not self._changes.created.isdisjoint(indexable(self._metamodel, cls)):
                span = next(body.span for plan in plans for body in plan.blocks if body.creates)
                raise NotCompiled(f"a rule that creates objects with a key (`{cls}`)", span)
            for attribute in key:
                if attribute.index in self._changes.written:
                    raise NotCompiled(f"a rule that changes a key (`{attribute}`)", _set_at(plans, attribute))

    def text(self) -> Text:
        """Emit all functions of the program, and return them with the sizes and names that callers need."""
        step, may, look = self._step.bodies()
        if self._changes.growing is not None:
            self._define("tidy", (), tidied(self._facts, self._changes.growing))
        self._define("begin", (), self._begin())
        self._define("step_one", (ACTION,), step)
        self._define("may_one", (ACTION,), may)
        self._define("look", (SEEN,), look)
        self._module.functions.append(code.Function("places", (L,), self._layout.places()))
        levels = max(self._module.levels.values())
        functions = inlined(self._module.functions, ENTRIES, self._module.fresh)
        names, seen = self._step.action_names, self._step.observation_names
        return Text(functions, self._layout, levels, self._module.width, names, self._step.shape, seen)

    def _define(self, name: str, parameters: tuple[code.Local, ...], body: code.Body) -> None:
        self._module.functions.append(code.Function(name, (*STATE, *parameters), body))

    def _begin(self) -> code.Body:
        clauses = self._clauses
        with self._module.writing():
            writer, (scope, types, _) = clauses.writer(code.Return(ZERO)), clauses.scope(None)
            nobody = Player(scope, [], [], lambda: (ACTION, []), None, TOTAL)
            for reset in self._behaviour.resets:
                Turn(writer, [nobody], [Clause(reset.effect, types, 0, True)]).write()
            clauses.check_needed(writer, scope, None)
            self._step.begin(writer)
            clauses.tidy(writer)
            writer.add(code.Return(ZERO))
            name = self._module.add("start", (), writer.written())
        return (code.Return(call(name)),)


def _set_at(plans: Sequence[RulePlan], attribute: Attribute) -> Span | None:
    """Return the span of the first rule action that sets an attribute, or else of the first retyping, or else None."""
    bodies = [body for plan in plans for body in plan.blocks]
    sets = [one for body in bodies for one in body.sets if isinstance(one, SetValue | Increase)]
    found = [one.span for one in sets if one.attribute == attribute]
    return next(iter([*found, *(one.span for body in bodies for one in body.retypes)]), None)
