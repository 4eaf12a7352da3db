"""Rewrite rules and control units as frozen data.

A rule contains what its author wrote. `envgraph.rewrite` computes its effect on a graph.
"""

from __future__ import annotations

from dataclasses import field
from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Annotation
from envgraph.pattern._expression_data import Expression, Variable
from envgraph.pattern._query_data import Constraint, InPackage, Parameter


@dataclass(frozen=True, slots=True)
class Assignment:
    """An assignment `feature = value` in the braces of an object literal. A list is one or more targets."""

    feature: str
    value: Expression | tuple[Expression, ...]
    span: Span | None = field(default=None, compare=False, repr=False)
    feature_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class RuleNode:
    """A node of a rule's graph: `x`, `x : Class`, or on a right-hand side `x : Class { feature = value }`."""

    name: str
    type: str | None = None
    assignments: tuple[Assignment, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    type_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class RuleEdge:
    """An edge `source -reference-> target` of a rule, or `target <-reference- source`. `closure` is "", "+" or "*"."""

    source: str
    reference: str
    target: str
    closure: Literal["", "+", "*"] = ""
    span: Span | None = field(default=None, compare=False, repr=False)
    source_span: Span | None = field(default=None, compare=False, repr=False)
    reference_span: Span | None = field(default=None, compare=False, repr=False)
    target_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class LeftSide:
    """The left-hand side of a rule: nodes (declared, or named in an edge), edges, and query constraints."""

    nodes: tuple[RuleNode, ...] = ()
    edges: tuple[RuleEdge, ...] = ()
    constraints: tuple[Constraint, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class CreateAction:
    """An action `create a -ref-> x : Class { .. }`. Nodes with a type are created as objects, and edges as links."""

    nodes: tuple[RuleNode, ...]
    edges: tuple[RuleEdge, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class DeleteNode:
    """An action `delete x`, which deletes an object."""

    node: Variable
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class DeleteEdge:
    """An action `delete a -ref-> b`, which deletes a link."""

    edge: RuleEdge
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class SetAction:
    """An action `set object.feature = value`. `+=` adds to the current value or values, `-=` subtracts or removes."""

    object: Variable
    feature: str
    operator: Literal["=", "+=", "-="]
    value: Expression | tuple[Expression, ...]
    span: Span | None = field(default=None, compare=False, repr=False)
    feature_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class RetypeAction:
    """An action `retype x : Class`. The object keeps its identity and becomes a direct instance of the class."""

    node: Variable
    type: str
    span: Span | None = field(default=None, compare=False, repr=False)
    type_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class MoveAction:
    """An action `move x to container.reference`, which moves an object into another container."""

    node: Variable
    container: Variable
    reference: str
    span: Span | None = field(default=None, compare=False, repr=False)
    reference_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class MergeAction:
    """An action `merge kept <- absorbed`: links of the absorbed object are moved to the kept one, and it is deleted."""

    kept: Variable
    absorbed: Variable
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class RedirectAction:
    """An action `redirect a -ref-> b to c`, which replaces the link from `a` to `b` by a link from `a` to `c`."""

    edge: RuleEdge
    target: Variable
    span: Span | None = field(default=None, compare=False, repr=False)


Action = CreateAction | DeleteNode | DeleteEdge | SetAction | RetypeAction | MoveAction | MergeAction | RedirectAction


@dataclass(frozen=True, slots=True)
class RightSide:
    """The right-hand side `rhs { .. }`: the graph after the rule. Left-hand side parts missing here are deleted."""

    nodes: tuple[RuleNode, ...] = ()
    edges: tuple[RuleEdge, ...] = ()
    actions: tuple[Action, ...] = ()
    """Only `set` actions, and `delete` actions, which confirm that a part is omitted."""
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Modification:
    """A right-hand side `modify { .. }`, whose actions are the only changes of the graph."""

    actions: tuple[Action, ...]
    span: Span | None = field(default=None, compare=False, repr=False)


BlockKind = Literal["not", "require", "forall", "forall+", "optional"]


@dataclass(frozen=True, slots=True)
class RuleBlock:
    """A nested condition (`not` or `require`) or a nested rule (`forall`, `forall+`, `optional`) of a rule.

    `not` is a negative application condition.
    """

    kind: BlockKind
    left: LeftSide
    blocks: tuple[RuleBlock, ...] = ()
    right: RightSide | Modification | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Rule(InPackage):
    """A rewrite rule.

    Attributes:
        weight: the relative probability in a random choice among rules (`@weight`), > 0.
        priority: rules with a higher priority are applied first (`@priority`).
        semantics: "dpo" refuses an application that would leave dangling edges, "spo" deletes these edges
            (`@semantics`).
        injective: True if different object variables must be different objects. `homomorphic` lists the groups of names
            that may be equal all the same (`@hom`).
    """

    name: str
    parameters: tuple[Parameter, ...] = ()
    left: LeftSide = LeftSide()
    blocks: tuple[RuleBlock, ...] = ()
    right: RightSide | Modification | None = None
    package: str = ""
    weight: float = 1.0
    priority: int = 0
    semantics: Literal["dpo", "spo"] = "dpo"
    injective: bool = True
    homomorphic: tuple[tuple[str, ...], ...] = ()
    annotations: tuple[Annotation, ...] = ()
    doc: str | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    homomorphic_spans: tuple[tuple[Span, ...], ...] = field(default=(), compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class UnitCall:
    """A step `name(arguments)` of a unit, which applies a rule or calls a unit.

    Attributes:
        every: True for `all rule;` and `top 3 rule by ..;`: the rule is applied to each match of a snapshot that is
            still a match when its turn comes.
        first: True for `first rule;`: the first match is used instead of a randomly sampled one.
        limit: the number after `top`; else None.
        by: the expression that orders the matches of a snapshot, largest value first. It may use variables of the rule
            and of the unit.
        where: conditions on a match, over the same variables.
    """

    name: str
    arguments: tuple[Expression, ...] = ()
    every: bool = False
    span: Span | None = field(default=None, compare=False, repr=False)
    name_span: Span | None = field(default=None, compare=False, repr=False)
    first: bool = False
    limit: int | None = None
    by: Expression | None = None
    where: tuple[Constraint, ...] = ()


@dataclass(frozen=True, slots=True)
class StepSequence:
    """The steps `a; b; c;`, in order. A step that fails ends them, and earlier changes stay."""

    steps: tuple[Step, ...]
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class UnitChoice:
    """A step `a | { b; c; }`: alternatives are tried until one succeeds, by priority, then in random order by weight.

    Blocks have priority 0 and weight 1.
    """

    alternatives: tuple[Step, ...]
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Alap:
    """A loop `alap { .. }`, repeated as long as its body succeeds and applies a rule."""

    body: Step
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Repeat:
    """A loop `repeat lower..upper { .. }` with a random number of rounds, both bounds included.

    A bound may be an expression over the variables of the unit, evaluated at the start of the step.
    """

    lower: int | Expression
    upper: int | Expression
    body: Step
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class TryStep:
    """A step `try { .. } else { .. }`: if the body fails, its changes are rolled back and the else branch runs."""

    body: Step
    otherwise: Step | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Applicable:
    """A condition `if rule(x) { .. }` or `if neg rule(x) { .. }`: the rule is applicable at one of its matches.

    With one argument the parser reads it as a type constraint: `TypeConstraint("rule", x)` has the same meaning if no
    type is named `rule`.
    """

    name: str
    arguments: tuple[Expression, ...] = ()
    negated: bool = False
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class IfStep:
    """A step `if find p(x) { .. } else { .. }`. The condition is a constraint of a pattern, or `Applicable`."""

    condition: Constraint | Applicable
    then: Step
    otherwise: Step | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class AtomicStep:
    """A step `atomic { .. }`: if something inside fails, the step fails, and all its changes are undone."""

    body: Step
    span: Span | None = field(default=None, compare=False, repr=False)


Step = UnitCall | StepSequence | UnitChoice | Alap | Repeat | TryStep | IfStep | AtomicStep


@dataclass(frozen=True, slots=True)
class Unit(InPackage):
    """A control program over rules. A unit can be called wherever a rule can be called."""

    name: str
    parameters: tuple[Parameter, ...]
    body: Step
    package: str = ""
    weight: float = 1.0
    priority: int = 0
    annotations: tuple[Annotation, ...] = ()
    doc: str | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Derivation(InPackage):
    """A group of rules to generate: `derive name = retype among { A, B };` or `derive name = operators for Class;`.

    `kind` "retype" generates `name.A.B` for every ordered pair of classes; "operators" generates the operators of one
    class.
    """

    name: str
    kind: Literal["retype", "operators"]
    classes: tuple[str, ...]
    package: str = ""
    weight: float = 1.0
    annotations: tuple[Annotation, ...] = ()
    doc: str | None = None
    span: Span | None = field(default=None, compare=False, repr=False)
    class_spans: tuple[Span, ...] = field(default=(), compare=False, repr=False)
