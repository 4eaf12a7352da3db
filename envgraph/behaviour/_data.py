"""An agent's behaviour over a model, as frozen data; what a `.environment` file says.

What a step is, exactly, says the docstring of `Simulator`.
"""

from __future__ import annotations

from dataclasses import field
from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Annotation
from envgraph.pattern import Expression, Negation, Parameter, PatternCall


@dataclass(frozen=True, slots=True)
class RuleCall:
    """`rule(arguments)`; rule None is `nothing()`."""

    rule: str | None
    arguments: tuple[Expression, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    rule_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Branch:
    """One outcome of a stochastic choice; what the probabilities lack to 1 does nothing.

    Attributes:
        probability: a number from 0 to 1, or what computes it in the state in which the choice is made; 0 where that
            has no value because an object is gone.
    """

    probability: float | Expression
    call: RuleCall
    span: Span | None = field(default=None, compare=False, repr=False)
    probability_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Domain:
    """What an action parameter counts through: `cls` (by index), `enum` (in order), or the ints low..high."""

    cls: str | None = None
    enum: str | None = None
    low: int = 0
    high: int = 0
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Action:
    """`action name(parameter : domain) = branches reward e else reward e`."""

    name: str
    branches: tuple[Branch, ...]
    parameters: tuple[tuple[str, Domain], ...] = ()
    reward: Expression | None = None
    else_reward: Expression | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    parameter_spans: tuple[Span, ...] = field(default=(), compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class EachStep:
    """`each step reward e apply branches`, either part may be missing."""

    reward: Expression | None = None
    apply: tuple[Branch, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)


End = Literal["success", "failure", "truncation"]


@dataclass(frozen=True, slots=True)
class OnFind:
    """`on find p(..) reward e terminate success|failure apply branches`; the condition may be negated.

    Attributes:
        end: how the episode ends where the condition holds; "truncation" is written `truncate`.
        weight: of `apply r(x) weight e`: of all matches one is drawn by this weight. None: each has its turn.
    """

    condition: PatternCall | Negation
    reward: Expression | None = None
    end: End | None = None
    apply: tuple[Branch, ...] = ()
    weight: Expression | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class OnReset:
    """`on reset apply branches`: a branch is drawn, then one of the matches of its rule, for the initial model.

    With a condition, `on reset find p(..) apply branches`, that is done for each match, or for one: see `OnFind`.
    """

    apply: tuple[Branch, ...]
    condition: PatternCall | Negation | None = None
    weight: Expression | None = None
    span: Span | None = field(default=None, compare=False, repr=False)

    @property
    def effect(self) -> EachStep | OnFind:
        """The clause of a step that does the same."""
        if self.condition is None:
            return EachStep(apply=self.apply, span=self.span)
        return OnFind(self.condition, apply=self.apply, weight=self.weight, span=self.span)


@dataclass(frozen=True, slots=True)
class ObserveObject:
    """`observe path among Class (or none) (for variable : Class)`: the index of the object at the path.

    Attributes:
        visible: what has to have a match in a state in which the value is seen; else it has a value of its own, the
            last one. So in the other observations.
    """

    path: Expression
    among: str
    or_none: bool = False
    each: Parameter | None = None
    visible: PatternCall | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    among_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class ObserveRange:
    """`observe path in low..high`, clipped to the range."""

    path: Expression
    low: int
    high: int
    each: Parameter | None = None
    visible: PatternCall | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class ObserveFind:
    """`observe find p(..)` (0 or 1), or `observe count find p(..) up to n` (min(count, n))."""

    call: PatternCall
    up_to: int | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class ObserveAttribute:
    """`observe x.attr (for x : Class)`: a bool or an enum, by its index; with `each` one component an object."""

    path: Expression
    each: Parameter | None = None
    visible: PatternCall | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


ObservePath = ObserveObject | ObserveRange | ObserveAttribute
Observation = ObservePath | ObserveFind
Effect = EachStep | OnFind


@dataclass(frozen=True, slots=True)
class Agent:
    """`agent robot : Robot { .. }`: one agent for each object of the class, in the order of its key."""

    variable: str
    cls: str
    actions: tuple[Action, ...] = ()
    effects: tuple[Effect, ...] = ()
    observations: tuple[Observation, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    cls_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Token:
    """`truck at path`, or for all objects `robot : Robot at robot.at`: drawn on top of a cell or node.

    Attributes:
        letter: of `packet as "D" at packet.destination`: what is there is a sign of the object, not the object.
    """

    variable: str
    path: Expression
    cls: str | None = None
    letter: str | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    cls_span: Span | None = field(default=None, compare=False, repr=False)
    letter_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class DrawGrid:
    """`draw grid Cell at (x, y) with ..`: cells by class glyph, at two int attributes."""

    cls: str
    column: str
    row: str
    tokens: tuple[Token, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    cls_span: Span | None = field(default=None, compare=False, repr=False)
    column_span: Span | None = field(default=None, compare=False, repr=False)
    row_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class DrawnLink:
    """`, Link label latency` of `draw graph`: objects that are drawn as edges have this attribute beside them."""

    cls: str
    label: str | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    cls_span: Span | None = field(default=None, compare=False, repr=False)
    label_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class DrawGraph:
    """`draw graph Node label name, Link label latency with ..`."""

    cls: str
    label: str | None = None
    tokens: tuple[Token, ...] = ()
    links: tuple[DrawnLink, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    cls_span: Span | None = field(default=None, compare=False, repr=False)
    label_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Behaviour:
    """What a `.environment` file says: parameters, actions, effects, observations, limits, drawing.

    `effects` keeps `each step` and `on` clauses together in file order, because rewards are summed in that order.

    Attributes:
        together: whether the agents act at the same time; else they take turns.
        unread: the names in those parts of the text that could not be read: what they stand for is unknown.
    """

    name: str
    parameters: tuple[Parameter, ...] = ()
    actions: tuple[Action, ...] = ()
    effects: tuple[Effect, ...] = ()
    resets: tuple[OnReset, ...] = ()
    observations: tuple[Observation, ...] = ()
    agents: tuple[Agent, ...] = ()
    together: bool = False
    limit: int | None = None
    draw: DrawGrid | DrawGraph | None = None
    annotations: tuple[Annotation, ...] = ()
    doc: str | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    unread: frozenset[str] = field(default=frozenset(), compare=False, repr=False)
    limit_span: Span | None = field(default=None, compare=False, repr=False)
    together_span: Span | None = field(default=None, compare=False, repr=False)

    @property
    def can_succeed(self) -> bool:
        """True if a clause, also one of an agent, ends episodes in success."""
        effects = [*self.effects, *(effect for agent in self.agents for effect in agent.effects)]
        return any(isinstance(effect, OnFind) and effect.end == "success" for effect in effects)
