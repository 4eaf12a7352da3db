"""Parse the left-hand sides, right-hand sides and modifications of rules."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field, replace
from typing import Literal, cast

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.lang.read._expression_parser import parse_assigned_value, parse_variable
from envgraph.lang.read._file_reading import FileReading, resolve_type, type_name_span
from envgraph.lang.read._query_conditions import parse_closure, parse_conditions
from envgraph.lang.syntax._parser import select_tokens, select_trees
from envgraph.pattern import (
    Action,
    Assignment,
    CreateAction,
    DeleteEdge,
    DeleteNode,
    LeftSide,
    MergeAction,
    Modification,
    MoveAction,
    RedirectAction,
    RetypeAction,
    RightSide,
    RuleEdge,
    RuleNode,
    SetAction,
)

_IN_MODIFY = ("retype", "move", "merge", "redirect")


@dataclass(slots=True)
class RuleGraph:
    """The nodes and edges of a left- or right-hand side, in the order of the text.

    A node is stored once, with the type of its declaration; a second declaration is stored too, for the check of
    rules. Each `_` with several edges, or with an edge and a type, gets a unique name that no text can contain: `#1`.

    Attributes:
        is_left_side: True for a left-hand side, where `_` may match any object.
    """

    is_left_side: bool = False
    nodes: list[RuleNode] = field(default_factory=list)
    edges: list[RuleEdge] = field(default_factory=list)
    _anonymous: int = 0

    def name_anonymous(self, node: RuleNode) -> RuleNode:
        """Return a copy of an anonymous node (`_`) with a unique name."""
        self._anonymous += 1
        return replace(node, name=f"#{self._anonymous}")

    def add_node(self, node: RuleNode) -> None:
        """Add a node that is new, or that declares a second type. Ignore a known node without a type.

        If a node of this name is known without a type, replace it by the node with a type.
        """
        places = [index for index, known in enumerate(self.nodes) if known.name == node.name]
        if not places:
            self.nodes.append(node)
        elif node.type is not None and self.nodes[places[0]].type is None:
            self.nodes[places[0]] = node
        elif node.type is not None:
            self.nodes.append(node)


def parse_left_side(reading: FileReading, statements: Iterable[Tree[Token]], keyword: Token) -> LeftSide:
    """Parse the statements of an `lhs` or a condition block into one left-hand side; report values set in it."""
    graph = RuleGraph(is_left_side=True)
    conditions: list[Tree[Token]] = []
    for statement in statements:
        if statement.data == "graph":
            parse_graph(reading, statement, graph)
            _report_values(reading, statement)
        else:
            conditions.append(statement)
    constraints = parse_conditions(reading, conditions)
    return LeftSide(tuple(graph.nodes), tuple(graph.edges), constraints, reading.span(keyword))


def _report_values(reading: FileReading, graph: Tree[Token]) -> None:
    for vertex in select_trees(graph.children, "vertex"):
        for assignment in select_trees(vertex.children, "assignment"):
            name, feature = select_tokens(vertex.children)[0], select_tokens(assignment.children)[0]
            written = reading.text(assignment).partition("=")[2].strip()
            hint = f"write `check {name}.{feature} == {written};`"
            reading.error("misplaced-value", "a left-hand side cannot set values", assignment, hint)


def parse_graph(reading: FileReading, tree: Tree[Token], graph: RuleGraph) -> None:
    """Parse `a -ref-> b : T -ref2-> c`, and add its nodes and edges to `graph`; report arrows without a reference."""
    vertices = select_trees(tree.children, "vertex")
    arrows = select_trees(tree.children, "forward", "backward", "half_arrow", "unnamed")
    names: list[str] = []
    for position, vertex in enumerate(vertices):
        node = _parse_node(reading, vertex)
        joined = len(arrows[max(0, position - 1) : position + 1])
        says_more = joined > 1 or (joined == 1 and node.type is not None)
        if node.name == "_" and says_more and graph.is_left_side:
            node = graph.name_anonymous(node)
        names.append(node.name)
        if node.name != "_":
            graph.add_node(node)
        elif says_more:
            hint = "write a name in place of `_`, because each `_` is a different object"
            reading.error(
                "anonymous-node",
                "a `_` with several edges, or with an edge and a class, needs a name",
                vertex,
                hint,
            )
            reading.record_gap(vertex)
        elif not joined:
            graph.nodes.append(node)
    for position, arrow in enumerate(arrows):
        ends = vertices[position : position + 2]
        if len(ends) == 2:
            edge = _parse_edge(reading, arrow, ends, names[position : position + 2])
            graph.edges.extend([edge] if edge else [])


def _parse_node(reading: FileReading, vertex: Tree[Token]) -> RuleNode:
    name = select_tokens(vertex.children)[0]
    type_ = next(iter(select_trees(vertex.children, "type")), None)
    return RuleNode(
        str(name),
        resolve_type(reading, type_) if type_ else None,
        tuple(_parse_assignment(reading, part) for part in select_trees(vertex.children, "assignment")),
        reading.span(name),
        type_span=type_name_span(reading, type_) if type_ else None,
    )


def _parse_assignment(reading: FileReading, tree: Tree[Token]) -> Assignment:
    feature = select_tokens(tree.children)[0]
    value = parse_assigned_value(reading, select_trees(tree.children)[0])
    return Assignment(str(feature), value, reading.span(tree), feature_span=reading.span(feature))


def _parse_edge(
    reading: FileReading, arrow: Tree[Token], vertices: Sequence[Tree[Token]], names: Sequence[str]
) -> RuleEdge | None:
    left, right = (select_tokens(vertex.children)[0] for vertex in vertices)
    ends = list(zip(names, (left, right), strict=True))
    if arrow.data == "unnamed":
        hint = f"write `{left} -reference-> {right}`"
        reading.error("unnamed-arrow", "the arrow does not name a reference", arrow, hint)
        reading.record_gap(arrow)
        return None
    if arrow.data == "backward":
        ends.reverse()
    reference = select_tokens(arrow.children, "NAME")[0]
    if arrow.data == "half_arrow":
        before = reading.span(reference)
        hint = f"write `-{reading.text(arrow)}`"
        reading.error("missing-token", "missing `-`", before.source.span_between(before.start, before.start), hint)
    (source, source_token), (target, target_token) = ends
    return RuleEdge(
        str(source),
        str(reference),
        str(target),
        parse_closure(arrow).value,
        reading.span(left).joined_with(reading.span(right)),
        source_span=reading.span(source_token),
        reference_span=reading.span(reference),
        target_span=reading.span(target_token),
    )


# --- right sides ---


def parse_right_side(reading: FileReading, tree: Tree[Token]) -> RightSide:
    """Parse `rhs { .. }`; report actions that are allowed only in `modify`. Of these, only `create` is still parsed."""
    graph = RuleGraph()
    actions: list[Action] = []
    for statement in select_trees(tree.children):
        if statement.data == "graph":
            parse_graph(reading, statement, graph)
        elif statement.data == "create":
            hint = "remove `create`: nodes and edges that the left-hand side lacks are created"
            reading.error("misplaced-action", "`create` is allowed in `modify`, not in `rhs`", statement, hint)
            parse_graph(reading, select_trees(statement.children)[0], graph)
        elif statement.data in _IN_MODIFY:
            hint = "replace `rhs` by `modify`, and write only the changes"
            message = f"`{statement.data}` is allowed in `modify`, not in `rhs`"
            reading.error("misplaced-action", message, statement, hint)
            reading.record_gap(statement)
        else:
            actions.extend(_ACTION_PARSERS[statement.data](reading, statement))
    keyword = reading.span(select_tokens(tree.children)[0])
    return RightSide(tuple(graph.nodes), tuple(graph.edges), tuple(actions), keyword)


def parse_modification(reading: FileReading, tree: Tree[Token]) -> Modification:
    """Parse `modify { .. }`; report and leave out nodes and edges that are written without an action."""
    actions: list[Action] = []
    for statement in select_trees(tree.children):
        if statement.data == "graph":
            hint = f"write `create {reading.text(statement)};`, or replace `modify` by `rhs`"
            reading.error("misplaced-graph", "`modify` contains actions, not a graph", statement, hint)
            reading.record_gap(statement)
        else:
            actions.extend(_ACTION_PARSERS[statement.data](reading, statement))
    return Modification(tuple(actions), reading.span(select_tokens(tree.children)[0]))


def _parse_create(reading: FileReading, tree: Tree[Token]) -> list[Action]:
    graph = RuleGraph()
    parse_graph(reading, select_trees(tree.children)[0], graph)
    return [CreateAction(tuple(graph.nodes), tuple(graph.edges), reading.span(tree))]


def _parse_delete(reading: FileReading, tree: Tree[Token]) -> list[Action]:
    part = select_trees(tree.children)[0]
    graph = RuleGraph()
    parse_graph(reading, _strip_classes(reading, part, "delete"), graph)
    if len(select_trees(part.children, "vertex")) > 1:
        return [DeleteEdge(edge, reading.span(tree)) for edge in graph.edges]
    name = select_tokens(select_trees(part.children)[0].children)[0]
    return [DeleteNode(parse_variable(reading, name), reading.span(tree))]


def _strip_classes(reading: FileReading, graph: Tree[Token], word: str) -> Tree[Token]:
    """Return the graph without classes and values; report each class, which the action `word` does not allow."""
    for vertex in select_trees(graph.children, "vertex"):
        for part in select_trees(vertex.children, "type"):
            message = f"`{word}` takes no class"
            hint = f"write only `{select_tokens(vertex.children)[0]}`; the class belongs in the left-hand side"
            reading.error("misplaced-class", message, part, hint)
    bare = [
        Tree("vertex", [part.children[0]], part.meta) if part.data == "vertex" else part
        for part in select_trees(graph.children)
    ]
    return Tree("graph", [*bare], graph.meta)


def _parse_set(reading: FileReading, tree: Tree[Token]) -> list[Action]:
    owner, *features = select_tokens(tree.children)
    operator = select_tokens(select_trees(tree.children, "assigning")[0].children)[0]
    if operator == "==":
        reading.error("unexpected-token", "`==` is a comparison, not an assignment", operator, "write `=`")
        operator = operator.update(value="=")
    value = parse_assigned_value(reading, select_trees(tree.children)[1])
    if len(features) > 1:
        path = ".".join((owner, *features[:-1]))
        hint = f"bind `{path}` to a variable in the left-hand side"
        reading.error("long-path", "`set` takes a feature of a variable, not a longer path", features[1], hint)
        reading.record_gap(tree)
        return []
    return [
        SetAction(
            parse_variable(reading, owner),
            str(features[0]),
            cast("Literal['=', '+=', '-=']", str(operator)),
            value,
            reading.span(tree),
            feature_span=reading.span(features[0]),
        )
    ]


def _parse_retype(reading: FileReading, tree: Tree[Token]) -> list[Action]:
    type_ = select_trees(tree.children)[0]
    return [
        RetypeAction(
            parse_variable(reading, select_tokens(tree.children)[0]),
            resolve_type(reading, type_),
            reading.span(tree),
            type_span=type_name_span(reading, type_),
        )
    ]


def _parse_move(reading: FileReading, tree: Tree[Token]) -> list[Action]:
    node, container, *references = select_tokens(tree.children)
    if len(references) != 1:
        hint = f"write `move {node} to {container}.reference`"
        message = "`move` needs one reference of one container"
        reading.error("long-path" if references else "missing-reference", message, tree, hint)
        reading.record_gap(tree)
        return []
    return [
        MoveAction(
            parse_variable(reading, node),
            parse_variable(reading, container),
            str(references[0]),
            reading.span(tree),
            reference_span=reading.span(references[0]),
        )
    ]


def _parse_merge(reading: FileReading, tree: Tree[Token]) -> list[Action]:
    kept, absorbed = (parse_variable(reading, name) for name in select_tokens(tree.children))
    return [MergeAction(kept, absorbed, reading.span(tree))]


def _parse_redirect(reading: FileReading, tree: Tree[Token]) -> list[Action]:
    part = select_trees(tree.children)[0]
    graph = RuleGraph()
    parse_graph(reading, _strip_classes(reading, part, "redirect"), graph)
    target = parse_variable(reading, select_tokens(tree.children)[0])
    if len(select_trees(part.children, "vertex")) != 2:
        hint = f"write `redirect a -reference-> b to {target.name}`"
        reading.error("wrong-arity", "`redirect` takes one arrow", part, hint)
        reading.record_gap(tree)
        return []
    return [RedirectAction(edge, target, reading.span(tree)) for edge in graph.edges]


_ACTION_PARSERS: Mapping[str, Callable[[FileReading, Tree[Token]], list[Action]]] = {
    "create": _parse_create,
    "delete": _parse_delete,
    "set": _parse_set,
    "retype": _parse_retype,
    "move": _parse_move,
    "merge": _parse_merge,
    "redirect": _parse_redirect,
}
