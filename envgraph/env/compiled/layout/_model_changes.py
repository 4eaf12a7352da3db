"""Find out what the rules of a behaviour may change. Everything else is constant data of a member of the family."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping
from itertools import product
from typing import TypeVar

from envgraph.behaviour import Agent, Behaviour, RuleCall
from envgraph.code import dataclass
from envgraph.env.compiled.layout._not_compiled import NotCompiled, add_missing_span
from envgraph.env.compiled.layout._symbols import ValueDomain
from envgraph.errors import Span
from envgraph.match.plan import CallGraph
from envgraph.metamodel import Attribute, Metamodel, Reference, Scalar, Value
from envgraph.pattern import (
    AbsenceAtom,
    AggregateAtom,
    AttributeAtom,
    Conditional,
    Constant,
    Expression,
    Goal,
    InstanceAtom,
    Library,
    LinkAtom,
    Navigation,
    UnitCall,
)
from envgraph.rewrite import Engine
from envgraph.rewrite.plans import (
    AdjustAttribute,
    BlockPlan,
    ChangeTargets,
    CheckedUnit,
    RulePlan,
    SetAttribute,
    SetAttributeValues,
    SetTargets,
    all_steps,
    containments_of,
)

T = TypeVar("T")


def calls_of(behaviour: Behaviour) -> Iterator[RuleCall]:
    """Yield every call of a rule or unit that a behaviour makes."""
    yield from (branch.call for reset in behaviour.resets for branch in reset.apply)
    owners: tuple[Behaviour | Agent, ...] = (behaviour, *behaviour.agents)
    for owner in owners:
        for action in owner.actions:
            yield from (branch.call for branch in action.branches)
        for effect in owner.effects:
            yield from (branch.call for branch in effect.apply)


def plan_of(engine: Engine, call: RuleCall) -> RulePlan:
    """Return the plan of the rule that is called.

    Raises:
        NotCompiled: the rule is written in Python.
    """
    assert call.rule is not None
    plan: RulePlan | None = getattr(engine.prepare(call.rule), "plan", None)
    return _not_python("rule", call, plan)


def checked_unit(engine: Engine, call: RuleCall) -> CheckedUnit:
    """Return the checked steps of the unit that is called.

    Raises:
        NotCompiled: the unit is written in Python.
    """
    assert call.rule is not None
    return _not_python("unit", call, engine.catalog.programs[engine.catalog.resolve(call.rule)].checked)


def _not_python(kind: str, call: RuleCall, definition: T | None) -> T:
    """Return the definition of a called rule or unit; raise `NotCompiled` if it has none, because it is a function."""
    if definition is None:
        raise NotCompiled(f"the {kind} `{call.rule}`, which is written in Python", call.span)
    return definition


@dataclass(frozen=True, slots=True)
class ModelChanges:
    """The features and classes that a set of rules may change.

    Attributes:
        attributes, references: indices of the features that may change.
        set_attributes: the place of a change of an attribute of existing objects, by the attribute's index and their
            concrete class; other attributes in `attributes` change only when objects are created, deleted or retyped.
        groups: disjoint sets of concrete classes. Objects may be retyped within a group, or deleted from it. All
            classes whose objects rules create are in one group.
        deleted: classes whose objects may be deleted.
        created: classes whose objects may be created: the whole group, since a created object may be retyped.
        domains: the values of each multi-valued attribute that rules set, by its index.
    """

    metamodel: Metamodel
    attributes: frozenset[int]
    set_attributes: Mapping[tuple[int, str], Span | None]
    references: frozenset[int]
    groups: tuple[tuple[str, ...], ...]
    deleted: frozenset[str]
    created: frozenset[str]
    domains: Mapping[int, ValueDomain]

    @classmethod
    def from_plans(cls, plans: Iterable[RulePlan], library: Library) -> ModelChanges:
        """Return what the rules with these plans may change.

        Raises:
            NotCompiled: a rule makes a change that is not compiled.
        """
        found = _ChangeCollector(library)
        for plan in plans:
            with add_missing_span(plan.body.span):
                found.add(plan.body)
        return found.result()

    @property
    def reuses_numbers(self) -> bool:
        """Return True if objects of one class are both created and deleted, so that object numbers may be reused."""
        return not self.created.isdisjoint(self.deleted)

    def is_fixed_class(self, name: str, exact: bool = False) -> bool:
        """Return True if the set of objects of a class never changes. If `exact`, ignore the objects of subclasses."""
        members = {name} if exact else {*self.metamodel.concrete_classes(name)}
        passing = self.deleted | self.created
        return all(
            members.isdisjoint(group) or (members.issuperset(group) and passing.isdisjoint(group))
            for group in self.groups
        )

    def is_fixed_feature(self, feature: Attribute | Reference) -> bool:
        """Return True if the values of a feature never change."""
        known = self.attributes if isinstance(feature, Attribute) else self.references
        return feature.index not in known

    def group_of(self, cls: str) -> tuple[str, ...] | None:
        """Return the group of classes that contains a concrete class, or None if no group does."""
        for group in self.groups:
            if cls in group:
                return group
        return None

    def possible_classes(self, cls: str) -> tuple[str, ...]:
        """Return the concrete classes of the objects that are of a class, or may be retyped so that they are."""
        own = self.metamodel.concrete_classes(cls)
        grouped = [each for one in own for each in self.group_of(one) or (one,)] if self.groups else own
        return tuple(dict.fromkeys(grouped))

    @property
    def created_group(self) -> tuple[str, ...] | None:
        """Return the group of classes whose objects rules create, or None if rules create no objects."""
        return next((group for group in self.groups if not self.created.isdisjoint(group)), None)


class _ChangeCollector:
    """A collector of the changes that rules may make."""

    def __init__(self, library: Library) -> None:
        self.metamodel = library.metamodel
        self.attributes: set[int] = set()
        self.written: dict[tuple[int, str], Span | None] = {}
        self._assigned: set[int] = set()
        self.references: set[int] = set()
        self.deleted: set[str] = set()
        self.created: set[str] = set()
        self._groups: list[set[str]] = []
        self._value_origins: dict[Attribute, dict[Value | Attribute, Span | None]] = {}

    def add(self, body: BlockPlan, outer: tuple[BlockPlan, ...] = ()) -> None:
        """Add the changes of a rule or block; `outer` are the enclosing blocks, the outermost first.

        Raises:
            NotCompiled: a change is not compiled.
        """
        blocks = (*outer, body)
        created = {new.node: new.cls for block in blocks for new in block.creates}
        for inner in body.nested:
            self.add(inner, blocks)
        for reference in (*(one.reference for one in body.unlinks), *(one.reference for one in body.links)):
            self._add_reference(reference)
        for move in body.moves:
            self._add_container_change(created.get(move.node) or body.classes[move.node], move.reference)
        for change in body.sets:
            match change:
                case SetTargets(_, reference) | ChangeTargets(_, reference):
                    self._add_reference(reference)
                case (
                    SetAttribute(node, attribute)
                    | AdjustAttribute(node, attribute)
                    | SetAttributeValues(node, attribute)
                ):
                    self.attributes.add(attribute.index)
                    self._assigned.add(attribute.index)
                    if node not in created:
                        self._add_written([attribute.index], body.classes[node], change.span or body.span)
                    if attribute.many and not (isinstance(change, AdjustAttribute) and change.operator == "-="):
                        values = change.values if isinstance(change, SetAttributeValues) else (change.value,)
                        known: dict[int | None, Expression] = {
                            one.slot: one.expression for block in blocks for one in block.computed
                        }
                        self._add_values(attribute, [known.get(slot) for slot in values], change.span)
                case _:
                    raise AssertionError(change)
        for absorb in body.absorbs:
            self._add_container_change(created.get(absorb.kept) or body.classes[absorb.kept])
        for gone in (*(delete.node for delete in body.deletes), *(absorb.absorbed for absorb in body.absorbs)):
            self._add_deletion(body.classes[gone])
        for retype in body.retypes:
            self._add_retyping(body.classes[retype.node], retype.cls, retype.span or body.span)
        for new in body.creates:
            self.created.add(new.cls)
            self._merge_group(self.created)
            self._add_features_of([new.cls])

    def _add_written(self, attributes: Iterable[int], cls: str | None, span: Span | None) -> None:
        assert cls is not None
        for each in product(attributes, self.metamodel.concrete_classes(cls)):
            self.written.setdefault(each, span)

    def _add_reference(self, reference: Reference) -> None:
        opposite = self.metamodel.opposite(reference)
        self.references.update({reference.index} if opposite is None else {reference.index, opposite.index})
        held = self.metamodel.containment_link(reference, reference.owner, reference.target)
        if held is not None:
            self._add_container_change(held[2], reference)

    def _add_container_change(self, content: str | None, entered: Reference | None = None) -> None:
        """Record the references that may change if an object enters a container, and so leaves its former one."""
        assert content is not None
        left = containments_of(content, self.metamodel)
        for reference in left if entered is None else [*left, entered]:
            opposite = self.metamodel.opposite(reference)
            self.references.update({reference.index} if opposite is None else {reference.index, opposite.index})

    def _add_deletion(self, cls: str | None) -> None:
        assert cls is not None
        concrete = self.metamodel.concrete_classes(cls)
        self._merge_group(concrete)
        inside = self.metamodel.all_content_classes(concrete)
        for one in inside:
            self._merge_group([one])
        self.deleted.update(concrete, inside)
        self._add_features_of([*concrete, *inside])

    def _add_features_of(self, concrete: Iterable[str]) -> None:
        """Record the features that may change if objects of some concrete classes are created or deleted."""
        concrete = [*concrete]
        for one in concrete:
            features = self.metamodel.features(one).values()
            self.attributes.update(f.index for f in features if isinstance(f, Attribute))
        for reference in self.metamodel.references:
            if any(self.metamodel.is_a(one, end) for one in concrete for end in (reference.owner, reference.target)):
                self.references.add(reference.index)

    def _add_retyping(self, cls: str | None, new: str, span: Span | None) -> None:
        """Record the features that change if an object is retyped to `new`. Put both classes into one retyping
        group.
        """
        assert cls is not None
        old = self.metamodel.concrete_classes(cls)
        for one in old:
            has, will = (
                {f.index for f in self.metamodel.features(each).values() if isinstance(f, Attribute)}
                for each in (one, new)
            )
            self.attributes |= has ^ will
            self._assigned |= has ^ will
            self._add_written(will - has, new, span)
            for reference in self.metamodel.references:
                ends = reference.owner, reference.target
                if any(self.metamodel.is_a(one, end) and not self.metamodel.is_a(new, end) for end in ends):
                    self._add_reference(reference)
        self._merge_group([*old, new])

    def _add_values(self, attribute: Attribute, parts: list[Expression | None], span: Span | None) -> None:
        """Record where the numbers come from that a rule gives to an attribute: itself if that is not known."""
        origins = self._value_origins.setdefault(attribute, {})
        for part in parts if attribute.type in (Scalar.INT, Scalar.FLOAT) else ():  # `parts` grows during the loop
            match part:
                case Constant(value) if value is not None:
                    origins[value] = span
                case Conditional(_, then, otherwise):
                    parts += [then, otherwise]
                case Navigation(_, name):
                    origins.update((one, span) for one in self.metamodel.attributes if one.name == name)
                case _:
                    origins[attribute] = span

    def _domain_of(self, attribute: Attribute) -> ValueDomain:
        """Return the values that a multi-valued attribute may have.

        Raises:
            NotCompiled: they are not known before rules set them.
        """
        origins = self._value_origins.get(attribute, {})
        sources = [one for one in origins if isinstance(one, Attribute)]
        for source in sources:
            if source.index in self._assigned:
                raise NotCompiled(f"values of `{attribute}` that are not known before they are set", origins[source])
        initial = [one.initial for one in sources]
        literals = (one for one in (*origins, *initial) if not isinstance(one, Attribute | tuple))
        return ValueDomain(attribute.type, tuple(literals), (attribute, *sources))

    def _merge_group(self, classes: Iterable[str]) -> None:
        merged = {*classes}
        for group in [group for group in self._groups if not merged.isdisjoint(group)]:
            merged |= group
            self._groups.remove(group)
        self._groups.append(merged)

    def result(self) -> ModelChanges:
        order = [cls.name for cls in self.metamodel.class_list]
        groups = sorted(tuple(sorted(group, key=order.index)) for group in self._groups)
        many = [one for one in self.metamodel.attributes if one.many and one.index in self._assigned]
        growing = (cls for group in groups if not self.created.isdisjoint(group) for cls in group)
        return ModelChanges(
            self.metamodel,
            frozenset(self.attributes),
            self.written,
            frozenset(self.references),
            tuple(groups),
            frozenset(self.deleted),
            frozenset(growing),
            {one.index: self._domain_of(one) for one in many},
        )


def plans_of(engine: Engine, behaviour: Behaviour) -> list[RulePlan]:
    """Return the plans of all rules that a behaviour calls, directly or through units.

    Raises:
        NotCompiled: see `plan_of` and `checked_unit`; or a unit calls itself.
    """
    return _plans_of_calls(engine, (one for one in calls_of(behaviour) if one.rule is not None))


def _plans_of_calls(engine: Engine, calls: Iterable[RuleCall]) -> list[RulePlan]:
    return [plan_of(engine, rule) for call in calls for rule in _rule_calls(engine, call)]


def _rule_calls(engine: Engine, call: RuleCall, above: tuple[str, ...] = ()) -> Iterator[RuleCall]:
    """Yield the calls of rules that a call leads to: itself, those of a group, or those in a unit."""
    assert call.rule is not None
    signature = engine.signature(call.rule)
    if signature.kind != "unit":
        yield from (RuleCall(name, call.arguments, span=call.span) for name in engine.catalog.group(signature.name))
        return
    if signature.name in above:
        raise NotCompiled(f"the unit `{signature.simple_name}`, which calls itself", call.span)
    checked = checked_unit(engine, call)
    for step in all_steps(checked.unit):
        asked = checked.applicability_tests.get(id(step))
        callee = checked.calls[id(step)] if isinstance(step, UnitCall) else asked and asked[1]
        if callee is not None:
            yield from _rule_calls(engine, RuleCall(callee.name, span=step.span), (*above, signature.name))


class StaticPatterns:
    """The set of the patterns whose matches rules cannot change; `name in patterns` tests for a pattern."""

    def __init__(self, changes: ModelChanges, library: Library, calls: CallGraph) -> None:
        self._changes = changes
        self._library = library
        self._calls = calls
        self._own: dict[str, bool] = {}

    def __contains__(self, pattern: object) -> bool:
        assert isinstance(pattern, str)
        reached = [pattern]
        for name in reached:  # `reached` grows during the loop.
            if not self._has_static_goals(name):
                return False
            reached += [called for called in self._calls.called_patterns(name) if called not in reached]
        return True

    def _has_static_goals(self, pattern: str) -> bool:
        if pattern not in self._own:
            lowered = self._library.lowered_pattern(pattern)
            goals = [goal for body in lowered.bodies for goal in body.goals]
            self._own[pattern] = not lowered.inputs and all(map(self.is_static_goal, goals))
        return self._own[pattern]

    def is_static_goal(self, goal: Goal) -> bool:
        """Return True if rules cannot change the solutions of a goal, provided that patterns it calls are static."""
        match goal:
            case InstanceAtom(cls, _, exact):
                return self._changes.is_fixed_class(cls, exact)
            case AttributeAtom(feature) | LinkAtom(feature):
                return self._changes.is_fixed_feature(feature)
            case AggregateAtom(_, relation):
                return self.is_static_goal(relation)
            case AbsenceAtom(alternatives):
                return all(self.is_static_goal(inner) for alternative in alternatives for inner in alternative)
            case _:
                return True


def unaffected_patterns(engine: Engine, names: Iterable[str]) -> Container[str]:
    """Return the patterns whose matches no rule, unit or group of these names ever changes.

    The result is empty if one of them makes a change that cannot be analysed: see `plan_of`, `ModelChanges` and
    `plans_of`.
    """
    calls = (RuleCall(member) for name in names for member in engine.catalog.group(name))
    try:
        changes = ModelChanges.from_plans(_plans_of_calls(engine, calls), engine.library)
    except NotCompiled:
        return ()
    return StaticPatterns(changes, engine.library, CallGraph(engine.library))
