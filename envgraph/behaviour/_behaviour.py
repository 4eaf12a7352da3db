"""The behaviour of agents over a model as frozen data: the content of a `.environment` file.

The docstring of `Simulator` defines a step.
"""

from __future__ import annotations

from dataclasses import field
from typing import ClassVar, Literal

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Annotation
from envgraph.pattern import AggregateFunction, Expression, Negation, Parameter, PatternCall, Variable


@dataclass(frozen=True, slots=True)
class RuleCall:
    """A call `rule(arguments)`; for `nothing()` the rule is None."""

    rule: str | None
    arguments: tuple[Expression, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    rule_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Branch:
    """An outcome of a random choice; with the remaining probability (up to 1) nothing happens.

    Attributes:
        probability: a number from 0 to 1, or an expression that is evaluated in the state of the choice; it counts as 0
            if it has no value because an object was deleted.
    """

    probability: float | Expression
    call: RuleCall
    span: Span | None = field(default=None, compare=False, repr=False)
    probability_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Domain:
    """The values of an action parameter: objects of `cls` (by index), literals of `enum`, or the ints low..high."""

    cls: str | None = None
    enum: str | None = None
    low: int = 0
    high: int = 0
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Action:
    """An action clause: `@key("a") action name(parameter : domain) = branches reward e else reward e`.

    Attributes:
        keys: the keys of a keyboard that do it: one for each combination of the values of its parameters, and then
            further keys in the same order.
    """

    name: str
    branches: tuple[Branch, ...]
    parameters: tuple[tuple[str, Domain], ...] = ()
    reward: Expression | None = None
    else_reward: Expression | None = None
    keys: tuple[str, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    keys_span: Span | None = field(default=None, compare=False, repr=False)
    key_spans: tuple[Span, ...] = field(default=(), compare=False, repr=False)
    parameter_spans: tuple[Span, ...] = field(default=(), compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class EachStep:
    """A clause for every step: `each step reward e apply branches`; either part may be missing."""

    reward: Expression | None = None
    apply: tuple[Branch, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)


End = Literal["success", "failure", "truncation"]


@dataclass(frozen=True, slots=True)
class OnFind:
    """A clause for states with a match: `on find p(..) reward e terminate success|failure apply branches`.

    The condition may be negated (`on neg find`).

    Attributes:
        end: how the episode ends if the condition holds, or None; "truncation" is written `truncate`.
        weight: with `apply r(x) weight e`, one match is sampled with this weight. None: the rule is applied to each.
    """

    condition: PatternCall | Negation
    reward: Expression | None = None
    end: End | None = None
    apply: tuple[Branch, ...] = ()
    weight: Expression | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class OnRefused:
    """A clause for steps in which the model refuses a rule: `on refused reward e terminate success|failure`.

    Without such a clause a refusal is an error. In an `agent` block it is about the rules of the agent's actions and of
    the clauses of the block, otherwise about all rules. Without reward and end it is written `on refused nothing()`.
    """

    apply: ClassVar[tuple[Branch, ...]] = ()
    reward: Expression | None = None
    end: End | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class OnReset:
    """A clause for resets: `on reset apply branches` samples a branch, then a match of its rule in the initial model.

    With a condition, as in `on reset find p(..) apply branches`, this is done for each match, or for one: see `OnFind`.
    """

    apply: tuple[Branch, ...]
    condition: PatternCall | Negation | None = None
    weight: Expression | None = None
    span: Span | None = field(default=None, compare=False, repr=False)

    @property
    def as_effect(self) -> EachStep | OnFind:
        """Return the equivalent step clause: `each step` without a condition, otherwise `on find`."""
        if self.condition is None:
            return EachStep(apply=self.apply, span=self.span)
        return OnFind(self.condition, apply=self.apply, weight=self.weight, span=self.span)


@dataclass(frozen=True, slots=True)
class ObserveObject:
    """An observation of an object's index: `observe path among Class (or none) (for variable : Class)`.

    Attributes:
        visible: a call that must have a match for the value to be seen; otherwise the observation has a special value,
            the last one. The same holds in the other observations.
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
    """An observation of an int or float: `observe path in low..high`; values are clipped to the range.

    An int is observed as a float if a bound is a float.
    """

    path: Expression
    low: float
    high: float
    each: Parameter | None = None
    visible: PatternCall | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class ObserveFind:
    """An observation of matches: `observe find p(..)` (0, 1) or `observe count find p(..) up to n` (min(count, n)).

    With another aggregate, `observe sum find p(.., #) in low..up_to`, its value is observed as a number in a range; it
    is an int if both bounds are ints.

    Attributes:
        up_to: the highest value; None if only the existence of a match is observed.
    """

    call: PatternCall
    up_to: float | None = None
    each: Parameter | None = None
    visible: PatternCall | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    aggregate: AggregateFunction = "count"
    low: float = 0


@dataclass(frozen=True, slots=True)
class ObserveAttribute:
    """An observation of a bool, an enum's index, or a number with a `@range`, as `observe x.attr (for x : Class)`."""

    path: Expression
    each: Parameter | None = None
    visible: PatternCall | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class ObserveAround:
    """An observation of the grid around an object: `observe around centre width x height (if find p(centre, cell))`.

    Attributes:
        visible: a call that must have a match for a cell to be seen; the name in it that has no value is the cell.
    """

    centre: Variable
    width: int
    height: int
    visible: PatternCall | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    each: ClassVar[None] = None


ObservePath = ObserveObject | ObserveRange | ObserveAttribute
Observation = ObservePath | ObserveFind | ObserveAround
Effect = EachStep | OnFind | OnRefused


@dataclass(frozen=True, slots=True)
class Agent:
    """An agent block `agent robot : Robot { .. }`: one agent for each object of the class, in the order of its key."""

    variable: str
    cls: str
    actions: tuple[Action, ...] = ()
    effects: tuple[Effect, ...] = ()
    observations: tuple[Observation, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    cls_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Token:
    """An object drawn on top of a cell or node: `truck at path`, or `robot : Robot at robot.at` for all objects.

    Attributes:
        letter: a letter drawn in place of the object's glyph, at a place that is not the object's own: the "D" in
            `packet as "D" at packet.destination`.
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
    """A drawing as a grid, `draw grid Cell at (x, y) with ..`: a cell is drawn at its int attributes `x` and `y`."""

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
    """A class whose objects are drawn as edges, with an attribute as label: `, Link label latency` of `draw graph`."""

    cls: str
    label: str | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    cls_span: Span | None = field(default=None, compare=False, repr=False)
    label_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class DrawGraph:
    """A drawing as a graph: `draw graph Node label name, Link label latency with ..`."""

    cls: str
    label: str | None = None
    tokens: tuple[Token, ...] = ()
    links: tuple[DrawnLink, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    cls_span: Span | None = field(default=None, compare=False, repr=False)
    label_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Behaviour:
    """The content of a `.environment` file: parameters, actions, effects, observations, limits and drawing.

    `effects` contains `each step` and `on` clauses together in file order, because rewards are summed in that order.

    Attributes:
        together: True if the agents act at the same time; otherwise they take turns.
        unread: names in text that could not be read; their meaning is unknown.
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
        """Return True if a clause, of an agent block or not, ends episodes in success."""
        effects = [*self.effects, *(effect for agent in self.agents for effect in agent.effects)]
        return any(not isinstance(effect, EachStep) and effect.end == "success" for effect in effects)
