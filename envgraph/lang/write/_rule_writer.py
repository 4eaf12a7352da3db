"""Write graphs, rules, units and derivations as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from typing import Final

from envgraph.code import dataclass
from envgraph.lang.write._term_writer import TermWriter, normalised_doc
from envgraph.metamodel import Annotation, Value
from envgraph.pattern import (
    Action,
    Alap,
    Applicable,
    AtomicStep,
    Constant,
    Constraint,
    CreateAction,
    DeleteEdge,
    DeleteNode,
    Derivation,
    EnumLiteral,
    Evaluation,
    Expression,
    IfStep,
    LeftSide,
    MergeAction,
    Modification,
    MoveAction,
    Negation,
    RedirectAction,
    Repeat,
    RetypeAction,
    RightSide,
    Rule,
    RuleBlock,
    RuleEdge,
    RuleNode,
    SetAction,
    Step,
    StepSequence as Steps,
    TryStep,
    TypeConstraint,
    Unit,
    UnitCall,
    UnitChoice,
    Variable,
)

# --- graphs


@dataclass(slots=True)
class NodeChain:
    """A path of nodes and arrows, `a : T -r-> b <-s- c`.

    Attributes:
        vertices: the nodes, in order.
        edges: the edges between neighbouring nodes; the bool is True if the edge leads forward.
    """

    vertices: list[RuleNode]
    edges: list[tuple[RuleEdge, bool]] = field(default_factory=list)

    def as_create(self) -> CreateAction:
        """Return the `CreateAction` action that the parser reads from `create` and this chain."""
        nodes: dict[str, RuleNode] = {}
        for vertex in self.vertices:
            if vertex.name != "_":
                nodes.setdefault(vertex.name, vertex)
        alone = tuple(self.vertices) if not self.edges else tuple(nodes.values())
        return CreateAction(alone, tuple(edge for edge, _ in self.edges))


class _ChainBuilder:
    """A builder of chains that contain all nodes and edges of a graph, in their order."""

    def __init__(self, nodes: Sequence[RuleNode], edges: Sequence[RuleEdge]) -> None:
        self.found: list[NodeChain] = []
        self._waiting = [*with_edge_ends(nodes, edges)]
        self._waiting.reverse()
        self._known: set[str] = set()
        for edge in edges:
            self._add_edge(edge)
        while self._waiting:
            self._declare_next_node()

    def _declare_next_node(self) -> None:
        node = self._waiting.pop()
        self._known.add(node.name)
        self.found.append(NodeChain([node]))

    def _are_next(self, names: Sequence[str]) -> bool:
        """Return True if the undeclared nodes among `names` are the next nodes to be declared, in this order."""
        new = [name for name in dict.fromkeys(names) if name != "_" and name not in self._known]
        return [node.name for node in self._waiting[: -len(new) - 1 : -1]] == new if new else True

    def _add_edge(self, edge: RuleEdge) -> None:
        ends = {edge.source, edge.target} - {"_"}
        while self._waiting and (self._waiting[-1].name == "_" or self._waiting[-1].name in self._known):
            self._declare_next_node()
        both = (edge.source, edge.target), (edge.target, edge.source)
        while not any(map(self._are_next, both)):
            self._declare_next_node()
        last = self.found[-1].vertices[-1] if self.found and self.found[-1].edges else None
        for forward, (first, second) in zip((True, False), both, strict=True):
            if last and first == last.name != "_" and self._are_next((second,)) and ends:
                self.found[-1].vertices.append(self._vertex(second))
                self.found[-1].edges.append((edge, forward))
                return
        forward = self._are_next(both[0])
        first, second = both[0] if forward else both[1]
        self.found.append(NodeChain([self._vertex(first), self._vertex(second)], [(edge, forward)]))

    def _vertex(self, name: str) -> RuleNode:
        if name == "_" or name in self._known:
            return RuleNode(name)
        self._known.add(name)
        return self._waiting.pop()


def node_chains(nodes: Sequence[RuleNode], edges: Sequence[RuleEdge]) -> list[NodeChain]:
    """Return chains of nodes and arrows that together write all nodes and edges of a graph, in their order."""
    return _ChainBuilder(nodes, edges).found


def with_edge_ends(nodes: Sequence[RuleNode], edges: Sequence[RuleEdge]) -> tuple[RuleNode, ...]:
    """Return the nodes, and a node for each end of an edge that is not among them, since an arrow mentions its ends."""
    known = {node.name: node for node in nodes}
    ends = {name: RuleNode(name) for edge in edges for name in (edge.source, edge.target) if name != "_"}
    return (*nodes, *(node for name, node in ends.items() if name not in known))


# --- text


class RuleWriter(TermWriter):
    """A writer of the text of one definition in a `.rules` file."""

    def format_definition(self, one: Rule | Unit | Derivation) -> str:
        """Return the text of a rule, unit or derivation with its doc comment and annotations."""
        marks = "".join(f"{self.format_annotation(mark)}\n" for mark in annotations_of(one))
        return self.format_doc_comment(one.doc) + marks + self._format_definition(one)

    def _format_definition(self, one: Rule | Unit | Derivation) -> str:
        match one:
            case Rule():
                parts = [
                    f"lhs {{ {self.format_left_side(one.left)} }}",
                    *map(self.format_block, one.blocks),
                    self.format_right_side(one.right),
                ]
                parameters = self.format_parameters(one.parameters) if one.parameters else ""
                return f"rule {self.format_name(one.name)}{parameters} {{\n{_joined_lines(parts)}}}"
            case Unit():
                parameters = self.format_parameters(one.parameters) if one.parameters else ""
                return (
                    f"unit {self.format_name(one.name)}{parameters} "
                    f"{{\n{_joined_lines(self.format_statements(one.body))}}}"
                )
            case Derivation(name, "retype"):
                classes = ", ".join(map(self.format_type_name, one.classes))
                return f"derive {self.format_name(name)} = retype among {{ {classes} }};"
        if len(one.classes) != 1:
            self.raise_unwritable(
                f"`{one.name}` derives operators for {len(one.classes)} classes, but must name one class"
            )
        return f"derive {self.format_name(one.name)} = operators for {self.format_type_name(one.classes[0])};"

    # --- graphs

    def _format_vertex(self, node: RuleNode) -> str:
        name = "_" if node.name.startswith("#") else self.format_name(node.name)
        if node.type is None:
            if node.assignments:
                self.raise_unwritable(f"the node `{node.name}` has values but no class")
            return name
        values = ", ".join(
            f"{self.format_name(one.feature)} = {self.format_values(one.value)}" for one in node.assignments
        )
        return f"{name} : {self.format_type_name(node.type)}" + (f" {{ {values} }}" if values else "")

    def format_values(self, value: Expression | tuple[Expression, ...]) -> str:
        """Return the text of an expression, or of a list of expressions as `[a, b]`."""
        return f"[{self.format_expressions(value)}]" if isinstance(value, tuple) else self.format_expression(value)

    def format_chain(self, chain: NodeChain) -> str:
        """Return the text of a chain: its nodes with arrows between them."""
        text = self._format_vertex(chain.vertices[0])
        for (edge, forward), vertex in zip(chain.edges, chain.vertices[1:], strict=True):
            reference = f"{self.format_name(edge.reference)}{edge.closure}"
            text += f" -{reference}-> " if forward else f" <-{reference}- "
            text += self._format_vertex(vertex)
        return text

    def format_edge(self, edge: RuleEdge) -> str:
        """Return the text of one edge with its two ends."""
        return self.format_chain(NodeChain([RuleNode(edge.source), RuleNode(edge.target)], [(edge, True)]))

    def format_left_side(self, left: LeftSide) -> str:
        """Return the contents of `lhs`, on one line; raise InvalidArgument if a node without a name is used twice."""
        found = node_chains(left.nodes, left.edges)
        hidden = [node.name for chain in found for node in chain.vertices if node.name.startswith("#")]
        if len(hidden) > len(set(hidden)):
            self.raise_unwritable("a node without a name is used more than once; give it a name")
        graph = [self.format_chain(chain) for chain in found]
        return " ".join(f"{one};" for one in (*graph, *map(self.format_condition, left.constraints)))

    def format_right_side(self, right: RightSide | Modification | None) -> str:
        """Return the text of `rhs` or `modify`; "" if `right` is None."""
        match right:
            case None:
                return ""
            case Modification(actions):
                return f"modify {{ {self.format_actions(actions)} }}"
        graph = "".join(f"{self.format_chain(chain)}; " for chain in node_chains(right.nodes, right.edges))
        return f"rhs {{ {graph}{self.format_actions(right.actions)} }}"

    def format_actions(self, actions: Iterable[Action]) -> str:
        """Return the text of all actions, on one line."""
        return " ".join(f"{self.format_action(action)};" for action in split_creates(actions))

    def format_action(self, action: Action) -> str:
        """Return the text of one action; a `CreateAction` must be a single chain."""
        match action:
            case CreateAction(nodes, edges):
                return f"create {self.format_chain(node_chains(nodes, edges)[0])}"
            case DeleteNode(node):
                return f"delete {self.format_name(node.name)}"
            case DeleteEdge(edge):
                return f"delete {self.format_edge(edge)}"
            case SetAction(owner, feature, operator, value):
                target = f"{self.format_name(owner.name)}.{self.format_name(feature)}"
                return f"set {target} {operator} {self.format_values(value)}"
            case RetypeAction(node, type_):
                return f"retype {self.format_name(node.name)} : {self.format_type_name(type_)}"
            case MoveAction(node, container, reference):
                place = f"{self.format_name(container.name)}.{self.format_name(reference)}"
                return f"move {self.format_name(node.name)} to {place}"
            case MergeAction(kept, absorbed):
                return f"merge {self.format_name(kept.name)} <- {self.format_name(absorbed.name)}"
            case RedirectAction(edge, target_):
                return f"redirect {self.format_edge(edge)} to {self.format_name(target_.name)}"

    def format_block(self, block: RuleBlock) -> str:
        """Return the text of a nested condition or nested rule."""
        left = self.format_left_side(block.left)
        if block.kind not in _CONDITION_KINDS and left:
            left = f"lhs {{ {left} }}"
        parts = [left, *map(self.format_block, block.blocks), self.format_right_side(block.right)]
        return f"{block.kind} {{ {' '.join(part for part in parts if part)} }}"

    # --- units

    def format_statements(self, step: Step) -> list[str]:
        """Return the statements of a step, one text for each."""
        match step:
            case Steps(steps):
                return [text for inner in steps for text in self.format_statements(inner)]
            case UnitChoice(alternatives):
                if not alternatives:
                    self.raise_unwritable("a choice has no alternatives")
                if len(alternatives) == 1 and not isinstance(alternatives[0], UnitCall):
                    self.raise_unwritable("a choice has only one alternative, which is a block")
                end = ";" if isinstance(alternatives[-1], UnitCall) else ""
                return [" | ".join(map(self._format_alternative, alternatives)) + end]
            case UnitCall():
                return [self._format_call(step) + ";"]
            case Alap(body):
                return [f"alap {self._format_block_of_steps(body)}"]
            case AtomicStep(body):
                return [f"atomic {self._format_block_of_steps(body)}"]
            case Repeat(lower, upper, body):
                bounds = (lower,) if lower == upper else (lower, upper)
                return [f"repeat {'..'.join(map(self._format_bound, bounds))} {self._format_block_of_steps(body)}"]
            case TryStep(body, otherwise):
                rest = f" else {self._format_block_of_steps(otherwise)}" if otherwise else ""
                return [f"try {self._format_block_of_steps(body)}{rest}"]
            case IfStep():
                return [self._format_if(step)]

    def _format_if(self, step: IfStep) -> str:
        condition = step.condition
        asked = (
            self._format_applicable(condition)
            if isinstance(condition, Applicable)
            else self.format_condition(condition)
        )
        text = f"if {asked} {self._format_block_of_steps(step.then)}"
        if step.otherwise is None:
            return text
        rest = (
            self._format_if(step.otherwise)
            if isinstance(step.otherwise, IfStep)
            else self._format_block_of_steps(step.otherwise)
        )
        return f"{text} else {rest}"

    def _format_applicable(self, asked: Applicable) -> str:
        simple = Variable | Constant | EnumLiteral
        terms = [self.format_term(one if isinstance(one, simple) else Evaluation(one)) for one in asked.arguments]
        arguments = f"({', '.join(terms)})" if terms else ""
        return f"{'neg ' if asked.negated else ''}{self.format_name(asked.name)}{arguments}"

    def _format_bound(self, bound: int | Expression) -> str:
        return str(bound) if isinstance(bound, int) else self.format_expression(bound, 1)

    def _format_alternative(self, step: Step) -> str:
        return self._format_call(step) if isinstance(step, UnitCall) else self._format_block_of_steps(step)

    def _format_call(self, step: UnitCall) -> str:
        arguments = f"({self.format_expressions(step.arguments)})" if step.arguments else ""
        which = f"top {step.limit} " if step.limit is not None else "all " if step.every else ""
        if step.first:
            which = "first "
        where = f" where {', '.join(map(self.format_condition, step.where))}" if step.where else ""
        by = f" by {self.format_expression(step.by)}" if step.by is not None else ""
        return f"{which}{self.format_dotted_name(step.name)}{arguments}{where}{by}"

    def _format_block_of_steps(self, step: Step) -> str:
        return f"{{ {' '.join(self.format_statements(step))} }}"


_CONDITION_KINDS: Final = ("not", "require")


def _joined_lines(parts: Iterable[str]) -> str:
    return "".join(f"{part}\n" for part in parts if part)


# --- what is read again


def split_creates(actions: Iterable[Action]) -> list[Action]:
    """Return the actions, with each `CreateAction` divided into one `CreateAction` for each chain."""
    found: list[Action] = []
    for action in actions:
        if isinstance(action, CreateAction):
            found += [chain.as_create() for chain in node_chains(action.nodes, action.edges)]
        else:
            found.append(action)
    return found


def annotations_of(one: Rule | Unit | Derivation) -> tuple[Annotation, ...]:
    """Return the annotations of a definition, completed by annotations for fields such as `weight` and `priority`.

    A rule built in Python may have a weight in its field, but no annotation for it.
    """
    found = [*one.annotations]
    wanted = {"weight": _annotations_stating(found, "weight", ((one.weight,),), ((1.0,),))}
    if not isinstance(one, Derivation):
        wanted["priority"] = _annotations_stating(found, "priority", ((one.priority,),), ((0,),))
    if isinstance(one, Rule):
        match = "injective" if one.injective else "homomorphic"
        wanted["semantics"] = _annotations_stating(found, "semantics", ((one.semantics,),), (("dpo",),))
        wanted["match"] = _annotations_stating(found, "match", ((match,),), (("injective",),))
        wanted["hom"] = _annotations_stating(found, "hom", one.homomorphic, ())
    result: list[Annotation] = []
    for annotation in found:
        result += wanted.pop(annotation.name, [] if annotation.name in _FIELD_ANNOTATIONS else [annotation])
    return (*result, *(annotation for rest in wanted.values() for annotation in rest))


_FIELD_ANNOTATIONS: Final = ("weight", "priority", "semantics", "match", "hom")


def _annotations_stating(
    annotations: Iterable[Annotation],
    name: str,
    required_arguments: Sequence[tuple[Value, ...]],
    defaults: Sequence[object],
) -> list[Annotation]:
    """Return the existing annotations `name` if they state the `required_arguments` arguments, else new annotations
    that do.

    `defaults` are the arguments that apply without any annotation.
    """
    known = [one for one in annotations if one.name == name]
    if (tuple(one.arguments for one in known if one.arguments) or defaults) == required_arguments:
        return known
    blank = known[0] if len(known) == len(required_arguments) == 1 else Annotation(name)
    return [replace(blank, arguments=arguments) for arguments in required_arguments]


def definition_as_read(one: Rule | Unit | Derivation) -> Rule | Unit | Derivation:
    """Return the definition as the parser would read it from its own text."""
    doc, annotations = normalised_doc(one.doc), annotations_of(one)
    match one:
        case Rule():
            return replace(
                one,
                doc=doc,
                annotations=annotations,
                left=left_side_as_read(one.left),
                blocks=tuple(map(block_as_read, one.blocks)),
                right=right_side_as_read(one.right),
            )
        case Unit():
            return replace(one, doc=doc, annotations=annotations, body=steps_as_read(one.body))
    return replace(one, doc=doc, annotations=annotations)


def left_side_as_read(left: LeftSide) -> LeftSide:
    """Return a left-hand side as the parser would read it from its own text."""
    return replace(left, nodes=with_edge_ends(left.nodes, left.edges))


def right_side_as_read(right: RightSide | Modification | None) -> RightSide | Modification | None:
    """Return the contents of `rhs` or `modify` as the parser would read them; None if there are none."""
    match right:
        case Modification(actions):
            return replace(right, actions=tuple(split_creates(actions)))
        case RightSide(nodes, edges):
            return replace(right, nodes=with_edge_ends(nodes, edges))
    return None


def block_as_read(block: RuleBlock) -> RuleBlock:
    """Return a nested condition or rule as the parser would read it from its own text."""
    blocks = tuple(map(block_as_read, block.blocks))
    return replace(block, left=left_side_as_read(block.left), blocks=blocks, right=right_side_as_read(block.right))


def steps_as_read(step: Step) -> Steps:
    """Return the block of a step as the parser would read it: one sequence without nested sequences."""
    parts = step.steps if isinstance(step, Steps) else (step,)
    return Steps(tuple(inner for part in parts for inner in _flattened_step(part)))


def _flattened_step(step: Step) -> tuple[Step, ...]:
    match step:
        case Steps():
            return steps_as_read(step).steps
        case UnitChoice((UnitCall() as only,)):
            return (only,)
        case UnitChoice(alternatives):
            again = (one if isinstance(one, UnitCall) else steps_as_read(one) for one in alternatives)
            return (UnitChoice(tuple(again)),)
        case Repeat(lower, upper, body):
            return (Repeat(_bound_as_read(lower), _bound_as_read(upper), steps_as_read(body)),)
        case Alap() | AtomicStep():
            return (replace(step, body=steps_as_read(step.body)),)
        case TryStep(body, otherwise):
            return (TryStep(steps_as_read(body), steps_as_read(otherwise) if otherwise else None),)
        case IfStep():
            return (_if_as_read(step),)
    return (step,)


def _bound_as_read(bound: int | Expression) -> int | Expression:
    if isinstance(bound, Constant) and type(bound.value) is int:
        return bound.value
    return bound


def _if_as_read(step: IfStep) -> IfStep:
    otherwise = step.otherwise
    if otherwise is not None:
        otherwise = _if_as_read(otherwise) if isinstance(otherwise, IfStep) else steps_as_read(otherwise)
    return IfStep(_condition_as_read(step.condition), steps_as_read(step.then), otherwise)


def _condition_as_read(condition: Constraint | Applicable) -> Constraint | Applicable:
    """Return the condition of an `if` as it is read: the parser takes a rule with one argument for a type condition."""
    if not isinstance(condition, Applicable) or len(condition.arguments) != 1:
        return condition
    (argument,) = condition.arguments
    term = argument if isinstance(argument, Variable | Constant | EnumLiteral) else Evaluation(argument)
    relation = TypeConstraint(condition.name, term)
    return Negation(relation) if condition.negated else relation
