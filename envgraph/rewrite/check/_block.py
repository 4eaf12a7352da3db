"""From the right side of a block to its plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Literal

from envgraph.errors import Diagnostic, Note, Severity, Span, with_article
from envgraph.metamodel import Attribute, Feature
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
from envgraph.rewrite._plan import (
    Absorb,
    BlockPlan,
    ChangeClass,
    ChangeTargets,
    Delete,
    Increase,
    Link,
    New,
    Rehome,
    SetTargets,
    SetValues,
    Unlink,
)
from envgraph.rewrite.check._assign import AssignmentReader
from envgraph.rewrite.check._conflicts import Conflicts, Contradiction
from envgraph.rewrite.check._homeless import homeless
from envgraph.rewrite.check._left import LoweredBlock
from envgraph.rewrite.check._sight import LinkKey, ResolvedEdge, Sight
from envgraph.rewrite.check._variables import equated, is_named, may_be_one, node_names, path_edges

TypesOf = Callable[[LoweredBlock], Mapping[str, StaticType | None]]


class BlockBuilder:
    """Works out what one block does, and collects what is wrong with it in `sight.problems`.

    Names first (what is created, retyped, deleted), then everything that refers to names: the order of the actions
    in the text does not matter.
    """

    def __init__(self, rule: Rule, lowered: LoweredBlock, sight: Sight, types_of: TypesOf) -> None:
        self.rule = rule
        self.lowered = lowered
        self.types_of = types_of
        self._clashes(sight)
        self.sight = sight.inner(types_of(lowered))
        self.values = AssignmentReader(self.sight)
        self.inherited = len(sight.names)
        self.right = lowered.block.right if lowered.block else rule.right
        self._own_created: list[str] = []
        self._own_retyped: list[str] = []
        self._own_deleted: list[str] = []
        self._spans: dict[str, Span | None] = {}
        self._gone: dict[str, Span | None] = {}
        self._unlinks: dict[LinkKey, ResolvedEdge] = {}
        self._links: dict[LinkKey, ResolvedEdge] = {}
        self._moves: list[Rehome] = []
        self._absorbs: list[Absorb] = []
        self._kept: dict[str, Span | None] = {}
        self._wanted: dict[LinkKey, ResolvedEdge] = {}
        self._removed: dict[LinkKey, Edge] = {}
        self._redirected: dict[LinkKey, Edge] = {}
        self._read_left()

    def _clashes(self, outer: Sight) -> None:
        for name in self.lowered.own:
            if name in outer.created:
                span = node_names(self.lowered.left).get(name)
                message = f"`{name}` is created by the enclosing rule"
                hint = "a new object is in no match: choose another name for one of the two"
                outer.error("duplicate-definition", message, span, hint)

    def _read_left(self) -> None:
        for node in self.lowered.left.nodes:
            if node.type:
                self.sight.declared.setdefault(node.name, set()).add(node.type)
        self.sight.equated |= equated(self.lowered.left)
        self._arrows = [edge for edge in map(self.sight.left_edge, self.lowered.left.edges) if edge]
        self.sight.arrows.extend(self._arrows)
        paths = filter(None, map(self.sight.left_edge, path_edges(self.lowered.left)))
        self.sight.paths.update(map(self.sight.key, paths))
        calls = (each for each in self.lowered.left.constraints if isinstance(each, PatternCall))
        self.sight.called += [
            {term.name for term in terms_in(c) if isinstance(term, Variable)} for c in calls
        ]

    def build(self) -> BlockPlan:
        """The plan; of use only if no error was found."""
        match self.right:
            case Modification():
                self._modification(self.right)
            case RightSide():
                self._right_side(self.right)
        self._contradictions()
        self._clear_deleted()
        pairs = self._identified_links()
        self.sight.unlinked.update(self._unlinks)
        nested = tuple(
            BlockBuilder(self.rule, block, self.sight, self.types_of).build() for block in self.lowered.nested
        )
        plan = self._plan(nested, pairs)
        self._check_consistent(plan)
        self._check_required(plan)
        if isinstance(self.right, Modification) and self.rule.semantics == "dpo" and not nested:
            self._check_retyped()
        if isinstance(self.right, Modification) and not nested:
            self._check_orphans()
        return plan

    # --- names

    def _modification(self, right: Modification) -> None:
        mentioned = [node for action in right.actions if isinstance(action, Create) for node in action.nodes]
        for node in sorted(
            mentioned, key=lambda node: node.type is None
        ):  # it may be mentioned before it is made
            self._new_or_known(node)
        for action in right.actions:
            if isinstance(action, Merge):
                self._merge(action)
        for action in right.actions:
            match action:
                case Retype():
                    self._retype(action)
                case DeleteNode():
                    self._delete(action.node.name, action.node.span or action.span)
                case _:
                    pass
        for action in right.actions:
            match action:
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
                case _:
                    pass

    def _new_or_known(self, node: Node) -> None:
        if node.type is None:
            self.sight.knows(node.name, node.span)
        elif self.sight.sees(node.name):
            self.sight.error(
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
        self._spans[name] = node.span
        if not is_named(name):
            hint = "a name that starts with `_` stands for anything, once; give the object another name"
            self.sight.error("bad-name", f"`{name}` cannot name a new object", node.span, hint)
        # An unusable class still makes the name known: one mistake, one diagnostic.
        if self.sight.instantiable(node.type, node.type_span or node.span):
            self.sight.created[name] = node.type
        else:
            self.sight.types[name] = None
        self._own_created.append(name)
        self.sight.add(name)

    def _retype(self, action: Retype) -> None:
        name, cls = action.node.name, action.type
        where = action.type_span or action.span
        if not self.sight.knows(
            name, action.node.span or action.span, matched=True
        ) or not self.sight.instantiable(cls, where):
            return
        if name in self.sight.created:
            message = f"`{name}` is created by this rule"
            self.sight.error("duplicate-definition", message, action.span, f"create it as `{name} : {cls}`")
        elif self.sight.was_object(name, action.node.span or action.span):
            if self.sight.retyped.get(name, cls) != cls:
                message = f"`{name}` cannot become both `{self.sight.retyped[name]}` and `{cls}`"
                self.sight.error("duplicate-action", message, where, "leave one out")
            self._spans[name] = where
            self.sight.retyped[name] = cls
            self._own_retyped.append(name)

    def _delete(self, name: str, span: Span | None) -> None:
        if not self.sight.knows(name, span, matched=True) or not self.sight.was_object(name, span):
            return
        if name in self.sight.created:
            self.sight.error(
                "duplicate-action",
                f"`{name}` is created by this rule",
                span,
                "leave out the creation and the deletion",
            )
        elif name in self.sight.deleted:
            self.sight.warn("duplicate-action", f"`{name}` is deleted already", span, "leave it out")
        elif name in self._kept:
            message = f"`{name}` is deleted and changed"
            notes = (Note("the other action is here", self._kept[name]),)
            self.sight.problems.append(
                Diagnostic("contradiction", message, span, "leave one of the two out", notes=notes)
            )
        else:
            self._gone[name] = span
            self.sight.deleted[name] = None
            self._own_deleted.append(name)

    def _merge(self, action: Merge) -> None:
        kept, absorbed = action.kept.name, action.absorbed.name
        span = action.span
        if kept == absorbed:
            self.sight.error(
                "duplicate-action",
                f"`{kept}` cannot be merged with itself",
                span,
                "merge two different objects",
            )
        elif absorbed in self.sight.created:
            message = f"`{absorbed}` is created by this rule, so that there is nothing to merge"
            self.sight.error("duplicate-action", message, action.absorbed.span or span, "leave it out")
        elif all(
            [
                self.sight.is_object(v.name, v.span or span, matched=True)
                for v in (action.kept, action.absorbed)
            ]
        ):
            places = self.sight.slot(kept), self.sight.slot(absorbed), self.sight.add("")
            self._absorbs.append(Absorb(*places, span))
            self._kept[kept] = span
            self.sight.deleted[absorbed] = None
            self.sight.absorbed[absorbed] = None

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
        if not self.sight.sees(node.name):
            if node.type is None:
                self.sight.knows(node.name, node.span)
            else:
                self._create(node)
        elif node.type is not None and node.name in self._own_created:
            self.sight.error(
                "duplicate-definition",
                f"`{node.name}` is created twice",
                node.span,
                "choose another name for one",
            )
        elif node.type is not None and node.type not in self._left_classes(node.name):
            self._retype(Retype(Variable(node.name, node.span), node.type, node.span, node.type_span))

    def _left_classes(self, name: str) -> set[str]:
        before = self.sight.before(name)
        return self.sight.declared.get(name) or ({before} if before else set())

    def _omitted_nodes(self, right: RightSide, kept: Mapping[str, None]) -> None:
        explicit = {a.node.name: a.span for a in right.actions if isinstance(a, DeleteNode)}
        context = {parameter.name for parameter in self.rule.parameters}
        for name, span in node_names(self.lowered.left).items():
            if name in kept or name in context or name not in self.lowered.own:
                continue
            if not isinstance(self.sight.types.get(name), ObjectType):
                continue
            self._gone[name] = explicit.get(name, span)
            self.sight.deleted[name] = None
            self._own_deleted.append(name)
            if name not in explicit:
                self.sight.warn(
                    "deletion-by-omission",
                    f"`{name}` is deleted, because the right side leaves it out",
                    span,
                    f"write `delete {name};` in the right side if that is meant, or name `{name}` there to keep it",
                )

    def _right_edges(self, right: RightSide) -> None:
        wanted = self._wanted
        unclear = False
        for edge in right.edges:
            resolved = self.sight.edge(edge)
            if resolved:
                wanted[self.sight.key(resolved)] = resolved
            unclear |= resolved is None
        before = {self.sight.key(arrow): arrow for arrow in self._arrows}
        if not unclear:
            self._unlinks.update((key, arrow) for key, arrow in before.items() if key not in wanted)
        self._links.update((key, edge) for key, edge in wanted.items() if key not in before)

    def _right_action(self, action: Action, kept: Mapping[str, None]) -> None:
        match action:
            case Set():
                self.values.set(action)
            case DeleteEdge():
                self._delete_edge(action.edge)
            case DeleteNode():
                name = action.node.name
                if name in kept:
                    message = f"`{name}` stands in the right side, so it cannot be deleted"
                    hint = "take it out of the right side, or leave the deletion out"
                    self.sight.error("duplicate-action", message, action.node.span or action.span, hint)
                elif name not in self._own_deleted:
                    self._delete(name, action.node.span or action.span)
            case Create() | Retype() | Move() | Merge() | Redirect():
                word = type(action).__name__.lower()
                hint = "say what the graph looks like afterwards, or use `modify { .. }`"
                self.sight.error("misplaced-action", f"`{word}` stands in `modify` only", action.span, hint)

    # --- links

    def _new_graph(self, nodes: Sequence[Node], edges: Sequence[Edge]) -> None:
        there = {self.sight.key(arrow) for arrow in self.sight.arrows}
        for edge in edges:
            resolved = self.sight.edge(edge)
            if resolved is None:
                continue
            key = self.sight.key(resolved)
            self._links[key] = resolved
            if key in there:
                message = f"the left side has `{edge.source} -{edge.reference}-> {edge.target}` already"
                hint = "there is one such link: leave this out, or make it another object"
                self.sight.warn("existing-link", message, edge.span, hint)
        for node in nodes:
            self._assignments(node)

    def _delete_edge(self, edge: Edge) -> None:
        resolved = self.sight.edge(edge, before=True)
        if resolved is None:
            return
        key = self.sight.key(resolved)
        self._once(key, edge, "deleted")
        self._unlinks[key] = resolved
        self._removed[key] = edge

    def _once(self, key: LinkKey, edge: Edge, what: str) -> None:
        """A link is deleted once, or redirected once."""
        earlier = self._redirected.get(key) or self._removed.get(key)
        if earlier is None:
            return
        text = f"`{edge.source} -{edge.reference}-> {edge.target}`"
        notes = (Note("the first is here", earlier.span),)
        if key not in self._redirected and what == "deleted":
            self.sight.warn("duplicate-action", f"{text} is deleted already", edge.span, "leave it out")
        else:
            word = "redirected" if key in self._redirected else "deleted"
            message = f"{text} is {word} already, and cannot be {what} " + (
                "again" if word == what else "too"
            )
            found = Diagnostic(
                "duplicate-action", message, edge.span, "leave one of the two out", notes=notes
            )
            self.sight.problems.append(found)

    def _contradictions(self) -> None:
        """Links that are deleted and there afterwards, or deleted and not known to be there."""
        for key, edge in self._removed.items():
            if key in self._wanted or key in self._links:
                message = (
                    f"`{edge.source} -{edge.reference}-> {edge.target}` is both deleted and there afterwards"
                )
                hint = "leave out the deletion, or what creates or keeps the link"
                self.sight.error("duplicate-action", message, edge.span, hint)
            else:
                self._ask_for(key, edge, "nothing happens")
        for key, edge in self._redirected.items():
            self._ask_for(key, edge, "the rule is refused")

    def _clear_deleted(self) -> None:
        """Links of the left side at a deleted node go with it, whoever wrote them."""
        gone = self.sight.deleted.keys() - self.sight.absorbed.keys()
        for arrow in self.sight.arrows:
            ends = {arrow.source, arrow.target}
            if ends & set(self._own_deleted) or (arrow in self._arrows and ends & gone):
                self._unlinks.setdefault(self.sight.key(arrow), arrow)

    def _redirect(self, action: Redirect) -> None:
        edge = action.edge
        old = self.sight.edge(edge, before=True)
        new = self.sight.edge(replace(edge, target=action.target.name, target_span=action.target.span))
        if old and new:
            key = self.sight.key(old)
            self._once(key, edge, "redirected")
            self._redirected[key] = edge
            self._unlinks[key] = old
            self._links[self.sight.key(new)] = new

    def _ask_for(self, key: LinkKey, edge: Edge, otherwise: str) -> None:
        """Warn of a link that no arrow, path or pattern of the left sides can mean."""
        if key in self.sight.paths or any(self.sight.key(arrow) == key for arrow in self.sight.arrows):
            return
        if any({edge.source, edge.target} <= called for called in self.sight.called):
            return
        text = f"{edge.source} -{edge.reference}-> {edge.target}"
        message = f"the left side does not ask for `{text}`: where it is missing, {otherwise}"
        self.sight.warn("unmatched-link", message, edge.span, f"add `{text};` to the left side")

    def _move(self, action: Move) -> None:
        node, container = action.node, action.container
        where = action.reference_span or action.span
        if not all([self.sight.is_object(v.name, v.span or action.span) for v in (node, container)]):
            return
        cls = self.sight.after(container.name)
        reference = self.sight.reference(cls, action.reference, where) if cls else None
        if reference is None or not self.sight.fits(node.name, reference, node.span or action.span):
            return
        if not reference.containment:
            hint = f"write `create {container.name} -{reference.name}-> {node.name};` to link them"
            self.sight.error("not-a-containment", f"`{reference}` does not contain its targets", where, hint)
            return
        self._moves.append(
            Rehome(self.sight.slot(node.name), self.sight.slot(container.name), reference, action.span)
        )

    def _assignments(self, node: Node) -> None:
        for assignment in node.assignments:
            if node.name in self._own_created:
                self.values.initialise(node, assignment)
            elif self.sight.sees(node.name):
                owner = Variable(node.name, node.span)
                feature, value, span = assignment.feature, assignment.value, assignment.span
                self.values.set(Set(owner, feature, "=", value, span, feature_span=assignment.feature_span))

    # --- the plan

    def _plan(
        self, nested: tuple[BlockPlan, ...], identified_links: tuple[tuple[Unlink, Unlink], ...]
    ) -> BlockPlan:
        slot = self.sight.slot
        deletes = tuple(Delete(slot(name), self._gone.get(name)) for name in dict.fromkeys(self._own_deleted))
        unlinks = tuple(self._unlink(edge) for edge in self._unlinks.values())
        links = [self._link(edge) for edge in self._links.values()]
        return BlockPlan(
            kind=self._kind(),
            pattern=self.lowered.pattern.qualified_name,
            arguments=tuple(slot(name) for name in self.lowered.inherited),
            inherited=self.inherited,
            names=tuple(self.sight.names),
            classes=tuple(self.sight.before(name) for name in self.sight.names),
            variables=len(self.lowered.own),
            coinciding=any(self._may_coincide(*pair) for pair in combinations(self.sight.types, 2)),
            identified=self._identified(),
            identified_links=identified_links,
            computed=tuple(self.values.computed),
            unlinks=unlinks,
            deletes=deletes,
            retypes=tuple(
                ChangeClass(slot(name), self.sight.retyped[name], self._spans.get(name))
                for name in dict.fromkeys(self._own_retyped)
            ),
            creates=tuple(
                New(slot(name), self.sight.created[name])
                for name in self._own_created
                if name in self.sight.created
            ),
            absorbs=tuple(self._absorbs),
            moves=tuple(self._moves),
            links=(*links, *self.values.links),
            sets=tuple(self.values.sets),
            nested=nested,
            span=self.lowered.pattern.span,
        )

    def _kind(self) -> Literal["rule", "forall", "forall+", "optional"]:
        block = self.lowered.block
        if block is None:
            return "rule"
        assert block.kind in ("forall", "forall+", "optional")
        return block.kind

    def _unlink(self, edge: ResolvedEdge) -> Unlink:
        key = self.sight.key(edge)
        required = key in self._redirected and all(
            self.sight.key(arrow) != key for arrow in self.sight.arrows
        )
        source, target = self.sight.slot(edge.source), self.sight.slot(edge.target)
        return Unlink(source, edge.reference, target, required, edge.span)

    def _link(self, edge: ResolvedEdge) -> Link:
        return Link(self.sight.slot(edge.source), edge.reference, self.sight.slot(edge.target), edge.span)

    def _may_coincide(self, one: str, other: str) -> bool:
        """Whether two variables may stand for one object in a match of this rule."""
        same = self.sight.equated
        if one == other or frozenset((one, other)) in same:
            return True
        if self.rule.injective and not may_be_one(one, other, self.rule.homomorphic, same):
            return False
        left, right = self.sight.before(one), self.sight.before(other)
        return bool(left and right and self.sight.metamodel.overlap(left, right))

    def _identified(self) -> tuple[tuple[int, int], ...]:
        own = {*self._own_deleted, *(self.sight.names[a.absorbed] for a in self._absorbs)}
        return tuple(
            (self.sight.slot(name), self.sight.slot(other))
            for name in self.sight.deleted
            for other in (self.sight.types if name in own else self.lowered.own)
            if name != other and self._may_coincide(name, other)
        )

    def _identified_links(self) -> tuple[tuple[Unlink, Unlink], ...]:
        found: list[tuple[Unlink, Unlink]] = []
        for key, gone in {**self.sight.unlinked, **self._unlinks}.items():
            for arrow in self.sight.arrows if key in self._unlinks else self._arrows:
                same = self.sight.key(arrow)
                if same == key or same[0] != key[0]:
                    continue
                if self._may_coincide(key[1], same[1]) and self._may_coincide(key[2], same[2]):
                    found.append((self._unlink(gone), self._unlink(arrow)))
        return tuple(found)

    def _check_consistent(self, plan: BlockPlan) -> None:
        """Find two actions that contradict each other at every match: as many objects as there are names.

        Values are not known, so that they are left out; where variables may coincide, the match decides.
        """
        computed = {each.slot for each in plan.computed}
        sets = (change for change in plan.sets if isinstance(change, SetTargets | ChangeTargets))
        kept = (edge for key, edge in self._wanted.items() if key not in self._links)
        symbolic = replace(
            plan,
            links=(*plan.links, *map(self._link, kept)),
            sets=tuple(change for change in sets if computed.isdisjoint(change.values)),
        )
        conflicts = Conflicts(self.sight.metamodel, lambda slot: f"`{plan.names[slot] or '..'}`", strict=True)
        try:
            conflicts.add(symbolic, range(len(plan.names)))
            conflicts.finish()
        except Contradiction as error:
            if plan.coinciding and not error.always:
                return
            first, second = (want.operation.span for want in error.wants)
            if first and second and second.start < first.start:
                first, second = second, first
            notes = (Note("the other action is here", first),) if first else ()
            if error.refused:
                message = f"{error.message}, so that the rule can never be applied"
                hint = "leave one of the two out"
                found = Diagnostic("never-applicable", message, second, hint, Severity.WARNING, notes)
            else:
                found = Diagnostic(
                    "contradiction", error.message, second, "leave one of the two out", notes=notes
                )
            self.sight.problems.append(found)

    def _check_orphans(self) -> None:
        """Warn of parts that stay because the left side names them, while their container goes."""
        gone = self.sight.deleted.keys() - self.sight.absorbed.keys()
        for arrow in self.sight.arrows:
            own = arrow in self._arrows or {arrow.source, arrow.target} & {*self._own_deleted}
            opposite = self.sight.metamodel.opposite(arrow.reference)
            if arrow.reference.containment:
                container, part = arrow.source, arrow.target
            elif opposite is not None and opposite.containment:
                container, part = arrow.target, arrow.source
            else:
                continue
            if not own or container not in gone or part in self.sight.deleted or self._finds_home(part):
                continue
            if self.sight.key(arrow) in self._removed:
                continue
            text = f"{arrow.source} -{arrow.reference.name}-> {arrow.target}"
            message = f"`{container}` is deleted, and `{part}` stays without a container: the left side has `{text}`"
            hint = f"write `delete {part};` or `move {part} to ..`, or `delete {text};` if that is meant"
            self.sight.warn("orphan", message, self._gone.get(container) or arrow.span, hint)

    def _finds_home(self, part: str) -> bool:
        """Whether a part may get another container."""
        slot, metamodel = self.sight.slot(part), self.sight.metamodel
        if any(move.node == slot for move in self._moves):
            return True
        for edge in self._links.values():
            opposite = metamodel.opposite(edge.reference)
            if edge.target == part and edge.reference.containment:
                return True
            if edge.source == part and opposite is not None and opposite.containment:
                return True
        changes = [change for change in self.values.sets if isinstance(change, SetTargets | ChangeTargets)]
        return any(change.object == slot or slot in change.values for change in changes)

    def _check_retyped(self) -> None:
        """Warn where a link of the left side stays, and an end of it becomes what cannot have it."""
        for name in dict.fromkeys(self._own_retyped):
            lost = next((arrow for arrow in self.sight.arrows if self._is_lost(arrow, name)), None)
            if lost is None:
                self._check_homeless(name)
                continue
            text = f"{lost.source} -{lost.reference.name}-> {lost.target}"
            new = with_article(self.sight.retyped[name])
            message = f"`{name}` becomes {new}, which cannot have `{text}`"
            hint = f"write `delete {text};` as well, or `@semantics(spo)` before the rule: then it is lost"
            notes = (Note("the link is asked for here", lost.span),) if lost.span else ()
            whole = f"{message}, so that the rule can never be applied"
            found = Diagnostic(
                "never-applicable", whole, self._spans.get(name), hint, Severity.WARNING, notes
            )
            self.sight.problems.append(found)

    def _check_homeless(self, name: str) -> None:
        """Warn where a link to the container is in the way, which the left side does not ask for."""
        before, after, metamodel = self.sight.before(name), self.sight.retyped[name], self.sight.metamodel
        if any(move.node == self.sight.slot(name) for move in self._moves):
            return
        for arrow in self.sight.unlinked.values():
            opposite = metamodel.opposite(arrow.reference)
            upwards = arrow.source == name and opposite is not None and opposite.containment
            if upwards or (arrow.target == name and arrow.reference.containment):
                return
        if before and homeless(metamodel.concrete(before), after, metamodel):
            old, new = with_article(before), with_article(after)
            message = f"nothing that contains {old} can contain {new}: no `{name}` in a container becomes one"
            hint = f"write `move {name} to ..`, or delete the link to its container"
            self.sight.warn("homeless", message, self._spans.get(name), hint)

    def _is_lost(self, arrow: ResolvedEdge, name: str) -> bool:
        """Whether the new class of an object cannot have a link, which nothing takes away before."""
        metamodel, cls, reference = self.sight.metamodel, self.sight.retyped[name], arrow.reference
        if self.sight.key(arrow) in self.sight.unlinked or {arrow.source, arrow.target} & {
            *self.sight.deleted
        }:
            return False
        opposite = metamodel.opposite(reference)
        moved = any(move.node == self.sight.slot(name) for move in self._moves)
        if arrow.source == name and metamodel.feature(cls, reference.name) != reference:
            return not (moved and opposite is not None and opposite.containment)
        if arrow.target == name and not metamodel.is_a(cls, reference.target):
            return not (moved and reference.containment)
        return False

    def _check_required(self, plan: BlockPlan) -> None:
        """Warn where an object surely ends without a target that its class requires."""
        fresh = {name: set[Feature]() for name in self._own_created if name in self.sight.created}
        for name in self._own_retyped:
            before = self.sight.before(name)
            fresh[name] = set(self.sight.metamodel.features(before).values()) if before else set()
        for name, had in fresh.items():
            cls = self.sight.after(name)
            assert cls is not None
            for feature in self.sight.metamodel.features(cls).values():
                single = isinstance(feature, Attribute) and not feature.many  # a fresh object has its default
                if single or feature.lower == 0 or feature in had:
                    continue
                if not _provides(plan, self.sight.slot(name), feature, self.sight):
                    self._warn_required(name, feature)

    def _warn_required(self, name: str, feature: Feature) -> None:
        self.sight.warn(
            "missing-required",
            f"`{name}` gets no `{feature.name}`, and `{feature}` needs {feature.multiplicity}",
            self._spans.get(name),
            f"add `{feature.name} = ..`",
        )


def _provides(plan: BlockPlan, slot: int, reference: Feature, sight: Sight) -> bool:
    """Whether a plan links an object by a reference, from either end, or gives it values of an attribute."""
    if isinstance(reference, Attribute):
        given = (one for one in plan.sets if isinstance(one, SetValues | Increase))
        return any((one.object, one.attribute) == (slot, reference) for one in given)
    opposite = sight.metamodel.opposite(reference)
    for link in plan.links:
        if (link.source, link.reference) == (slot, reference) or (link.target, link.reference) == (
            slot,
            opposite,
        ):
            return True
    for change in plan.sets:
        if isinstance(change, SetTargets | ChangeTargets):
            if (change.object, change.reference) == (slot, reference):
                return True
            if change.reference == opposite and slot in change.values:
                return True
    moved = any(
        (m.container, m.reference) == (slot, reference) or (m.node, m.reference) == (slot, opposite)
        for m in plan.moves
    )
    return moved or any(_provides(inner, slot, reference, sight) for inner in plan.nested)
