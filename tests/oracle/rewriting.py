"""What rules mean, worked out on plain sets: it shares nothing with the engine but the data of rules.

Written from the description of the language. Matches are found by trying; an application gathers everything that the
rule and the matches of its blocks ask for, checks that it fits together, and then does one phase after the other.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

from envgraph.pattern import (
    Constant,
    CreateAction,
    DeleteEdge,
    DeleteNode,
    Expression,
    LeftSide,
    MergeAction,
    Modification,
    MoveAction,
    Pattern,
    RedirectAction,
    RetypeAction,
    RightSide,
    Rule,
    RuleBlock,
    RuleEdge,
    RuleNode,
    SetAction,
)
from tests.oracle.rewriting_search import (
    Arrow,
    Env,
    Item,
    Link,
    Matching,
    NoValue,
    Search,
    State,
    Thing,
    arithmetic,
    evaluated,
    several,
    types_in,
)

# --- what an application asks for


@dataclass
class Instance:
    """A match of the rule or of one of its blocks, with what encloses it."""

    left: LeftSide
    right: RightSide | Modification | None
    env: Env
    parent: Instance | None
    parameters: frozenset[str]
    types: dict[str, str]
    """Classes that the left sides declare."""
    made: Env = field(default_factory=dict)

    @property
    def arrows(self) -> list[RuleEdge]:
        """Arrows of single links, its own first."""
        own = [e for e in self.left.edges if not e.closure and "_" not in (e.source, e.target)]
        return own + (self.parent.arrows if self.parent else [])

    def value(self, name: str) -> Item:
        if name in self.made:
            return self.made[name]
        return self.env[name] if name in self.env or self.parent is None else self.parent.value(name)

    def thing(self, name: str) -> Thing:
        found = self.value(name)
        assert isinstance(found, Thing)
        return found

    def knows(self, name: str) -> bool:
        return name in self.made or name in self.env or (self.parent is not None and self.parent.knows(name))

    def link(self, edge: RuleEdge) -> Link:
        return edge.reference, self.thing(edge.source), self.thing(edge.target)


@dataclass
class Change:
    """What one right side does to the names of its scope."""

    deleted: list[str] = field(default_factory=list)
    removed: list[RuleEdge] = field(default_factory=list)
    retyped: list[tuple[str, str]] = field(default_factory=list)
    created: list[RuleNode] = field(default_factory=list)
    added: list[RuleEdge] = field(default_factory=list)
    moved: list[MoveAction] = field(default_factory=list)
    merged: list[MergeAction] = field(default_factory=list)
    redirected: list[RuleEdge] = field(default_factory=list)
    sets: list[SetAction] = field(default_factory=list)


def change_of(instance: Instance, state: State) -> Change:
    right = instance.right
    if right is None:
        return Change()
    return of_graph(instance, right, state) if isinstance(right, RightSide) else of_actions(right.actions, instance)


def of_graph(instance: Instance, right: RightSide, state: State) -> Change:
    """What is on the left alone goes, what is on the right alone comes."""
    left = instance.left
    outside = instance.parameters | (set(instance.parent.env) if instance.parent else set())
    ends = [end for edge in left.edges for end in (edge.source, edge.target)]
    nodes = dict.fromkeys([node.name for node in left.nodes] + ends)
    mine = [name for name in nodes if name != "_" and name not in outside]
    there = {node.name for node in right.nodes} | {e for edge in right.edges for e in (edge.source, edge.target)}
    change = of_actions(right.actions, instance)
    change.deleted += [name for name in mine if name not in there and name not in change.deleted]
    for node in right.nodes:
        if not instance.knows(node.name):
            assert node.type is not None
            change.created.append(node)
        elif node.type is not None and node.type != instance.types.get(node.name):
            change.retyped.append((node.name, node.type))
    drawn = [e for e in left.edges if not e.closure and "_" not in (e.source, e.target)]
    kept = {name for edge in right.edges for name in canonical(state, edge)}
    change.removed += [e for e in drawn if not canonical(state, e) & kept]
    before = {name for edge in drawn for name in canonical(state, edge)}
    change.added += [e for e in right.edges if not canonical(state, e) & before]
    return change


def canonical(state: State, edge: RuleEdge) -> set[Arrow]:
    """The arrow as written forwards and backwards."""
    opposite = state.reference(edge.reference).opposite
    arrow = (edge.reference, edge.source, edge.target)
    return {arrow, (opposite, edge.target, edge.source)} if opposite else {arrow}


def of_actions(actions: Sequence[object], instance: Instance) -> Change:
    change = Change()
    for action in actions:
        match action:
            case CreateAction(nodes, edges):
                change.created += [node for node in nodes if node.type]
                change.added += edges
            case DeleteNode(node):
                change.deleted.append(node.name)
            case DeleteEdge(edge):
                change.removed.append(edge)
            case RetypeAction(node, cls):
                change.retyped.append((node.name, cls))
            case RedirectAction(edge, target):
                change.redirected.append(edge)
                change.removed.append(edge)
                change.added.append(RuleEdge(edge.source, edge.reference, target.name))
            case SetAction():
                change.sets.append(action)
            case MoveAction():
                change.moved.append(action)
            case MergeAction():
                change.merged.append(action)
    return change


# --- applying


@dataclass(frozen=True)
class Refused:
    """Why an application is refused: any of these reasons may be given."""

    reasons: frozenset[str]


@dataclass(frozen=True)
class Unclear:
    """The actions contradict each other in a way that the language does not settle."""

    why: str


Outcome = State | Refused | Unclear


def outcomes(state: State, rule: Rule, patterns: Mapping[str, Pattern], match: Env, most: int = 20) -> list[Outcome]:
    """What applying a rule at a match may lead to: one outcome for each choice that `optional` blocks have.

    Empty if there are too many choices.
    """
    matching = Matching(state, rule, Search(state, patterns))
    parameters = frozenset(p.name for p in rule.parameters)
    types = {p.name: p.type for p in rule.parameters if p.type in state.metamodel.classes}
    types |= types_in(rule.left)
    root = Instance(rule.left, rule.right, match, None, parameters, types)  # type: ignore[arg-type]
    found = []
    for number, instances in enumerate(choices(matching, rule.blocks, root)):
        if number >= most:
            return []
        found.append(Application(state.copy(), state, rule, [root, *instances]).outcome())
        for instance in [root, *instances]:
            instance.made = {}
    return found


def choices(matching: Matching, blocks: Sequence[RuleBlock], around: Instance) -> Iterator[list[Instance]]:
    """The instances of blocks, and of those inside them, in every way that `optional` leaves open."""
    ways: list[list[list[Instance]]] = []
    for block in blocks:
        if block.kind in ("not", "require"):
            continue
        inner = []
        for env in matching.inside(block, around.env):
            types = around.types | types_in(block.left)
            instance = Instance(block.left, block.right, env, around, around.parameters, types)
            inner.append([[instance, *more] for more in choices(matching, block.blocks, instance)])
        if block.kind == "optional":
            ways.append([way for one in inner for way in one] or [[]])
        else:
            ways.append([[i for way in combination for i in way] for combination in product(*inner)])
    for chosen in product(*ways):
        yield [instance for way in chosen for instance in way]


def clash(state: State, one: Link, other: Link) -> bool:
    """Whether two links cannot both be there: two targets for one, or two containers."""
    if one == other:
        return False
    single = one[:2] == other[:2] and state.reference(one[0]).upper == 1
    return single or (one[2] == other[2] and state.contains(one) and state.contains(other))


@dataclass
class Application:
    """One application in the making: `state` changes, `before` is what values are computed on."""

    state: State
    before: State
    rule: Rule
    instances: list[Instance]
    reasons: set[str] = field(default_factory=set)
    unclear: list[str] = field(default_factory=list)

    def outcome(self) -> Outcome:
        self.compute()
        self.check_redirected()
        self.check_identification()
        self.check_agreement()
        self.delete()
        self.retype()
        self.create()
        self.link()
        self.set()
        if self.unclear and not self.reasons & {"ambiguous", "identification"}:
            return Unclear("; ".join(self.unclear))
        return Refused(frozenset(self.reasons)) if self.reasons else self.state

    @property
    def both(self) -> list[tuple[Instance, Change]]:
        return list(zip(self.instances, self.changes, strict=True))

    # --- what is asked for

    def compute(self) -> None:
        """All values, on the state before the rule; the new objects get their names."""
        fresh = max(self.before.classes, default=-1) + 1
        self.fresh: list[tuple[Thing, str]] = []
        self.changes: list[Change] = []
        for instance in self.instances:
            change = change_of(instance, self.before)
            self.changes.append(change)
            for node in change.created:
                instance.made[node.name] = Thing(fresh)
                self.fresh.append((Thing(fresh), node.type or ""))
                fresh += 1
        self.assigned: list[tuple[int, Thing, str, str, list[Item | None]]] = []
        self.literals: list[tuple[Thing, str, list[Item | None]]] = []
        for number, (instance, change) in enumerate(self.both):
            for node in change.created:
                for given in node.assignments:
                    values = self.values(given.value, instance, given.feature)
                    self.literals.append((instance.thing(node.name), given.feature, values))
            for one in change.sets:
                values = self.values(one.value, instance, one.feature)
                if self.before.attribute(one.feature) is None:
                    values = [value for value in values if value is not None]
                self.assigned.append((number, instance.thing(one.object.name), one.feature, one.operator, values))

    def values(self, value: Expression | tuple[Expression, ...], instance: Instance, feature: str) -> list[Item | None]:
        """The values of a list, or the one value; where an attribute needs one, a path has to lead to it."""
        env = {}
        around: Instance | None = instance
        while around is not None:
            env = around.env | around.made | env
            around = around.parent
        try:
            found = [evaluated(self.before, e, env) for e in (value if isinstance(value, tuple) else (value,))]
        except NoValue:
            self.reasons.add("error")
            return [None]
        attribute = self.before.attribute(feature)
        needed = attribute and (attribute.many or not attribute.optional)
        if needed and None in found and value != Constant(None):
            self.reasons.add("error")
        return [] if attribute and attribute.many and value == Constant(None) else found

    def explicit(self) -> dict[Thing, list[tuple[int, str]]]:
        """Objects that are deleted by name, each with the places that say so."""
        found: dict[Thing, list[tuple[int, str]]] = {}
        for number, (instance, change) in enumerate(self.both):
            for name in [*change.deleted, *(merge.absorbed.name for merge in change.merged)]:
                found.setdefault(instance.thing(name), []).append((number, name))
        return found

    def check_redirected(self) -> None:
        """What is to lead elsewhere is there."""
        for instance, change in self.both:
            if not {instance.link(edge) for edge in change.redirected} <= self.before.links:
                self.reasons.add("missing-link")

    def check_identification(self) -> None:
        """What is deleted is matched by one name alone."""
        for instance, change in self.both:
            deleted = {*change.deleted, *(merge.absorbed.name for merge in change.merged)}
            around = instance.parent
            removed = list(change.removed)
            while around is not None:
                outer = self.changes[self.instances.index(around)]
                deleted |= {*outer.deleted, *(merge.absorbed.name for merge in outer.merged)}
                removed += outer.removed
                around = around.parent
            gone = {instance.value(name) for name in deleted}
            removed += [e for e in instance.arrows if {instance.value(e.source), instance.value(e.target)} & gone]
            for name in deleted:
                for other, value in instance.env.items():
                    if other != name and isinstance(value, Thing) and value == instance.value(name):
                        self.reasons.add("identification")
            for one in removed:
                for other in instance.arrows:
                    same = self.before.both(instance.link(one)) & self.before.both(instance.link(other))
                    if same and not canonical(self.before, one) & canonical(self.before, other):
                        self.reasons.add("identification")

    def check_agreement(self) -> None:
        """No two places want different things of one object, value or link."""
        gone = self.explicit()
        changed: dict[Thing, set[int]] = {}
        kinds: dict[Thing, set[str]] = {}
        added: dict[Link, set[int]] = {}
        removed: dict[Link, set[int]] = {}
        for number, (instance, change) in enumerate(self.both):
            for name, cls in change.retyped:
                changed.setdefault(instance.thing(name), set()).add(number)
                kinds.setdefault(instance.thing(name), set()).add(cls)
            for edge in change.added:
                for link in self.before.both(instance.link(edge)):
                    changed.setdefault(link[1], set()).add(number)
                    added.setdefault(link, set()).add(number)
            for move in change.moved:
                changed.setdefault(instance.thing(move.node.name), set()).add(number)
                changed.setdefault(instance.thing(move.container.name), set()).add(number)
            for merge in change.merged:
                changed.setdefault(instance.thing(merge.kept.name), set()).add(number)
            for edge in change.removed:
                for link in self.before.both(instance.link(edge)):
                    removed.setdefault(link, set()).add(number)
        for _, _, values in self.literals:
            for value in values:
                if isinstance(value, Thing):
                    changed.setdefault(value, set()).add(-1)
        for number, thing, feature, _, values in self.assigned:
            changed.setdefault(thing, set()).add(number)
            if self.before.attribute(feature) is None:
                for value in values:
                    if isinstance(value, Thing):
                        changed.setdefault(value, set()).add(number)
        if any(len(classes) > 1 for classes in kinds.values()):
            self.reasons.add("ambiguous")
        absorbed = {i.thing(m.absorbed.name) for i, c in self.both for m in c.merged}
        if (set(gone) - absorbed) & set(changed):
            self.reasons.add("ambiguous")
        elif absorbed & set(changed):
            self.unclear.append("what is absorbed is changed elsewhere")
        for link in set(added) & set(removed):
            # What one place removes and adds, such as a redirection to where the link leads already, stays.
            removed[link] -= added[link]
            if removed[link]:
                self.reasons.add("ambiguous")
        self.check_merges()
        self.check_values()
        self.check_wishes({link for link, places in removed.items() if places})

    def check_merges(self) -> None:
        kept: dict[Thing, set[Thing]] = {}
        for instance, change in self.both:
            for merge in change.merged:
                kept.setdefault(instance.thing(merge.absorbed.name), set()).add(instance.thing(merge.kept.name))
        if len(kept) > 1:
            self.unclear.append("several are absorbed")
        if any(len(into) > 1 for into in kept.values()) or any(
            absorbed in into for absorbed in kept for into in kept.values()
        ):
            self.reasons.add("ambiguous")

    def check_values(self) -> None:
        """One value for each feature of an object; increases add up."""
        wanted: dict[tuple[Thing, str], list[tuple[str, tuple[Item | None, ...]]]] = {}
        for _, thing, feature, operator, values in self.assigned:
            wanted.setdefault((thing, feature), []).append((operator, tuple(values)))
        for thing, feature, values in self.literals:
            if (thing, feature) in wanted and self.before.attribute(feature):
                wanted[thing, feature].append(("=", tuple(values)))
        for (_, feature), asked in wanted.items():
            operators = {operator for operator, _ in asked}
            if "=" in operators:
                if len(operators) > 1 or len({frozenset(values) for _, values in asked}) > 1:
                    self.reasons.add("ambiguous")
                elif len({values for _, values in asked}) > 1:
                    self.unclear.append("lists in another order")
            elif (
                len({values for _, values in asked}) > 1
                and not self.before.several(feature)
                and any(isinstance(value, str) for _, values in asked for value in values)
            ):
                self.reasons.add("ambiguous")
            elif (not self.before.attribute(feature) or self.before.several(feature)) and len(operators) > 1:
                plus = {v for operator, values in asked for v in values if operator == "+="}
                if plus & {v for operator, values in asked for v in values if operator == "-="}:
                    self.reasons.add("ambiguous")

    def check_wishes(self, removed: set[Link]) -> None:
        """Links that `set` and `move` ask for fit beside all others; the bounds see to those that are only made."""
        made = set(self.new_links())
        asked = {other for link in self.moved_links() for other in self.before.both(link)}
        for _, thing, feature, operator, values in self.assigned:
            if self.before.attribute(feature) is None:
                wanted = {(feature, thing, value) for value in values if isinstance(value, Thing)}
                closed = {other for link in wanted for other in self.before.both(link)}
                if operator == "-=":
                    removed = removed | closed
                else:
                    asked |= closed
                if operator == "=" and any(link[:2] == (feature, thing) for link in made - closed):
                    self.reasons.add("ambiguous")
        if asked & removed:
            self.reasons.add("ambiguous")
        if any(clash(self.before, one, other) for one in asked for other in asked | made):
            self.reasons.add("ambiguous")
        if any(clash(self.before, one, other) for one in made for other in made):
            self.reasons |= {"full", "containment"}
        for _, thing, feature, operator, values in self.assigned:
            if operator == "=" and any(link[:2] == (feature, thing) and link[2] not in values for link in asked):
                self.reasons.add("ambiguous")

    def moved_links(self) -> list[Link]:
        return [(m.reference, i.thing(m.container.name), i.thing(m.node.name)) for i, c in self.both for m in c.moved]

    def new_links(self) -> list[Link]:
        """All links that the rule adds but by `set`, `move` and `merge`, in both directions."""
        found: list[Link] = []
        for instance, change in self.both:
            found += [instance.link(edge) for edge in change.added]
        for thing, feature, values in self.literals:
            found += [(feature, thing, value) for value in values if isinstance(value, Thing)]
        return [other for link in dict.fromkeys(found) for other in sorted(self.before.both(link))]

    # --- the phases

    def delete(self) -> None:
        state, gone = self.state, self.explicit()
        for instance, change in self.both:
            for edge in change.removed:
                state.links -= state.both(instance.link(edge))
            for edge in instance.arrows:
                link = instance.link(edge)
                if gone.keys() & {link[1], link[2]} and not self.absorbs(link, gone):
                    state.links -= state.both(link)
            for move in change.moved:
                old = state.container(instance.thing(move.node.name))
                if old is not None:
                    state.links -= state.both(old)
        for _, thing, feature, operator, values in self.assigned:
            if operator == "-=" and self.before.attribute(feature) is None:
                for value in values:
                    link = (feature, thing, value)
                    if isinstance(value, Thing) and any(map(state.contains, state.both(link))):
                        state.links -= state.both(link)  # so that another container can be given to it
        self.hand_over()
        roots = [t for t in gone if not any(t != other and t in state.tree(other) for other in gone)]
        whole = {thing: root for root in roots for thing in state.tree(root)}
        kept = {v for i in self.instances for v in i.env.values() if isinstance(v, Thing)} - set(gone)
        if kept & set(whole):
            self.reasons.add("containment")
        for link in [link for link in state.links if {link[1], link[2]} & set(whole)]:
            _, source, target = link
            loop = source == target and source in roots
            within = whole.get(source) == whole.get(target) and not loop
            holding = any(state.contains(one) and one[2] in roots for one in state.both(link))
            if self.rule.semantics == "dpo" and not within and not holding:
                self.reasons.add("dangling")
            state.links.discard(link)
        for thing in whole:
            state.classes.pop(thing, None)
        state.values = {key: value for key, value in state.values.items() if key[0] in state.classes}

    def absorbs(self, link: Link, gone: Mapping[Thing, object]) -> bool:
        """Whether a link goes over to another object instead of going with its end."""
        absorbed = {i.thing(m.absorbed.name) for i, c in self.both for m in c.merged}
        ends = {link[1], link[2]}
        return bool(ends & absorbed) and not ends & (set(gone) - absorbed)

    def hand_over(self) -> None:
        """What `merge` takes from the absorbed objects, and gives to those that stay when links are made."""
        state = self.state
        into = {i.thing(m.absorbed.name): i.thing(m.kept.name) for i, c in self.both for m in c.merged}
        self.handed: list[tuple[Link, bool]] = []
        for link in sorted(state.links):
            name, source, target = link
            if source in into or target in into:
                new = (name, into.get(source, source), into.get(target, target))
                self.handed.append((new, target in into))
                state.links.discard(link)

    def retype(self) -> None:
        state = self.state
        for instance, change in self.both:
            for name, cls in change.retyped:
                thing = instance.thing(name)
                if thing in state.classes and state.classes[thing] != cls:
                    self.become(thing, cls)
        lost = [link for link in state.links if not state.allows(link)]
        if lost and self.rule.semantics == "dpo":
            self.reasons.add("lost-link")
        state.links -= {other for link in lost for other in state.both(link)}

    def become(self, thing: Thing, cls: str) -> None:
        state = self.state
        state.classes[thing] = cls
        for attribute in state.metamodel.attributes:
            key = (thing, attribute.name)
            if not state.has_feature(cls, attribute.name):
                state.values.pop(key, None)
            elif key not in state.values:
                state.values[key] = attribute.initial

    def create(self) -> None:
        for thing, cls in self.fresh:
            self.become(thing, cls)
        for thing, feature, values in self.literals:
            if self.state.several(feature):
                self.hold(thing, feature, "=", values)
            elif self.state.attribute(feature):
                self.state.values[thing, feature] = values[0]

    def hold(self, thing: Thing, feature: str, operator: str, values: list[Item | None]) -> None:
        """Give an attribute other values, or more, or fewer."""
        attribute = self.state.several(feature)
        held = self.state.values.get((thing, feature))
        before: tuple[Item, ...] = held if isinstance(held, tuple) and operator != "=" else ()
        given = [value for value in values if value is not None]
        kept = [one for one in before if one not in given] if operator == "-=" else [*before, *given]
        assert attribute is not None
        self.state.values[thing, feature] = now = several(attribute, kept)
        if attribute.upper is not None and len(now) > attribute.upper:
            self.reasons.add("full")

    def link(self) -> None:
        state = self.state
        old = set(state.links)
        self.merge()
        moved = [other for link in self.moved_links() for other in sorted(state.both(link))]
        new = [link for link in [*self.new_links(), *moved] if {link[1], link[2]} <= set(state.classes)]
        if not all(state.allows(link) for link in new):
            self.reasons.add("ambiguous")
        for link in new:
            if state.contains(link) and link not in state.links and state.container(link[2]) is not None:
                self.reasons.add("full")
                if link[1] in state.tree(link[2]):
                    self.reasons.add("containment")
                if link[2] in self.placed:
                    self.unclear.append("a place beside that of what was absorbed")
            state.links.add(link)
        counts = Counter((name, source) for name, source, _ in state.links)
        for name, source, _ in state.links - old:
            upper = state.reference(name).upper
            if upper is not None and counts[name, source] > upper:
                self.reasons.add("full")
        self.check_cycles()

    def merge(self) -> None:
        """What was absorbed hands its links over, but one that would lead from an object to itself as its part."""
        state = self.state
        contained = {one.opposite for one in state.metamodel.references if one.containment and one.opposite}
        self.placed: set[Thing] = set()
        for link, into in self.handed:
            name, source, target = link
            if name in contained or (state.contains(link) and source == target):
                continue
            if not {source, target} <= set(state.classes):
                self.refuse("dangling")
            elif state.contains(link) and into and state.container(target) is not None:
                if target in self.placed:
                    self.unclear.append("places of two absorbed objects")
            elif not state.allows(link):
                self.refuse("lost-link")
            else:
                if into:
                    self.placed.add(target)
                state.links |= state.both(link)

    def refuse(self, reason: str) -> None:
        """What SPO does without."""
        if self.rule.semantics == "dpo":
            self.reasons.add(reason)

    def check_cycles(self) -> None:
        for thing in self.state.classes:
            seen, above = {thing}, self.state.container(thing)
            while above is not None:
                if above[1] in seen:
                    self.reasons.add("containment")
                    break
                seen.add(above[1])
                above = self.state.container(above[1])

    # --- values

    def set(self) -> None:
        """In the order of the text. Where another order leads elsewhere, the actions contradict each other."""
        start, reasons = self.state, self.reasons
        ends = []
        for order in (self.assigned[::-1], self.assigned):
            self.state, self.reasons = start.copy(), set(reasons)
            self.set_all(order)
            ends.append((self.state, self.reasons))
        if ends[0] != ends[1]:
            self.unclear.append("the order of `set` matters")
        for link in self.new_links():
            if link in start.links and link not in self.state.links:
                self.unclear.append("a new link is taken away by `set`")

    def set_all(self, assigned: Sequence[tuple[int, Thing, str, str, list[Item | None]]]) -> None:
        done: set[tuple[Thing, str]] = set()
        for _, thing, feature, operator, values in assigned:
            if thing not in self.state.classes:
                continue
            if not self.state.has_feature(self.state.classes[thing], feature):
                self.reasons |= {"ambiguous", "error"}
            elif self.before.several(feature):
                self.hold(thing, feature, operator, values)
            elif self.before.attribute(feature):
                if operator == "=":
                    self.state.values[thing, feature] = values[0]
                elif (thing, feature) not in done:
                    done.add((thing, feature))
                    self.increase(thing, feature)
            else:
                self.point(thing, feature, operator, [v for v in values if isinstance(v, Thing)])
        self.check_cycles()

    def increase(self, thing: Thing, feature: str) -> None:
        total = self.state.values.get((thing, feature))
        for _, other, name, operator, values in self.assigned:
            if (other, name) == (thing, feature) and operator != "=":
                if total is None or values[0] is None:
                    self.reasons.add("error")
                    return
                total = arithmetic(operator[0], total, values[0])
        self.state.values[thing, feature] = total

    def point(self, source: Thing, name: str, operator: str, targets: list[Thing]) -> None:
        state = self.state
        links = {link for target in targets for link in state.both((name, source, target))}
        if operator == "-=":
            state.links -= links
            return
        if operator == "=":
            for target in state.targets(source, name):
                if target not in targets:
                    state.links -= state.both((name, source, target))
        if not all(state.allows(link) for link in links if {link[1], link[2]} <= set(state.classes)):
            self.reasons.add("ambiguous")
        for target in dict.fromkeys(targets):
            if target in state.classes and (name, source, target) not in state.links:
                self.replace((name, source, target))

    def replace(self, link: Link) -> None:
        """Add a link that takes the place of others where there is room for one alone."""
        state = self.state
        for direction in state.both(link):
            if state.contains(direction):
                holder = state.container(direction[2])
                if holder is not None:
                    state.links -= state.both(holder)
        name, source, target = link
        opposite = state.reference(name).opposite
        if opposite is not None and state.reference(opposite).upper == 1:
            for holder in state.targets(target, opposite):
                state.links -= state.both((opposite, target, holder))
        for one, end in ((name, source), (opposite, target)):
            upper = state.reference(one).upper if one else None
            if one and upper is not None and len(state.targets(end, one)) >= upper:
                self.reasons.add("full")
        state.links |= state.both(link)
