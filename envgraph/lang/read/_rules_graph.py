"""Parse the left-hand sides, right-hand sides and modifications of rules."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field, replace
from typing import Literal, cast

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.lang.read._expressions import value_of, variable_of
from envgraph.lang.read._query_conditions import closure_of, conditions_of
from envgraph.lang.read._reading import Reading, type_of, type_span_of
from envgraph.lang.syntax._parsing import tokens, trees
from envgraph.pattern import (
    Action,
    Assignment,
    Create,
    DeleteEdge,
    DeleteNode,
    Edge,
    LeftSide,
    Merge,
    Modification,
    Move,
    Node,
    Redirect,
    Retype,
    RightSide,
    Set,
)

_IN_MODIFY = ("retype", "move", "merge", "redirect")


@dataclass(slots=True)
class Graph:
    """The nodes and edges of a left- or right-hand side, in the order of the text.

    A node is stored once, with the type of its declaration; a second declaration is stored too, for the check of
    rules. Each `_` with several edges, or with an edge and a type, gets a unique name that no text can contain: `#1`.

    Attributes:
        left: True for a left-hand side, where `_` may match any object.
    """

    left: bool = False
    nodes: list[Node] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)
    _anonymous: int = 0

    def hide(self, node: Node) -> Node:
        """Return a copy of an anonymous node (`_`) with a unique name."""
        self._anonymous += 1
        return replace(node, name=f"#{self._anonymous}")

    def add(self, node: Node) -> None:
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


def left_side_of(reading: Reading, statements: Iterable[Tree[Token]], keyword: Token) -> LeftSide:
    """Parse the statements of an `lhs` or a condition block into one left-hand side; report values set in it."""
    graph = Graph(left=True)
    conditions: list[Tree[Token]] = []
    for statement in statements:
        if statement.data == "graph":
            read_graph(reading, statement, graph)
            _without_values(reading, statement)
        else:
            conditions.append(statement)
    constraints = conditions_of(reading, conditions)
    return LeftSide(tuple(graph.nodes), tuple(graph.edges), constraints, reading.span(keyword))


def _without_values(reading: Reading, graph: Tree[Token]) -> None:
    for vertex in trees(graph.children, "vertex"):
        for assignment in trees(vertex.children, "assignment"):
            name, feature = tokens(vertex.children)[0], tokens(assignment.children)[0]
            written = reading.text(assignment).partition("=")[2].strip()
            hint = f"write `check {name}.{feature} == {written};`"
            reading.error("misplaced-value", "a left-hand side cannot set values", assignment, hint)


def read_graph(reading: Reading, tree: Tree[Token], graph: Graph) -> None:
    """Parse `a -ref-> b : T -ref2-> c`, and add its nodes and edges to `graph`; report arrows without a reference."""
    vertices = trees(tree.children, "vertex")
    arrows = trees(tree.children, "forward", "backward", "half_arrow", "unnamed")
    names: list[str] = []
    for position, vertex in enumerate(vertices):
        node = _node(reading, vertex)
        joined = len(arrows[max(0, position - 1) : position + 1])
        says_more = joined > 1 or (joined == 1 and node.type is not None)
        if node.name == "_" and says_more and graph.left:
            node = graph.hide(node)
        names.append(node.name)
        if node.name != "_":
            graph.add(node)
        elif says_more:
            hint = "write a name in place of `_`, because each `_` is a different object"
            reading.error(
                "anonymous-node",
                "a `_` with several edges, or with an edge and a class, needs a name",
                vertex,
                hint,
            )
            reading.gap(vertex)
        elif not joined:
            graph.nodes.append(node)
    for position, arrow in enumerate(arrows):
        ends = vertices[position : position + 2]
        if len(ends) == 2:
            edge = _edge(reading, arrow, ends, names[position : position + 2])
            graph.edges.extend([edge] if edge else [])


def _node(reading: Reading, vertex: Tree[Token]) -> Node:
    name = tokens(vertex.children)[0]
    type_ = next(iter(trees(vertex.children, "type")), None)
    return Node(
        str(name),
        type_of(reading, type_) if type_ else None,
        tuple(_assignment(reading, part) for part in trees(vertex.children, "assignment")),
        reading.span(name),
        type_span=type_span_of(reading, type_) if type_ else None,
    )


def _assignment(reading: Reading, tree: Tree[Token]) -> Assignment:
    feature = tokens(tree.children)[0]
    value = value_of(reading, trees(tree.children)[0])
    return Assignment(str(feature), value, reading.span(tree), feature_span=reading.span(feature))


def _edge(
    reading: Reading, arrow: Tree[Token], vertices: Sequence[Tree[Token]], names: Sequence[str]
) -> Edge | None:
    left, right = (tokens(vertex.children)[0] for vertex in vertices)
    ends = list(zip(names, (left, right), strict=True))
    if arrow.data == "unnamed":
        hint = f"write `{left} -reference-> {right}`"
        reading.error("unnamed-arrow", "the arrow does not name a reference", arrow, hint)
        reading.gap(arrow)
        return None
    if arrow.data == "backward":
        ends.reverse()
    reference = tokens(arrow.children, "NAME")[0]
    if arrow.data == "half_arrow":
        before = reading.span(reference)
        hint = f"write `-{reading.text(arrow)}`"
        reading.error("missing-token", "missing `-`", before.source.span(before.start, before.start), hint)
    (source, source_token), (target, target_token) = ends
    return Edge(
        str(source),
        str(reference),
        str(target),
        closure_of(arrow).value,
        reading.span(left).to(reading.span(right)),
        source_span=reading.span(source_token),
        reference_span=reading.span(reference),
        target_span=reading.span(target_token),
    )


# --- right sides ---


def right_side_of(reading: Reading, tree: Tree[Token]) -> RightSide:
    """Parse `rhs { .. }`; report actions that are allowed only in `modify`. Of these, only `create` is still parsed."""
    graph = Graph()
    actions: list[Action] = []
    for statement in trees(tree.children):
        if statement.data == "graph":
            read_graph(reading, statement, graph)
        elif statement.data == "create":
            hint = "remove `create`: nodes and edges that the left-hand side lacks are created"
            reading.error(
                "misplaced-action", "`create` is allowed in `modify`, not in `rhs`", statement, hint
            )
            read_graph(reading, trees(statement.children)[0], graph)
        elif statement.data in _IN_MODIFY:
            hint = "replace `rhs` by `modify`, and write only the changes"
            message = f"`{statement.data}` is allowed in `modify`, not in `rhs`"
            reading.error("misplaced-action", message, statement, hint)
            reading.gap(statement)
        else:
            actions.extend(_ACTIONS[statement.data](reading, statement))
    keyword = reading.span(tokens(tree.children)[0])
    return RightSide(tuple(graph.nodes), tuple(graph.edges), tuple(actions), keyword)


def modification_of(reading: Reading, tree: Tree[Token]) -> Modification:
    """Parse `modify { .. }`; report and leave out nodes and edges that are written without an action."""
    actions: list[Action] = []
    for statement in trees(tree.children):
        if statement.data == "graph":
            hint = f"write `create {reading.text(statement)};`, or replace `modify` by `rhs`"
            reading.error("misplaced-graph", "`modify` contains actions, not a graph", statement, hint)
            reading.gap(statement)
        else:
            actions.extend(_ACTIONS[statement.data](reading, statement))
    return Modification(tuple(actions), reading.span(tokens(tree.children)[0]))


def _create(reading: Reading, tree: Tree[Token]) -> list[Action]:
    graph = Graph()
    read_graph(reading, trees(tree.children)[0], graph)
    return [Create(tuple(graph.nodes), tuple(graph.edges), reading.span(tree))]


def _delete(reading: Reading, tree: Tree[Token]) -> list[Action]:
    part = trees(tree.children)[0]
    graph = Graph()
    read_graph(reading, _plain(reading, part, "delete"), graph)
    if len(trees(part.children, "vertex")) > 1:
        return [DeleteEdge(edge, reading.span(tree)) for edge in graph.edges]
    name = tokens(trees(part.children)[0].children)[0]
    return [DeleteNode(variable_of(reading, name), reading.span(tree))]


def _plain(reading: Reading, graph: Tree[Token], word: str) -> Tree[Token]:
    """Return the graph without classes and values; report each class, which the action `word` does not allow."""
    for vertex in trees(graph.children, "vertex"):
        for part in trees(vertex.children, "type"):
            message = f"`{word}` takes no class"
            hint = f"write only `{tokens(vertex.children)[0]}`; the class belongs in the left-hand side"
            reading.error("misplaced-class", message, part, hint)
    bare = [
        Tree("vertex", [part.children[0]], part.meta) if part.data == "vertex" else part
        for part in trees(graph.children)
    ]
    return Tree("graph", [*bare], graph.meta)


def _set(reading: Reading, tree: Tree[Token]) -> list[Action]:
    owner, *features = tokens(tree.children)
    operator = tokens(trees(tree.children, "assigning")[0].children)[0]
    if operator == "==":
        reading.error("unexpected-token", "`==` is a comparison, not an assignment", operator, "write `=`")
        operator = operator.update(value="=")
    value = value_of(reading, trees(tree.children)[1])
    if len(features) > 1:
        path = ".".join((owner, *features[:-1]))
        hint = f"bind `{path}` to a variable in the left-hand side"
        reading.error(
            "long-path", "`set` takes a feature of a variable, not a longer path", features[1], hint
        )
        reading.gap(tree)
        return []
    return [
        Set(
            variable_of(reading, owner),
            str(features[0]),
            cast("Literal['=', '+=', '-=']", str(operator)),
            value,
            reading.span(tree),
            feature_span=reading.span(features[0]),
        )
    ]


def _retype(reading: Reading, tree: Tree[Token]) -> list[Action]:
    type_ = trees(tree.children)[0]
    return [
        Retype(
            variable_of(reading, tokens(tree.children)[0]),
            type_of(reading, type_),
            reading.span(tree),
            type_span=type_span_of(reading, type_),
        )
    ]


def _move(reading: Reading, tree: Tree[Token]) -> list[Action]:
    node, container, *references = tokens(tree.children)
    if len(references) != 1:
        hint = f"write `move {node} to {container}.reference`"
        message = "`move` needs one reference of one container"
        reading.error("long-path" if references else "missing-reference", message, tree, hint)
        reading.gap(tree)
        return []
    return [
        Move(
            variable_of(reading, node),
            variable_of(reading, container),
            str(references[0]),
            reading.span(tree),
            reference_span=reading.span(references[0]),
        )
    ]


def _merge(reading: Reading, tree: Tree[Token]) -> list[Action]:
    kept, absorbed = (variable_of(reading, name) for name in tokens(tree.children))
    return [Merge(kept, absorbed, reading.span(tree))]


def _redirect(reading: Reading, tree: Tree[Token]) -> list[Action]:
    part = trees(tree.children)[0]
    graph = Graph()
    read_graph(reading, _plain(reading, part, "redirect"), graph)
    target = variable_of(reading, tokens(tree.children)[0])
    if len(trees(part.children, "vertex")) != 2:
        hint = f"write `redirect a -reference-> b to {target.name}`"
        reading.error("wrong-arity", "`redirect` takes one arrow", part, hint)
        reading.gap(tree)
        return []
    return [Redirect(edge, target, reading.span(tree)) for edge in graph.edges]


_ACTIONS: Mapping[str, Callable[[Reading, Tree[Token]], list[Action]]] = {
    "create": _create,
    "delete": _delete,
    "set": _set,
    "retype": _retype,
    "move": _move,
    "merge": _merge,
    "redirect": _redirect,
}
