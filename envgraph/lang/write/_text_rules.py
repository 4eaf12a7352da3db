"""Write graphs, rules, units and derivations as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from typing import Final

from envgraph.code import dataclass
from envgraph.lang.write._text_terms import TermText, plain_doc
from envgraph.metamodel import Annotation, Value
from envgraph.pattern import (
    Action,
    Alap,
    Applicable,
    Atomic,
    Block,
    Call,
    Choice,
    Constant,
    Constraint,
    Create,
    DeleteEdge,
    DeleteNode,
    Derivation,
    Edge,
    EnumLiteral,
    Evaluation,
    Expression,
    If,
    LeftSide,
    Merge,
    Modification,
    Move,
    Negation,
    Node,
    Redirect,
    Repeat,
    Retype,
    RightSide,
    Rule,
    Sequence as Steps,
    Set,
    Step,
    Try,
    TypeConstraint,
    Unit,
    Variable,
)

# --- graphs


@dataclass(slots=True)
class Chain:
    """A path of nodes and arrows, `a : T -r-> b <-s- c`.

    Attributes:
        vertices: the nodes, in order.
        edges: the edges between neighbouring nodes; the bool is True if the edge leads forward.
    """

    vertices: list[Node]
    edges: list[tuple[Edge, bool]] = field(default_factory=list)

    def as_create(self) -> Create:
        """Return the `Create` action that the parser reads from `create` and this chain."""
        nodes: dict[str, Node] = {}
        for vertex in self.vertices:
            if vertex.name != "_":
                nodes.setdefault(vertex.name, vertex)
        alone = tuple(self.vertices) if not self.edges else tuple(nodes.values())
        return Create(alone, tuple(edge for edge, _ in self.edges))


class _Chains:
    """A builder of chains that contain all nodes and edges of a graph, in their order."""

    def __init__(self, nodes: Sequence[Node], edges: Sequence[Edge]) -> None:
        self.found: list[Chain] = []
        self._waiting = [*with_ends(nodes, edges)]
        self._waiting.reverse()
        self._known: set[str] = set()
        for edge in edges:
            self._add(edge)
        while self._waiting:
            self._declare()

    def _declare(self) -> None:
        node = self._waiting.pop()
        self._known.add(node.name)
        self.found.append(Chain([node]))

    def _next(self, names: Sequence[str]) -> bool:
        """Return True if the undeclared nodes among `names` are the next nodes to be declared, in this order."""
        new = [name for name in dict.fromkeys(names) if name != "_" and name not in self._known]
        return [node.name for node in self._waiting[: -len(new) - 1 : -1]] == new if new else True

    def _add(self, edge: Edge) -> None:
        ends = {edge.source, edge.target} - {"_"}
        while self._waiting and (self._waiting[-1].name == "_" or self._waiting[-1].name in self._known):
            self._declare()
        both = (edge.source, edge.target), (edge.target, edge.source)
        while not any(map(self._next, both)):
            self._declare()
        last = self.found[-1].vertices[-1] if self.found and self.found[-1].edges else None
        for forward, (first, second) in zip((True, False), both, strict=True):
            if last and first == last.name != "_" and self._next((second,)) and ends:
                self.found[-1].vertices.append(self._vertex(second))
                self.found[-1].edges.append((edge, forward))
                return
        forward = self._next(both[0])
        first, second = both[0] if forward else both[1]
        self.found.append(Chain([self._vertex(first), self._vertex(second)], [(edge, forward)]))

    def _vertex(self, name: str) -> Node:
        if name == "_" or name in self._known:
            return Node(name)
        self._known.add(name)
        return self._waiting.pop()


def chains(nodes: Sequence[Node], edges: Sequence[Edge]) -> list[Chain]:
    """Return chains of nodes and arrows that together write all nodes and edges of a graph, in their order."""
    return _Chains(nodes, edges).found


def with_ends(nodes: Sequence[Node], edges: Sequence[Edge]) -> tuple[Node, ...]:
    """Return the nodes, and a node for each end of an edge that is not among them, since an arrow mentions its ends."""
    known = {node.name: node for node in nodes}
    ends = {name: Node(name) for edge in edges for name in (edge.source, edge.target) if name != "_"}
    return (*nodes, *(node for name, node in ends.items() if name not in known))


# --- text


class RuleText(TermText):
    """A writer of the text of one definition in a `.rules` file."""

    def definition(self, one: Rule | Unit | Derivation) -> str:
        """Return the text of a rule, unit or derivation with its doc comment and annotations."""
        marks = "".join(f"{self.annotation(mark)}\n" for mark in annotations_of(one))
        return self.doc(one.doc) + marks + self._definition(one)

    def _definition(self, one: Rule | Unit | Derivation) -> str:
        match one:
            case Rule():
                parts = [
                    f"lhs {{ {self.left(one.left)} }}",
                    *map(self.block, one.blocks),
                    self.right(one.right),
                ]
                parameters = self.parameters(one.parameters) if one.parameters else ""
                return f"rule {self.name(one.name)}{parameters} {{\n{_lines(parts)}}}"
            case Unit():
                parameters = self.parameters(one.parameters) if one.parameters else ""
                return f"unit {self.name(one.name)}{parameters} {{\n{_lines(self.steps(one.body))}}}"
            case Derivation(name, "retype"):
                classes = ", ".join(map(self.type, one.classes))
                return f"derive {self.name(name)} = retype among {{ {classes} }};"
        if len(one.classes) != 1:
            self.refuse(
                f"`{one.name}` derives operators for {len(one.classes)} classes, but must name one class"
            )
        return f"derive {self.name(one.name)} = operators for {self.type(one.classes[0])};"

    # --- graphs

    def _vertex(self, node: Node) -> str:
        name = "_" if node.name.startswith("#") else self.name(node.name)
        if node.type is None:
            if node.assignments:
                self.refuse(f"the node `{node.name}` has values but no class")
            return name
        values = ", ".join(f"{self.name(one.feature)} = {self.values(one.value)}" for one in node.assignments)
        return f"{name} : {self.type(node.type)}" + (f" {{ {values} }}" if values else "")

    def values(self, value: Expression | tuple[Expression, ...]) -> str:
        """Return the text of an expression, or of a list of expressions as `[a, b]`."""
        return f"[{self.expressions(value)}]" if isinstance(value, tuple) else self.expression(value)

    def chain(self, chain: Chain) -> str:
        """Return the text of a chain: its nodes with arrows between them."""
        text = self._vertex(chain.vertices[0])
        for (edge, forward), vertex in zip(chain.edges, chain.vertices[1:], strict=True):
            reference = f"{self.name(edge.reference)}{edge.closure}"
            text += f" -{reference}-> " if forward else f" <-{reference}- "
            text += self._vertex(vertex)
        return text

    def arrow(self, edge: Edge) -> str:
        """Return the text of one edge with its two ends."""
        return self.chain(Chain([Node(edge.source), Node(edge.target)], [(edge, True)]))

    def left(self, left: LeftSide) -> str:
        """Return the contents of `lhs`, on one line; raise InvalidArgument if a node without a name is used twice."""
        found = chains(left.nodes, left.edges)
        hidden = [node.name for chain in found for node in chain.vertices if node.name.startswith("#")]
        if len(hidden) > len(set(hidden)):
            self.refuse("a node without a name is used more than once; give it a name")
        graph = [self.chain(chain) for chain in found]
        return " ".join(f"{one};" for one in (*graph, *map(self.condition, left.constraints)))

    def right(self, right: RightSide | Modification | None) -> str:
        """Return the text of `rhs` or `modify`; "" if `right` is None."""
        match right:
            case None:
                return ""
            case Modification(actions):
                return f"modify {{ {self.actions(actions)} }}"
        graph = "".join(f"{self.chain(chain)}; " for chain in chains(right.nodes, right.edges))
        return f"rhs {{ {graph}{self.actions(right.actions)} }}"

    def actions(self, actions: Iterable[Action]) -> str:
        """Return the text of all actions, on one line."""
        return " ".join(f"{self.action(action)};" for action in split(actions))

    def action(self, action: Action) -> str:
        """Return the text of one action; a `Create` must be a single chain."""
        match action:
            case Create(nodes, edges):
                return f"create {self.chain(chains(nodes, edges)[0])}"
            case DeleteNode(node):
                return f"delete {self.name(node.name)}"
            case DeleteEdge(edge):
                return f"delete {self.arrow(edge)}"
            case Set(owner, feature, operator, value):
                target = f"{self.name(owner.name)}.{self.name(feature)}"
                return f"set {target} {operator} {self.values(value)}"
            case Retype(node, type_):
                return f"retype {self.name(node.name)} : {self.type(type_)}"
            case Move(node, container, reference):
                place = f"{self.name(container.name)}.{self.name(reference)}"
                return f"move {self.name(node.name)} to {place}"
            case Merge(kept, absorbed):
                return f"merge {self.name(kept.name)} <- {self.name(absorbed.name)}"
            case Redirect(edge, target_):
                return f"redirect {self.arrow(edge)} to {self.name(target_.name)}"

    def block(self, block: Block) -> str:
        """Return the text of a nested condition or nested rule."""
        left = self.left(block.left)
        if block.kind not in _CONDITIONS and left:
            left = f"lhs {{ {left} }}"
        parts = [left, *map(self.block, block.blocks), self.right(block.right)]
        return f"{block.kind} {{ {' '.join(part for part in parts if part)} }}"

    # --- units

    def steps(self, step: Step) -> list[str]:
        """Return the statements of a step, one text for each."""
        match step:
            case Steps(steps):
                return [text for inner in steps for text in self.steps(inner)]
            case Choice(alternatives):
                if not alternatives:
                    self.refuse("a choice has no alternatives")
                if len(alternatives) == 1 and not isinstance(alternatives[0], Call):
                    self.refuse("a choice has only one alternative, which is a block")
                end = ";" if isinstance(alternatives[-1], Call) else ""
                return [" | ".join(map(self._alternative, alternatives)) + end]
            case Call():
                return [self._call(step) + ";"]
            case Alap(body):
                return [f"alap {self._steps(body)}"]
            case Atomic(body):
                return [f"atomic {self._steps(body)}"]
            case Repeat(lower, upper, body):
                bounds = (lower,) if lower == upper else (lower, upper)
                return [f"repeat {'..'.join(map(self._bound, bounds))} {self._steps(body)}"]
            case Try(body, otherwise):
                rest = f" else {self._steps(otherwise)}" if otherwise else ""
                return [f"try {self._steps(body)}{rest}"]
            case If():
                return [self._if(step)]

    def _if(self, step: If) -> str:
        condition = step.condition
        asked = (
            self._applicable(condition) if isinstance(condition, Applicable) else self.condition(condition)
        )
        text = f"if {asked} {self._steps(step.then)}"
        if step.otherwise is None:
            return text
        rest = self._if(step.otherwise) if isinstance(step.otherwise, If) else self._steps(step.otherwise)
        return f"{text} else {rest}"

    def _applicable(self, asked: Applicable) -> str:
        simple = Variable | Constant | EnumLiteral
        terms = [self.term(one if isinstance(one, simple) else Evaluation(one)) for one in asked.arguments]
        arguments = f"({', '.join(terms)})" if terms else ""
        return f"{'neg ' if asked.negated else ''}{self.name(asked.name)}{arguments}"

    def _bound(self, bound: int | Expression) -> str:
        return str(bound) if isinstance(bound, int) else self.expression(bound, 1)

    def _alternative(self, step: Step) -> str:
        return self._call(step) if isinstance(step, Call) else self._steps(step)

    def _call(self, step: Call) -> str:
        arguments = f"({self.expressions(step.arguments)})" if step.arguments else ""
        which = f"top {step.limit} " if step.limit is not None else "all " if step.every else ""
        if step.first:
            which = "first "
        where = f" where {', '.join(map(self.condition, step.where))}" if step.where else ""
        by = f" by {self.expression(step.by)}" if step.by is not None else ""
        return f"{which}{self.qualified(step.name)}{arguments}{where}{by}"

    def _steps(self, step: Step) -> str:
        return f"{{ {' '.join(self.steps(step))} }}"


_CONDITIONS: Final = ("not", "require")


def _lines(parts: Iterable[str]) -> str:
    return "".join(f"{part}\n" for part in parts if part)


# --- what is read again


def split(actions: Iterable[Action]) -> list[Action]:
    """Return the actions, with each `Create` divided into one `Create` for each chain."""
    found: list[Action] = []
    for action in actions:
        if isinstance(action, Create):
            found += [chain.as_create() for chain in chains(action.nodes, action.edges)]
        else:
            found.append(action)
    return found


def annotations_of(one: Rule | Unit | Derivation) -> tuple[Annotation, ...]:
    """Return the annotations of a definition, completed by annotations for fields such as `weight` and `priority`.

    A rule built in Python may have a weight in its field, but no annotation for it.
    """
    found = [*one.annotations]
    wanted = {"weight": _said(found, "weight", ((one.weight,),), ((1.0,),))}
    if not isinstance(one, Derivation):
        wanted["priority"] = _said(found, "priority", ((one.priority,),), ((0,),))
    if isinstance(one, Rule):
        match = "injective" if one.injective else "homomorphic"
        wanted["semantics"] = _said(found, "semantics", ((one.semantics,),), (("dpo",),))
        wanted["match"] = _said(found, "match", ((match,),), (("injective",),))
        wanted["hom"] = _said(found, "hom", one.homomorphic, ())
    result: list[Annotation] = []
    for annotation in found:
        result += wanted.pop(annotation.name, [] if annotation.name in _FIELDS else [annotation])
    return (*result, *(annotation for rest in wanted.values() for annotation in rest))


_FIELDS: Final = ("weight", "priority", "semantics", "match", "hom")


def _said(
    annotations: Iterable[Annotation], name: str, wanted: Sequence[tuple[Value, ...]], usual: Sequence[object]
) -> list[Annotation]:
    """Return the existing annotations `name` if they state the `wanted` arguments, else new annotations that do.

    `usual` are the arguments that apply without any annotation.
    """
    known = [one for one in annotations if one.name == name]
    if (tuple(one.arguments for one in known if one.arguments) or usual) == wanted:
        return known
    blank = known[0] if len(known) == len(wanted) == 1 else Annotation(name)
    return [replace(blank, arguments=arguments) for arguments in wanted]


def read_again(one: Rule | Unit | Derivation) -> Rule | Unit | Derivation:
    """Return the definition as the parser would read it from its own text."""
    doc, annotations = plain_doc(one.doc), annotations_of(one)
    match one:
        case Rule():
            return replace(
                one,
                doc=doc,
                annotations=annotations,
                left=left_again(one.left),
                blocks=tuple(map(block_again, one.blocks)),
                right=right_again(one.right),
            )
        case Unit():
            return replace(one, doc=doc, annotations=annotations, body=steps_again(one.body))
    return replace(one, doc=doc, annotations=annotations)


def left_again(left: LeftSide) -> LeftSide:
    """Return a left-hand side as the parser would read it from its own text."""
    return replace(left, nodes=with_ends(left.nodes, left.edges))


def right_again(right: RightSide | Modification | None) -> RightSide | Modification | None:
    """Return the contents of `rhs` or `modify` as the parser would read them; None if there are none."""
    match right:
        case Modification(actions):
            return replace(right, actions=tuple(split(actions)))
        case RightSide(nodes, edges):
            return replace(right, nodes=with_ends(nodes, edges))
    return None


def block_again(block: Block) -> Block:
    """Return a nested condition or rule as the parser would read it from its own text."""
    blocks = tuple(map(block_again, block.blocks))
    return replace(block, left=left_again(block.left), blocks=blocks, right=right_again(block.right))


def steps_again(step: Step) -> Steps:
    """Return the block of a step as the parser would read it: one sequence without nested sequences."""
    parts = step.steps if isinstance(step, Steps) else (step,)
    return Steps(tuple(inner for part in parts for inner in _flat(part)))


def _flat(step: Step) -> tuple[Step, ...]:
    match step:
        case Steps():
            return steps_again(step).steps
        case Choice((Call() as only,)):
            return (only,)
        case Choice(alternatives):
            again = (one if isinstance(one, Call) else steps_again(one) for one in alternatives)
            return (Choice(tuple(again)),)
        case Repeat(lower, upper, body):
            return (Repeat(_bound_again(lower), _bound_again(upper), steps_again(body)),)
        case Alap() | Atomic():
            return (replace(step, body=steps_again(step.body)),)
        case Try(body, otherwise):
            return (Try(steps_again(body), steps_again(otherwise) if otherwise else None),)
        case If():
            return (_if(step),)
    return (step,)


def _bound_again(bound: int | Expression) -> int | Expression:
    if isinstance(bound, Constant) and type(bound.value) is int:
        return bound.value
    return bound


def _if(step: If) -> If:
    otherwise = step.otherwise
    if otherwise is not None:
        otherwise = _if(otherwise) if isinstance(otherwise, If) else steps_again(otherwise)
    return If(_asked_again(step.condition), steps_again(step.then), otherwise)


def _asked_again(condition: Constraint | Applicable) -> Constraint | Applicable:
    """Return the condition of an `if` as it is read: the parser takes a rule with one argument for a type condition."""
    if not isinstance(condition, Applicable) or len(condition.arguments) != 1:
        return condition
    (argument,) = condition.arguments
    term = argument if isinstance(argument, Variable | Constant | EnumLiteral) else Evaluation(argument)
    relation = TypeConstraint(condition.name, term)
    return Negation(relation) if condition.negated else relation
