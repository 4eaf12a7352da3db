"""Translation of the right-hand side of a block into the objects and links that it creates, deletes and changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace

from envgraph.code import dataclass
from envgraph.errors import Note, Span
from envgraph.pattern import (
    Action,
    CreateAction,
    DeleteEdge,
    DeleteNode,
    MergeAction,
    Modification,
    MoveAction,
    ObjectType,
    PatternCall,
    RedirectAction,
    RetypeAction,
    RightSide,
    Rule,
    RuleEdge,
    RuleNode,
    SetAction,
    StaticType,
    Variable,
    constraint_terms,
)
from envgraph.rewrite._rule_plan import AddLink, MergeObjects, MoveToContainer, RemoveLink
from envgraph.rewrite.check._assignments import AssignmentReader
from envgraph.rewrite.check._lhs_and_nac import LoweredBlock
from envgraph.rewrite.check._lhs_variables import equated_pairs, is_named, node_names, path_edges
from envgraph.rewrite.check._rule_scope import LinkKey, ResolvedEdge, RuleScope


@dataclass(slots=True)
class BlockChanges:
    """The changes that one block of a rule makes, by the names of variables.

    Attributes:
        rule: the whole rule.
        lowered: the LHS of the block.
        inherited_count: number of names that the enclosing block defines.
        scope: the names that can be used in the block; `scope.problems` collects the diagnostics.
        assignments: the assignments of the block.
        lhs_edges: the links in the LHS of this block.
        created, retyped, deleted: names of objects, in the order of the text.
        change_spans: spans of creations and retypings, by the name of the object.
        deletion_spans: spans of deletions, by the name of the object.
        unlinks, links: links that are deleted and created.
        moves, absorbs: objects that get another container, and objects that are merged into others.
        merge_spans: spans of merges, by the name of the object that survives.
        rhs_links: all links of an `rhs`.
        deleted_edges, redirected_edges: the edges in the text that delete links and redirect links.
    """

    rule: Rule
    lowered: LoweredBlock
    inherited_count: int
    scope: RuleScope
    assignments: AssignmentReader
    lhs_edges: list[ResolvedEdge]
    created: list[str] = field(default_factory=list)
    retyped: list[str] = field(default_factory=list)
    deleted: list[str] = field(default_factory=list)
    change_spans: dict[str, Span | None] = field(default_factory=dict)
    deletion_spans: dict[str, Span | None] = field(default_factory=dict)
    unlinks: dict[LinkKey, ResolvedEdge] = field(default_factory=dict)
    links: dict[LinkKey, ResolvedEdge] = field(default_factory=dict)
    moves: list[MoveToContainer] = field(default_factory=list)
    absorbs: list[MergeObjects] = field(default_factory=list)
    merge_spans: dict[str, Span | None] = field(default_factory=dict)
    rhs_links: dict[LinkKey, ResolvedEdge] = field(default_factory=dict)
    deleted_edges: dict[LinkKey, RuleEdge] = field(default_factory=dict)
    redirected_edges: dict[LinkKey, RuleEdge] = field(default_factory=dict)

    @property
    def right_side(self) -> RightSide | Modification | None:
        """Return the right-hand side of the block, or None if it has no right-hand side."""
        return self.lowered.block.right if self.lowered.block else self.rule.right

    @property
    def deleted_without_merged(self) -> set[str]:
        """Return the names of the objects that this block or an enclosing block deletes, without merged objects."""
        return self.scope.deleted.keys() - self.scope.absorbed.keys()

    def unlink_operation(self, edge: ResolvedEdge) -> RemoveLink:
        """Return the operation that deletes a link. A redirected link is required to exist if no LHS contains it."""
        key = self.scope.link_key(edge)
        required = key in self.redirected_edges and all(
            self.scope.link_key(arrow) != key for arrow in self.scope.lhs_edges
        )
        source, target = self.scope.slot_of(edge.source), self.scope.slot_of(edge.target)
        return RemoveLink(source, edge.reference, target, required, edge.span)

    def link_operation(self, edge: ResolvedEdge) -> AddLink:
        """Return the operation that creates a link."""
        return AddLink(self.scope.slot_of(edge.source), edge.reference, self.scope.slot_of(edge.target), edge.span)


def read_changes(
    rule: Rule, lowered: LoweredBlock, outer: RuleScope, types: Mapping[str, StaticType | None]
) -> BlockChanges:
    """Read the right-hand side of a block and return its changes. Diagnostics are added to `outer.problems`.

    `outer` is the scope of the enclosing block. `types` contains the types of the variables in the scope of this block.
    """
    for name in lowered.own_variables:
        if name in outer.created:
            span = node_names(lowered.left).get(name)
            message = f"`{name}` is created by the enclosing rule"
            hint = "choose another name for one of the two: a new object is not part of a match"
            outer.error("duplicate-definition", message, span, hint)
    scope = outer.nested_scope(types)
    left = lowered.left
    for node in left.nodes:
        if node.type:
            scope.declared.setdefault(node.name, set()).add(node.type)
    scope.equated |= equated_pairs(left)
    arrows = [edge for edge in map(scope.resolve_lhs_edge, left.edges) if edge]
    changes = BlockChanges(rule, lowered, len(outer.names), scope, AssignmentReader(scope), arrows)
    scope.lhs_edges.extend(arrows)
    scope.lhs_path_links.update(map(scope.link_key, filter(None, map(scope.resolve_lhs_edge, path_edges(left)))))
    calls = (each for each in left.constraints if isinstance(each, PatternCall))
    scope.call_variables += [{term.name for term in constraint_terms(c) if isinstance(term, Variable)} for c in calls]
    ActionReader(changes).read()
    return changes


class ActionReader:
    """A reader of the right-hand side of a block, which fills a `BlockChanges`.

    It reads the names of created, retyped and deleted objects first, and then everything that refers to names. So the
    order of actions in the text does not matter.
    """

    def __init__(self, changes: BlockChanges) -> None:
        self.changes = changes
        self.rule = changes.rule
        self.lowered = changes.lowered
        self.scope = changes.scope
        self.assignments = changes.assignments

    def read(self) -> None:
        """Read the whole right-hand side into the `BlockChanges` of this reader."""
        match self.changes.right_side:
            case Modification() as right:
                self._read_modification(right)
            case RightSide() as right:
                self._read_rhs(right)
        self._unlink_deleted()

    # --- names

    def _read_modification(self, right: Modification) -> None:
        mentioned = [node for action in right.actions if isinstance(action, CreateAction) for node in action.nodes]
        for node in sorted(
            mentioned, key=lambda node: node.type is None
        ):  # nodes may be mentioned before the action that creates them
            self._check_created_node(node)
        for kinds in (
            MergeAction,
            RetypeAction | DeleteNode,
            CreateAction | DeleteEdge | SetAction | MoveAction | RedirectAction,
        ):
            for action in right.actions:
                if isinstance(action, kinds):
                    self._read_action(action)

    def _read_action(self, action: Action) -> None:
        match action:
            case MergeAction():
                self._read_merge(action)
            case RetypeAction():
                self._read_retype(action)
            case DeleteNode():
                self._read_deletion(action.node.name, action.node.span or action.span)
            case CreateAction():
                self._read_create(action.nodes, action.edges)
            case DeleteEdge():
                self._read_edge_deletion(action.edge)
            case SetAction():
                self.assignments.read_set(action)
            case MoveAction():
                self._read_move(action)
            case RedirectAction():
                self._read_redirect(action)

    def _check_created_node(self, node: RuleNode) -> None:
        if node.type is None:
            self.scope.check_in_scope(node.name, node.span)
        elif self.scope.is_in_scope(node.name):
            self.scope.error(
                "duplicate-definition",
                f"`{node.name}` exists already, so it cannot be created",
                node.span,
                f"`retype {node.name} : {node.type};` changes its class; a new object needs another name",
            )
        else:
            self._add_created(node)

    def _add_created(self, node: RuleNode) -> None:
        assert node.type is not None
        name = node.name
        self.changes.change_spans[name] = node.span
        if not is_named(name):
            hint = "choose a name without a leading `_`: such a name stands for any value and cannot be used again"
            self.scope.error("bad-name", f"`{name}` cannot name a new object", node.span, hint)
        # The name becomes known even if its class has an error, so that each mistake is reported once.
        if self.scope.check_instantiable(node.type, node.type_span or node.span):
            self.scope.created[name] = node.type
        else:
            self.scope.types[name] = None
        self.changes.created.append(name)
        self.scope.add_slot(name)

    def _read_retype(self, action: RetypeAction) -> None:
        name, cls = action.node.name, action.type
        where = action.type_span or action.span
        if not self.scope.check_in_scope(
            name, action.node.span or action.span, matched=True
        ) or not self.scope.check_instantiable(cls, where):
            return
        if name in self.scope.created:
            message = f"`{name}` is created by this rule"
            self.scope.error("duplicate-definition", message, action.span, f"create it as `{name} : {cls}`")
        elif self.scope.check_is_object(name, action.node.span or action.span):
            if self.scope.retyped.get(name, cls) != cls:
                message = f"`{name}` cannot become both `{self.scope.retyped[name]}` and `{cls}`"
                self.scope.error("duplicate-action", message, where, "leave one of the two out")
            self.changes.change_spans[name] = where
            self.scope.retyped[name] = cls
            self.changes.retyped.append(name)

    def _read_deletion(self, name: str, span: Span | None) -> None:
        if not self.scope.check_in_scope(name, span, matched=True) or not self.scope.check_is_object(name, span):
            return
        if name in self.scope.created:
            self.scope.error(
                "duplicate-action",
                f"`{name}` is created by this rule",
                span,
                "leave out the creation and the deletion",
            )
        elif name in self.scope.deleted:
            self.scope.warn("duplicate-action", f"`{name}` is deleted already", span, "leave one deletion out")
        elif name in self.changes.merge_spans:
            message = f"`{name}` is both deleted and changed"
            note = Note("the other action is here", self.changes.merge_spans[name])
            self.scope.error("contradiction", message, span, "leave one of the two out", note)
        else:
            self.changes.deletion_spans[name] = span
            self.scope.deleted[name] = None
            self.changes.deleted.append(name)

    def _read_merge(self, action: MergeAction) -> None:
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
                self.scope.check_object_after(v.name, v.span or span, matched=True)
                for v in (action.kept, action.absorbed)
            ]
        ):
            places = self.scope.slot_of(kept), self.scope.slot_of(absorbed), self.scope.add_slot("")
            self.changes.absorbs.append(MergeObjects(*places, span))
            self.changes.merge_spans[kept] = span
            self.scope.deleted[absorbed] = None
            self.scope.absorbed[absorbed] = None

    # --- `rhs`: the graph after the rule

    def _read_rhs(self, right: RightSide) -> None:
        kept = {**dict.fromkeys(node.name for node in right.nodes)}
        for edge in right.edges:
            kept.update({edge.source: None, edge.target: None})
        for node in right.nodes:
            self._read_rhs_node(node)
        self._delete_omitted_nodes(right, kept)
        self._read_rhs_edges(right)
        for node in right.nodes:
            self._read_assignments(node)
        for action in right.actions:
            self._read_rhs_action(action, kept)

    def _read_rhs_node(self, node: RuleNode) -> None:
        if not self.scope.is_in_scope(node.name):
            if node.type is None:
                self.scope.check_in_scope(node.name, node.span)
            else:
                self._add_created(node)
        elif node.type is not None and node.name in self.changes.created:
            self.scope.error(
                "duplicate-definition",
                f"`{node.name}` is created twice",
                node.span,
                "choose another name for one of them",
            )
        elif node.type is not None and node.type not in self._declared_classes(node.name):
            self._read_retype(RetypeAction(Variable(node.name, node.span), node.type, node.span, node.type_span))

    def _declared_classes(self, name: str) -> set[str]:
        before = self.scope.class_before(name)
        return self.scope.declared.get(name) or ({before} if before else set())

    def _delete_omitted_nodes(self, right: RightSide, kept: Mapping[str, None]) -> None:
        explicit = {a.node.name: a.span for a in right.actions if isinstance(a, DeleteNode)}
        context = {parameter.name for parameter in self.rule.parameters}
        for name, span in node_names(self.lowered.left).items():
            if name in kept or name in context or name not in self.lowered.own_variables:
                continue
            if not isinstance(self.scope.types.get(name), ObjectType):
                continue
            self.changes.deletion_spans[name] = explicit.get(name, span)
            self.scope.deleted[name] = None
            self.changes.deleted.append(name)
            if name not in explicit:
                self.scope.warn(
                    "deletion-by-omission",
                    f"`{name}` is deleted, because the right side leaves it out",
                    span,
                    f"write `delete {name};` in the right side if that is meant, or name `{name}` there to keep it",
                )

    def _read_rhs_edges(self, right: RightSide) -> None:
        wanted = self.changes.rhs_links
        unclear = False
        for edge in right.edges:
            resolved = self.scope.resolve_edge(edge)
            if resolved:
                wanted[self.scope.link_key(resolved)] = resolved
            unclear |= resolved is None
        before = {self.scope.link_key(arrow): arrow for arrow in self.changes.lhs_edges}
        if not unclear:
            self.changes.unlinks.update((key, arrow) for key, arrow in before.items() if key not in wanted)
        self.changes.links.update((key, edge) for key, edge in wanted.items() if key not in before)

    def _read_rhs_action(self, action: Action, kept: Mapping[str, None]) -> None:
        match action:
            case SetAction():
                self.assignments.read_set(action)
            case DeleteEdge():
                self._read_edge_deletion(action.edge)
            case DeleteNode():
                name = action.node.name
                if name in kept:
                    message = f"`{name}` occurs in the right side, so it cannot be deleted"
                    hint = "remove it from the right side, or remove the deletion"
                    self.scope.error("duplicate-action", message, action.node.span or action.span, hint)
                elif name not in self.changes.deleted:
                    self._read_deletion(name, action.node.span or action.span)
            case CreateAction() | RetypeAction() | MoveAction() | MergeAction() | RedirectAction():
                word = type(action).__name__.lower()
                hint = "describe the graph after the rule, or use `modify { .. }`"
                self.scope.error("misplaced-action", f"`{word}` is allowed only in `modify`", action.span, hint)

    # --- links

    def _read_create(self, nodes: Sequence[RuleNode], edges: Sequence[RuleEdge]) -> None:
        linked = {end for edge in edges for end in (edge.source, edge.target)}
        for node in nodes:
            given = node.type or node.assignments or node.name in linked
            if not given and self.scope.is_in_scope(node.name) and node.name not in self.scope.created:
                message = f"`{node.name}` exists already, so this creates nothing"
                self.scope.warn(
                    "no-creation",
                    message,
                    node.span,
                    "write `create name : Class;` for a new object, or remove this",
                )
        there = {self.scope.link_key(arrow) for arrow in self.scope.lhs_edges}
        for edge in edges:
            resolved = self.scope.resolve_edge(edge)
            if resolved is None:
                continue
            key = self.scope.link_key(resolved)
            self.changes.links[key] = resolved
            if key in there:
                message = f"the left side has `{edge.source} -{edge.reference}-> {edge.target}`: this creates nothing"
                hint = "remove this, or link another object: two objects have at most one such link"
                self.scope.warn("existing-link", message, edge.span, hint)
        for node in nodes:
            self._read_assignments(node)

    def _read_edge_deletion(self, edge: RuleEdge) -> None:
        resolved = self.scope.resolve_edge(edge, exists_before=True)
        if resolved is None:
            return
        key = self.scope.link_key(resolved)
        self._check_changed_once(key, edge, "deleted")
        self.changes.unlinks[key] = resolved
        self.changes.deleted_edges[key] = edge

    def _check_changed_once(self, key: LinkKey, edge: RuleEdge, change: str) -> None:
        """Report a link that is deleted or redirected twice. `change` is the second action, "deleted" or
        "redirected".
        """
        earlier = self.changes.redirected_edges.get(key) or self.changes.deleted_edges.get(key)
        if earlier is None:
            return
        text = f"`{edge.source} -{edge.reference}-> {edge.target}`"
        note = Note("the first action is here", earlier.span)
        if key not in self.changes.redirected_edges and change == "deleted":
            self.scope.warn("duplicate-action", f"{text} is deleted already", edge.span, "leave one deletion out")
        else:
            word = "redirected" if key in self.changes.redirected_edges else "deleted"
            message = f"{text} is {word} already, and cannot be {change} " + ("again" if word == change else "too")
            self.scope.error("duplicate-action", message, edge.span, "leave one of the two out", note)

    def _read_redirect(self, action: RedirectAction) -> None:
        edge = action.edge
        old = self.scope.resolve_edge(edge, exists_before=True)
        new = self.scope.resolve_edge(replace(edge, target=action.target.name, target_span=action.target.span))
        if old and new:
            key = self.scope.link_key(old)
            self._check_changed_once(key, edge, "redirected")
            self.changes.redirected_edges[key] = edge
            self.changes.unlinks[key] = old
            self.changes.links[self.scope.link_key(new)] = new

    def _read_move(self, action: MoveAction) -> None:
        node, container = action.node, action.container
        where = action.reference_span or action.span
        if not all([self.scope.check_object_after(v.name, v.span or action.span) for v in (node, container)]):
            return
        cls = self.scope.class_after(container.name)
        reference = self.scope.resolve_reference(cls, action.reference, where) if cls else None
        if reference is None or not self.scope.check_target(node.name, reference, node.span or action.span):
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
            MoveToContainer(self.scope.slot_of(node.name), self.scope.slot_of(container.name), reference, action.span)
        )

    def _read_assignments(self, node: RuleNode) -> None:
        for assignment in node.assignments:
            if node.name in self.changes.created:
                self.assignments.read_initial_value(node, assignment)
            elif self.scope.is_in_scope(node.name):
                owner = Variable(node.name, node.span)
                feature, value, span = assignment.feature, assignment.value, assignment.span
                self.assignments.read_set(
                    SetAction(owner, feature, "=", value, span, feature_span=assignment.feature_span)
                )

    def _unlink_deleted(self) -> None:
        """Add deletions of the LHS links at deleted (not merged) objects, also of LHS links of enclosing blocks."""
        gone = self.changes.deleted_without_merged
        for arrow in self.scope.lhs_edges:
            ends = {arrow.source, arrow.target}
            if ends & set(self.changes.deleted) or (arrow in self.changes.lhs_edges and ends & gone):
                self.changes.unlinks.setdefault(self.scope.link_key(arrow), arrow)
