"""Rewrite rules and control units as frozen data.

A rule holds what its author wrote; what it does to a graph is worked out in `envgraph.rewrite`.
"""

from __future__ import annotations

from dataclasses import field
from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import Span
from envgraph.metamodel import Annotation
from envgraph.pattern._queries import Constraint, InPackage, Parameter
from envgraph.pattern._terms import Expression, Variable


@dataclass(frozen=True, slots=True)
class Assignment:
    """`feature = value` inside the braces of an object literal; a list is one or more targets."""

    feature: str
    value: Expression | tuple[Expression, ...]
    span: Span | None = field(default=None, compare=False, repr=False)
    feature_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Node:
    """A node of a rule's graph: `x`, `x : Class`, or on a right side `x : Class { feature = value }`."""

    name: str
    type: str | None = None
    assignments: tuple[Assignment, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)
    type_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Edge:
    """`source -reference-> target`; `target <-reference- source` is the same edge. `closure` is "", "+" or "*"."""

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
    """What must be there: nodes (declared, or standing in an edge), edges, and query constraints."""

    nodes: tuple[Node, ...] = ()
    edges: tuple[Edge, ...] = ()
    constraints: tuple[Constraint, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Create:
    """`create a -ref-> x : Class { .. }`: nodes with a type are new, edges are added."""

    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...] = ()
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class DeleteNode:
    """`delete x`."""

    node: Variable
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class DeleteEdge:
    """`delete a -ref-> b`."""

    edge: Edge
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Set:
    """`set object.feature = value`, `+=`, `-=`."""

    object: Variable
    feature: str
    operator: Literal["=", "+=", "-="]
    value: Expression | tuple[Expression, ...]
    span: Span | None = field(default=None, compare=False, repr=False)
    feature_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Retype:
    """`retype x : Class`: same identity, exactly that class afterwards."""

    node: Variable
    type: str
    span: Span | None = field(default=None, compare=False, repr=False)
    type_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Move:
    """`move x to container.reference`."""

    node: Variable
    container: Variable
    reference: str
    span: Span | None = field(default=None, compare=False, repr=False)
    reference_span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Merge:
    """`merge kept <- absorbed`: links of the absorbed node go over to the kept one."""

    kept: Variable
    absorbed: Variable
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Redirect:
    """`redirect a -ref-> b to c`: the edge gets another target."""

    edge: Edge
    target: Variable
    span: Span | None = field(default=None, compare=False, repr=False)


Action = Create | DeleteNode | DeleteEdge | Set | Retype | Move | Merge | Redirect


@dataclass(frozen=True, slots=True)
class RightSide:
    """`rhs { .. }`: the graph after the rule; what the left side has and this lacks is deleted."""

    nodes: tuple[Node, ...] = ()
    edges: tuple[Edge, ...] = ()
    actions: tuple[Action, ...] = ()
    """Only `set`, and `delete` as the explicit word for an omission."""
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Modification:
    """`modify { .. }`: everything stays but what an action changes."""

    actions: tuple[Action, ...]
    span: Span | None = field(default=None, compare=False, repr=False)


BlockKind = Literal["not", "require", "forall", "forall+", "optional"]


@dataclass(frozen=True, slots=True)
class Block:
    """A nested condition (`not`, `require`) or a nested rule (`forall`, `forall+`, `optional`)."""

    kind: BlockKind
    left: LeftSide
    blocks: tuple[Block, ...] = ()
    right: RightSide | Modification | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Rule(InPackage):
    """A rewrite rule.

    Attributes:
        weight: relative frequency of a random choice among rules (`@weight`), > 0.
        priority: higher goes first (`@priority`).
        semantics: "dpo" refuses what would leave dangling edges, "spo" removes them (`@semantics`).
        injective: different object variables are different objects; `homomorphic` lists the groups of names that
            may still coincide (`@hom`).
    """

    name: str
    parameters: tuple[Parameter, ...] = ()
    left: LeftSide = LeftSide()
    blocks: tuple[Block, ...] = ()
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
class Call:
    """`name(arguments)` in a unit.

    Attributes:
        every: `all rule;`, `top 3 rule by ..;`: each match of a snapshot, checked again before firing.
        first: `first rule;`: the first match instead of one drawn at random.
        limit: of `top`; then `every` is true, and `by` is given.
        by: orders the matches of a snapshot, the largest value first; over variables of the rule and of the unit.
        where: conditions that a match has to meet, over the same variables.
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
class Sequence:
    """`a; b; c;` in order."""

    steps: tuple[Step, ...]
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Choice:
    """`a | { b; c; }`: one that can be applied, by priority, then by weight; blocks have priority 0 and weight 1."""

    alternatives: tuple[Step, ...]
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Alap:
    """`alap { .. }`: as long as possible."""

    body: Step
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Repeat:
    """`repeat lower..upper { .. }`: a random number of times, both bounds included.

    A bound may be an expression over the variables of the unit, worked out when the step begins.
    """

    lower: int | Expression
    upper: int | Expression
    body: Step
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Try:
    """`try { .. } else { .. }`."""

    body: Step
    otherwise: Step | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Applicable:
    """`if rule(x) { .. }`, `if neg rule(x) { .. }`: the rule is applicable at one of its matches.

    With one argument this is written, and read, like the type of a variable: `TypeConstraint("rule", x)` means the same
    where `rule` is the name of no type.
    """

    name: str
    arguments: tuple[Expression, ...] = ()
    negated: bool = False
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class If:
    """`if find p(x) { .. } else { .. }`, also with any other constraint of a pattern, or with a rule."""

    condition: Constraint | Applicable
    then: Step
    otherwise: Step | None = None
    span: Span | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Atomic:
    """`atomic { .. }`: all or nothing."""

    body: Step
    span: Span | None = field(default=None, compare=False, repr=False)


Step = Call | Sequence | Choice | Alap | Repeat | Try | If | Atomic


@dataclass(frozen=True, slots=True)
class Unit(InPackage):
    """A control program over rules, with the same standing as a rule wherever one is named."""

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
    """`derive name = retype among { A, B };` or `derive name = operators for Class;`: a group of rules to generate.

    `kind` "retype" gives `name.A.B` for every ordered pair; "operators" the operators of the one class.
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
