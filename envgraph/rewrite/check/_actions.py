"""Translation of the right-hand side of a block into the objects and links that it creates, deletes and changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Note, Span
from envgraph.pattern import (
    Action,
    Create,
    DeleteEdge,
    DeleteNode,
    Edge,
    Merge,
    Modification,
    Move,
    Node,
    ObjectType,
    PatternCall,
    Redirect,
    Retype,
    RightSide,
    Rule,
    Set,
    StaticType,
    Variable,
    terms_in,
)
from envgraph.rewrite._plan import Absorb, Link, Rehome, Unlink
from envgraph.rewrite.check._assign import AssignmentReader
from envgraph.rewrite.check._lhs import LoweredBlock
from envgraph.rewrite.check._scope import LinkKey, ResolvedEdge, RuleScope
from envgraph.rewrite.check._variables import equated, is_named, node_names, path_edges


@dataclass(slots=True)
class Changes:
    """The changes that one block of a rule makes, by the names of variables.

    Attributes:
        rule: the whole rule.
        lowered: the LHS of the block.
        inherited: number of names that the enclosing block defines.
        scope: the names that can be used in the block; `scope.problems` collects the diagnostics.
        values: the assignments of the block.
        arrows: the links in the LHS of this block.
        created, retyped, deleted: names of objects, in the order of the text.
        spans: spans of creations and retypings, by the name of the object.
        gone: spans of deletions, by the name of the object.
        unlinks, links: links that are deleted and created.
        moves, absorbs: objects that get another container, and objects that are merged into others.
        kept: spans of merges, by the name of the object that survives.
        wanted: all links of an `rhs`.
        removed, redirected: the edges in the text that delete links and redirect links.
    """

    rule: Rule
    lowered: LoweredBlock
    inherited: int
    scope: RuleScope
    values: AssignmentReader
    arrows: list[ResolvedEdge]
    created: list[str] = field(default_factory=list)
    retyped: list[str] = field(default_factory=list)
    deleted: list[str] = field(default_factory=list)
    spans: dict[str, Span | None] = field(default_factory=dict)
    gone: dict[str, Span | None] = field(default_factory=dict)
    unlinks: dict[LinkKey, ResolvedEdge] = field(default_factory=dict)
    links: dict[LinkKey, ResolvedEdge] = field(default_factory=dict)
    moves: list[Rehome] = field(default_factory=list)
    absorbs: list[Absorb] = field(default_factory=list)
    kept: dict[str, Span | None] = field(default_factory=dict)
    wanted: dict[LinkKey, ResolvedEdge] = field(default_factory=dict)
    removed: dict[LinkKey, Edge] = field(default_factory=dict)
    redirected: dict[LinkKey, Edge] = field(default_factory=dict)

    @property
    def right(self) -> RightSide | Modification | None:
        """Return the right-hand side of the block, or None if it has no right-hand side."""
        return self.lowered.block.right if self.lowered.block else self.rule.right

    @property
    def ending(self) -> set[str]:
        """Return the names of the objects that this block or an enclosing block deletes, without merged objects."""
        return self.scope.deleted.keys() - self.scope.absorbed.keys()

    def unlink(self, edge: ResolvedEdge) -> Unlink:
        """Return the operation that deletes a link. A redirected link is required to exist if no LHS contains it."""
        key = self.scope.key(edge)
        required = key in self.redirected and all(self.scope.key(arrow) != key for arrow in self.scope.arrows)
        source, target = self.scope.slot(edge.source), self.scope.slot(edge.target)
        return Unlink(source, edge.reference, target, required, edge.span)

    def link(self, edge: ResolvedEdge) -> Link:
        """Return the operation that creates a link."""
        return Link(self.scope.slot(edge.source), edge.reference, self.scope.slot(edge.target), edge.span)


def changes_of(
    rule: Rule, lowered: LoweredBlock, outer: RuleScope, types: Mapping[str, StaticType | None]
) -> Changes:
    """Read the right-hand side of a block and return its changes. Diagnostics are added to `outer.problems`.

    `outer` is the scope of the enclosing block. `types` contains the types of the variables in the scope of this block.
    """
    for name in lowered.own:
        if name in outer.created:
            span = node_names(lowered.left).get(name)
            message = f"`{name}` is created by the enclosing rule"
            hint = "choose another name for one of the two: a new object is not part of a match"
            outer.error("duplicate-definition", message, span, hint)
    scope = outer.inner(types)
    left = lowered.left
    for node in left.nodes:
        if node.type:
            scope.declared.setdefault(node.name, set()).add(node.type)
    scope.equated |= equated(left)
    arrows = [edge for edge in map(scope.left_edge, left.edges) if edge]
    changes = Changes(rule, lowered, len(outer.names), scope, AssignmentReader(scope), arrows)
    scope.arrows.extend(arrows)
    scope.paths.update(map(scope.key, filter(None, map(scope.left_edge, path_edges(left)))))
    calls = (each for each in left.constraints if isinstance(each, PatternCall))
    scope.called += [{term.name for term in terms_in(c) if isinstance(term, Variable)} for c in calls]
    ActionReader(changes).read()
    return changes


class ActionReader:
    """A reader of the right-hand side of a block, which fills a `Changes`.

    It reads the names of created, retyped and deleted objects first, and then everything that refers to names. So the
    order of actions in the text does not matter.
    """

    def __init__(self, changes: Changes) -> None:
        self.changes = changes
        self.rule = changes.rule
        self.lowered = changes.lowered
        self.scope = changes.scope
        self.values = changes.values

    def read(self) -> None:
        """Read the whole right-hand side into the `Changes` of this reader."""
        match self.changes.right:
            case Modification() as right:
                self._modification(right)
            case RightSide() as right:
                self._right_side(right)
        self._clear_deleted()

    # --- names

    def _modification(self, right: Modification) -> None:
        mentioned = [node for action in right.actions if isinstance(action, Create) for node in action.nodes]
        for node in sorted(
            mentioned, key=lambda node: node.type is None
        ):  # nodes may be mentioned before the action that creates them
            self._new_or_known(node)
        for kinds in (Merge, Retype | DeleteNode, Create | DeleteEdge | Set | Move | Redirect):
            for action in right.actions:
                if isinstance(action, kinds):
                    self._act(action)

    def _act(self, action: Action) -> None:
        match action:
            case Merge():
                self._merge(action)
            case Retype():
                self._retype(action)
            case DeleteNode():
                self._delete(action.node.name, action.node.span or action.span)
            case Create():
                self._new_graph(action.nodes, action.edges)
            case DeleteEdge():
                self._delete_edge(action.edge)
            case Set():
                self.values.set(action)
            case Move():
                self._move(action)
            case Redirect():
                self._redirect(action)

    def _new_or_known(self, node: Node) -> None:
        if node.type is None:
            self.scope.knows(node.name, node.span)
        elif self.scope.sees(node.name):
            self.scope.error(
                "duplicate-definition",
                f"`{node.name}` exists already, so it cannot be created",
                node.span,
                f"`retype {node.name} : {node.type};` changes its class; a new object needs another name",
            )
        else:
            self._create(node)

    def _create(self, node: Node) -> None:
        assert node.type is not None
        name = node.name
        self.changes.spans[name] = node.span
        if not is_named(name):
            hint = "choose a name without a leading `_`: such a name stands for any value and cannot be used again"
            self.scope.error("bad-name", f"`{name}` cannot name a new object", node.span, hint)
        # The name becomes known even if its class has an error, so that each mistake is reported once.
        if self.scope.instantiable(node.type, node.type_span or node.span):
            self.scope.created[name] = node.type
        else:
            self.scope.types[name] = None
        self.changes.created.append(name)
        self.scope.add(name)

    def _retype(self, action: Retype) -> None:
        name, cls = action.node.name, action.type
        where = action.type_span or action.span
        if not self.scope.knows(
            name, action.node.span or action.span, matched=True
        ) or not self.scope.instantiable(cls, where):
            return
        if name in self.scope.created:
            message = f"`{name}` is created by this rule"
            self.scope.error("duplicate-definition", message, action.span, f"create it as `{name} : {cls}`")
        elif self.scope.was_object(name, action.node.span or action.span):
            if self.scope.retyped.get(name, cls) != cls:
                message = f"`{name}` cannot become both `{self.scope.retyped[name]}` and `{cls}`"
                self.scope.error("duplicate-action", message, where, "leave one of the two out")
            self.changes.spans[name] = where
            self.scope.retyped[name] = cls
            self.changes.retyped.append(name)

    def _delete(self, name: str, span: Span | None) -> None:
        if not self.scope.knows(name, span, matched=True) or not self.scope.was_object(name, span):
            return
        if name in self.scope.created:
            self.scope.error(
                "duplicate-action",
                f"`{name}` is created by this rule",
                span,
                "leave out the creation and the deletion",
            )
        elif name in self.scope.deleted:
            self.scope.warn(
                "duplicate-action", f"`{name}` is deleted already", span, "leave one deletion out"
            )
        elif name in self.changes.kept:
            message = f"`{name}` is both deleted and changed"
            notes = (Note("the other action is here", self.changes.kept[name]),)
            self.scope.problems.append(
                Diagnostic("contradiction", message, span, "leave one of the two out", notes=notes)
            )
        else:
            self.changes.gone[name] = span
            self.scope.deleted[name] = None
            self.changes.deleted.append(name)

    def _merge(self, action: Merge) -> None:
        kept, absorbed = action.kept.name, action.absorbed.name
        span = action.span
        if kept == absorbed:
            self.scope.error(
                "duplicate-action",
                f"`{kept}` cannot be merged with itself",
                span,
                "merge two different objects",
            )
        elif absorbed in self.scope.created:
            message = f"`{absorbed}` is created by this rule, so that there is nothing to merge"
            self.scope.error("duplicate-action", message, action.absorbed.span or span, "leave the merge out")
        elif all(
            [
                self.scope.is_object(v.name, v.span or span, matched=True)
                for v in (action.kept, action.absorbed)
            ]
        ):
            places = self.scope.slot(kept), self.scope.slot(absorbed), self.scope.add("")
            self.changes.absorbs.append(Absorb(*places, span))
            self.changes.kept[kept] = span
            self.scope.deleted[absorbed] = None
            self.scope.absorbed[absorbed] = None

    # --- `rhs`: the graph after the rule

    def _right_side(self, right: RightSide) -> None:
        kept = {**dict.fromkeys(node.name for node in right.nodes)}
        for edge in right.edges:
            kept.update({edge.source: None, edge.target: None})
        for node in right.nodes:
            self._right_node(node)
        self._omitted_nodes(right, kept)
        self._right_edges(right)
        for node in right.nodes:
            self._assignments(node)
        for action in right.actions:
            self._right_action(action, kept)

    def _right_node(self, node: Node) -> None:
        if not self.scope.sees(node.name):
            if node.type is None:
                self.scope.knows(node.name, node.span)
            else:
                self._create(node)
        elif node.type is not None and node.name in self.changes.created:
            self.scope.error(
                "duplicate-definition",
                f"`{node.name}` is created twice",
                node.span,
                "choose another name for one of them",
            )
        elif node.type is not None and node.type not in self._left_classes(node.name):
            self._retype(Retype(Variable(node.name, node.span), node.type, node.span, node.type_span))

    def _left_classes(self, name: str) -> set[str]:
        before = self.scope.before(name)
        return self.scope.declared.get(name) or ({before} if before else set())

    def _omitted_nodes(self, right: RightSide, kept: Mapping[str, None]) -> None:
        explicit = {a.node.name: a.span for a in right.actions if isinstance(a, DeleteNode)}
        context = {parameter.name for parameter in self.rule.parameters}
        for name, span in node_names(self.lowered.left).items():
            if name in kept or name in context or name not in self.lowered.own:
                continue
            if not isinstance(self.scope.types.get(name), ObjectType):
                continue
            self.changes.gone[name] = explicit.get(name, span)
            self.scope.deleted[name] = None
            self.changes.deleted.append(name)
            if name not in explicit:
                self.scope.warn(
                    "deletion-by-omission",
                    f"`{name}` is deleted, because the right side leaves it out",
                    span,
                    f"write `delete {name};` in the right side if that is meant, or name `{name}` there to keep it",
                )

    def _right_edges(self, right: RightSide) -> None:
        wanted = self.changes.wanted
        unclear = False
        for edge in right.edges:
            resolved = self.scope.edge(edge)
            if resolved:
                wanted[self.scope.key(resolved)] = resolved
            unclear |= resolved is None
        before = {self.scope.key(arrow): arrow for arrow in self.changes.arrows}
        if not unclear:
            self.changes.unlinks.update((key, arrow) for key, arrow in before.items() if key not in wanted)
        self.changes.links.update((key, edge) for key, edge in wanted.items() if key not in before)

    def _right_action(self, action: Action, kept: Mapping[str, None]) -> None:
        match action:
            case Set():
                self.values.set(action)
            case DeleteEdge():
                self._delete_edge(action.edge)
            case DeleteNode():
                name = action.node.name
                if name in kept:
                    message = f"`{name}` occurs in the right side, so it cannot be deleted"
                    hint = "remove it from the right side, or remove the deletion"
                    self.scope.error("duplicate-action", message, action.node.span or action.span, hint)
                elif name not in self.changes.deleted:
                    self._delete(name, action.node.span or action.span)
            case Create() | Retype() | Move() | Merge() | Redirect():
                word = type(action).__name__.lower()
                hint = "describe the graph after the rule, or use `modify { .. }`"
                self.scope.error(
                    "misplaced-action", f"`{word}` is allowed only in `modify`", action.span, hint
                )

    # --- links

    def _new_graph(self, nodes: Sequence[Node], edges: Sequence[Edge]) -> None:
        linked = {end for edge in edges for end in (edge.source, edge.target)}
        for node in nodes:
            given = node.type or node.assignments or node.name in linked
            if not given and self.scope.sees(node.name) and node.name not in self.scope.created:
                message = f"`{node.name}` exists already, so this creates nothing"
                self.scope.warn(
                    "no-creation",
                    message,
                    node.span,
                    "write `create name : Class;` for a new object, or remove this",
                )
        there = {self.scope.key(arrow) for arrow in self.scope.arrows}
        for edge in edges:
            resolved = self.scope.edge(edge)
            if resolved is None:
                continue
            key = self.scope.key(resolved)
            self.changes.links[key] = resolved
            if key in there:
                message = f"the left side has `{edge.source} -{edge.reference}-> {edge.target}`: this creates nothing"
                hint = "remove this, or link another object: two objects have at most one such link"
                self.scope.warn("existing-link", message, edge.span, hint)
        for node in nodes:
            self._assignments(node)

    def _delete_edge(self, edge: Edge) -> None:
        resolved = self.scope.edge(edge, before=True)
        if resolved is None:
            return
        key = self.scope.key(resolved)
        self._once(key, edge, "deleted")
        self.changes.unlinks[key] = resolved
        self.changes.removed[key] = edge

    def _once(self, key: LinkKey, edge: Edge, what: str) -> None:
        """Report a link that is deleted or redirected twice. `what` is the second action, "deleted" or "redirected"."""
        earlier = self.changes.redirected.get(key) or self.changes.removed.get(key)
        if earlier is None:
            return
        text = f"`{edge.source} -{edge.reference}-> {edge.target}`"
        notes = (Note("the first action is here", earlier.span),)
        if key not in self.changes.redirected and what == "deleted":
            self.scope.warn(
                "duplicate-action", f"{text} is deleted already", edge.span, "leave one deletion out"
            )
        else:
            word = "redirected" if key in self.changes.redirected else "deleted"
            message = f"{text} is {word} already, and cannot be {what} " + (
                "again" if word == what else "too"
            )
            found = Diagnostic(
                "duplicate-action", message, edge.span, "leave one of the two out", notes=notes
            )
            self.scope.problems.append(found)

    def _redirect(self, action: Redirect) -> None:
        edge = action.edge
        old = self.scope.edge(edge, before=True)
        new = self.scope.edge(replace(edge, target=action.target.name, target_span=action.target.span))
        if old and new:
            key = self.scope.key(old)
            self._once(key, edge, "redirected")
            self.changes.redirected[key] = edge
            self.changes.unlinks[key] = old
            self.changes.links[self.scope.key(new)] = new

    def _move(self, action: Move) -> None:
        node, container = action.node, action.container
        where = action.reference_span or action.span
        if not all([self.scope.is_object(v.name, v.span or action.span) for v in (node, container)]):
            return
        cls = self.scope.after(container.name)
        reference = self.scope.reference(cls, action.reference, where) if cls else None
        if reference is None or not self.scope.fits(node.name, reference, node.span or action.span):
            return
        if not reference.containment:
            hint = f"write `create {container.name} -{reference.name}-> {node.name};` to link them"
            self.scope.error(
                "not-a-containment",
                f"`{reference}` is not a containment, so `move` does not apply",
                where,
                hint,
            )
            return
        self.changes.moves.append(
            Rehome(self.scope.slot(node.name), self.scope.slot(container.name), reference, action.span)
        )

    def _assignments(self, node: Node) -> None:
        for assignment in node.assignments:
            if node.name in self.changes.created:
                self.values.initialise(node, assignment)
            elif self.scope.sees(node.name):
                owner = Variable(node.name, node.span)
                feature, value, span = assignment.feature, assignment.value, assignment.span
                self.values.set(Set(owner, feature, "=", value, span, feature_span=assignment.feature_span))

    def _clear_deleted(self) -> None:
        """Add deletions of the LHS links at deleted (not merged) objects, also of LHS links of enclosing blocks."""
        gone = self.changes.ending
        for arrow in self.scope.arrows:
            ends = {arrow.source, arrow.target}
            if ends & set(self.changes.deleted) or (arrow in self.changes.arrows and ends & gone):
                self.changes.unlinks.setdefault(self.scope.key(arrow), arrow)
