"""All hypothesis strategies. Everything is small, so that coincidences are frequent."""

from __future__ import annotations

from contextlib import suppress
from random import Random
from typing import Any

from hypothesis import strategies as st

from envgraph.errors import RuleError
from envgraph.graph import Model, check_conformance
from envgraph.metamodel import (
    Annotation,
    Attribute,
    AttributeType,
    Class,
    EnumType,
    Metamodel,
    Reference,
    Scalar,
    Value,
)

# --- metamodels

COLOUR = EnumType("Colour", ("red", "green", "blue"))

_MULTIPLICITIES = [(0, 1), (1, 1), (0, None), (1, None), (0, 2), (0, 40)]


@st.composite
def metamodels(draw: st.DrawFn) -> Metamodel:
    """Two to five classes with inheritance, attributes of every type, and references of every kind."""
    names = [f"C{i}" for i in range(draw(st.integers(2, 5)))]
    abstract = [draw(st.booleans()) and draw(st.booleans()) for _ in names[1:]] + [False]
    supertypes = [
        tuple(draw(st.lists(st.sampled_from(names[:i]), unique=True, max_size=2)) if i else ())
        for i in range(len(names))
    ]
    features: dict[str, list[Attribute | Reference]] = {name: [] for name in names}
    for number in range(draw(st.integers(0, 4))):
        features[draw(st.sampled_from(names))].append(draw(_attributes(f"a{number}")))
    for number in range(draw(st.integers(1, 4))):
        owner, target = draw(st.sampled_from(names)), draw(st.sampled_from(names))
        for name, reference in zip((owner, target), draw(_relations(f"r{number}", owner, target)), strict=False):
            features[name].append(reference)
    classes = [
        Class(name, is_abstract, above, tuple(features[name]))
        for name, is_abstract, above in zip(names, abstract, supertypes, strict=True)
    ]
    return Metamodel("random", classes, (COLOUR,))


@st.composite
def _attributes(draw: st.DrawFn, name: str) -> Attribute:
    type_ = draw(st.sampled_from([*Scalar, COLOUR]))
    if draw(st.booleans()):
        lower, upper = draw(st.sampled_from([(0, None), (1, None), (0, 3), (2, 3)]))
        return Attribute(name, type_, lower=lower, upper=upper, unique=draw(st.booleans()))
    return Attribute(name, type_, draw(st.none() | values_of(type_)))


@st.composite
def _relations(draw: st.DrawFn, name: str, owner: str, target: str) -> list[Reference]:
    """A reference, and perhaps its opposite; or one that is its own."""
    lower, upper = draw(st.sampled_from(_MULTIPLICITIES))
    kind = draw(st.sampled_from(["plain", "containment", "opposite", "container", "symmetric"]))
    contains = kind in ("containment", "container")
    if kind == "symmetric":
        return [Reference(name, owner, lower, upper, opposite=name)]
    if kind in ("plain", "containment"):
        return [Reference(name, target, lower, upper, contains)]
    back_lower, back_upper = (0, 1) if contains else draw(st.sampled_from(_MULTIPLICITIES))
    pair = [
        Reference(name, target, lower, upper, contains, opposite=f"{name}b"),
        Reference(f"{name}b", owner, back_lower, back_upper, opposite=name),
    ]
    return pair


def values_of(type_: AttributeType) -> st.SearchStrategy[Value]:
    """Few values of a type, the extreme ones among them."""
    if isinstance(type_, EnumType):
        return st.sampled_from(type_.literals)
    match type_:
        case Scalar.INT:
            return st.sampled_from([0, 1, 2, -1, 2**63 - 1])
        case Scalar.FLOAT:
            return st.sampled_from([0.0, -0.0, 1.0, 0.1, -2.5, float("inf"), float("-inf"), 1])
        case Scalar.BOOL:
            return st.booleans()
        case Scalar.STRING:
            return st.sampled_from(["", "a", "b", "Ä", "\ud800"])


# --- models

EDITS = (
    "new",
    "delete",
    "retype",
    "set_value",
    "link",
    "unlink",
    "set_target",
    "set_targets",
    "place",
    "rename",
)


def edit(draw: Any, model: Model, kind: str) -> None:
    """One random change to a model; a change that is refused with a `RuleError` is none.

    Args:
        draw: takes a strategy and gives an example.
        model: changed in place.
        kind: one of `EDITS`.
    """
    nodes = list(model.graph.store.nodes())
    with suppress(RuleError):
        if kind == "new" or not nodes:
            _create(draw, model)
        elif kind == "unlink":
            _unlink(draw, model, nodes)
        elif kind in ("link", "set_target", "set_targets", "place"):
            _link(draw, model, kind)
        else:
            _edit_object(draw, model, kind, draw(st.sampled_from(nodes)))


def _create(draw: Any, model: Model) -> None:
    cls = draw(st.sampled_from([cls.name for cls in model.metamodel.class_list if not cls.abstract]))
    for _ in range(draw(st.sampled_from([1, 1, 3, 3, 3, 40]))):
        model.graph.new(cls)


def _edit_object(draw: Any, model: Model, kind: str, node: int) -> None:
    features = model.metamodel.features(model.graph.class_of(node)).values()
    attributes = [feature for feature in features if isinstance(feature, Attribute)]
    if kind == "delete":
        model.graph.delete(node, draw(st.sampled_from(["dpo", "spo"])))
    elif kind == "retype":
        concrete = [cls.name for cls in model.metamodel.class_list if not cls.abstract]
        model.graph.retype(node, draw(st.sampled_from(concrete)), draw(st.booleans()))
    elif kind == "rename":
        name = draw(st.sampled_from([None, "n1", "n2"]))
        if name is None or model.graph.find_object(name) is None:
            model.graph.set_object_name(node, name)
    elif attributes:
        attribute = draw(st.sampled_from(attributes))
        value = values_of(attribute.type)
        if attribute.many and draw(st.booleans()):
            _edit_values(draw, model.node(node)[attribute.name], attribute, value)
        elif attribute.many and draw(st.booleans()):
            held, one = model.node(node)[attribute.name], draw(value)
            if draw(st.booleans()):
                held.append(one)
            elif one in held:
                held.remove(one)
        elif attribute.many:
            several = st.lists(value, unique=attribute.unique, max_size=4)
            model.graph.set_value(node, attribute, draw(several))
        else:
            model.graph.set_value(node, attribute, draw(st.none() | value))


def _edit_values(draw: Any, held: Any, attribute: Attribute, values: st.SearchStrategy[Any]) -> None:
    """Edit a live list and a list of Python in the same way."""
    expected = list(held)
    for _ in range(draw(st.sampled_from([1, 1, 5]))):
        place, value = draw(st.integers(-3, 6)), draw(values)
        inside = -len(expected) <= place < len(expected)
        change = draw(st.sampled_from(["insert", "append", "delete", "replace"] if inside else ["insert"]))
        if change == "delete":
            del held[place], expected[place]
        elif attribute.unique and value in expected:
            continue
        elif change == "replace":
            held[place] = expected[place] = value
        else:
            place = len(expected) if change == "append" else place
            held.insert(place, value)
            expected.insert(place, value)
        assert held == expected


def _link(draw: Any, model: Model, kind: str) -> None:
    reference = draw(st.sampled_from(model.metamodel.references))
    sources, candidates = (
        list(model.graph.extent(reference.owner)),
        list(model.graph.extent(reference.target)),
    )
    if not (sources and candidates):
        return
    node = draw(st.sampled_from(sources))
    if kind == "link":
        # Several at once: crowded ends are stored in another way than others.
        for target in candidates[draw(st.sampled_from([0, 1, 2, -1, -5])) :][: draw(st.sampled_from([1, 4, 99]))]:
            model.graph.link(node, reference, target)
    elif kind == "set_target":
        model.graph.set_target(node, reference, draw(st.none() | st.sampled_from(candidates)))
    elif kind == "place" and reference.many:
        place, target = draw(st.integers(-3, 40)), draw(st.sampled_from(candidates))
        expected = [one for one in model.graph.targets(node, reference) if one != target]
        expected.insert(place, target)
        model.graph.insert_target(node, reference, place, target)
        assert list(model.graph.targets(node, reference)) == expected
    elif kind == "set_targets":
        targets = draw(st.lists(st.sampled_from(candidates), unique=True, max_size=3))
        model.graph.set_targets(node, reference, targets)


def _unlink(draw: Any, model: Model, nodes: list[int]) -> None:
    linked = [(node, r) for r in model.metamodel.references for node in nodes if model.graph.targets(node, r)]
    if linked:
        node, reference = draw(st.sampled_from(linked))
        targets = list(model.graph.targets(node, reference))
        for target in targets[: draw(st.sampled_from([1, 2, len(targets) // 2]))]:
            model.graph.unlink(node, reference, target)


@st.composite
def models(draw: st.DrawFn) -> Model:
    """A random metamodel, and a model of it after some edits."""
    model = Model(draw(metamodels()))
    for kind in draw(st.lists(st.sampled_from((*EDITS, "new", "link")), max_size=25)):
        edit(draw, model, kind)
    return model


# --- metamodels and valid models for derived operators

_BOUNDS = [(0, 1), (1, 1), (0, None), (1, None), (0, 2), (1, 2), (2, 2), (2, None), (1, 3), (2, 3)]


@st.composite
def bounded_metamodels(draw: st.DrawFn) -> Metamodel:
    """One to four classes with references of every kind, all bounds at both ends, frozen parts, small attributes."""
    names = [f"C{i}" for i in range(draw(st.integers(1, 4)))]
    features: dict[str, list[Attribute | Reference]] = {name: [] for name in names}
    for number in range(draw(st.integers(0, 2))):
        type_ = draw(st.sampled_from([COLOUR, Scalar.BOOL, Scalar.INT]))
        bounds = (Annotation("range", (0, 2)),) if type_ is Scalar.INT else ()
        features[draw(st.sampled_from(names))].append(Attribute(f"a{number}", type_, annotations=bounds))
    for number in range(draw(st.integers(1, 4))):
        owner, target = draw(st.sampled_from(names)), draw(st.sampled_from(names))
        pair = draw(_bounded_relations(f"r{number}", owner, target))
        for name, reference in zip((owner, target), pair, strict=False):
            features[name].append(reference)
    classes = [
        Class(
            name,
            abstract=name != names[-1] and draw(st.integers(0, 5)) == 0,
            supertypes=tuple(draw(st.lists(st.sampled_from(names[:i]), unique=True, max_size=2)) if i else ()),
            features=tuple(features[name]),
            frozen=draw(st.integers(0, 15)) == 15,
        )
        for i, name in enumerate(names)
    ]
    return Metamodel("bounded", classes, (COLOUR,))


@st.composite
def _bounded_relations(draw: st.DrawFn, name: str, owner: str, target: str) -> list[Reference]:
    lower, upper = draw(st.sampled_from(_BOUNDS))
    frozen = (Annotation("frozen"),) if draw(st.integers(0, 15)) == 15 else ()
    kind = draw(st.sampled_from(["plain", "containment", "opposite", "opposite", "container", "symmetric"]))
    if kind == "symmetric":
        return [Reference(name, owner, lower, upper, opposite=name, annotations=frozen)]
    contains = kind in ("containment", "container")
    if kind in ("plain", "containment"):
        return [Reference(name, target, lower, upper, contains, annotations=frozen)]
    back_lower, back_upper = draw(st.sampled_from(_BOUNDS[:2] if contains else _BOUNDS))
    return [
        Reference(name, target, lower, upper, contains, f"{name}b", annotations=frozen),
        Reference(f"{name}b", owner, back_lower, back_upper, opposite=name),
    ]


def valid_model(metamodel: Metamodel, random: Random, size: int) -> Model:
    """A random model that conforms: random objects, repaired for some rounds; what is still wrong then goes."""
    model = Model(metamodel)
    concrete = [cls.name for cls in metamodel.class_list if not cls.abstract]
    for _ in range(size):
        model.graph.new(random.choice(concrete))
    for _ in range(8):
        for violation in check_conformance(model):
            if model.graph.alive(violation.node) and isinstance(violation.feature, Reference):
                _repair(model, random, violation.node, violation.feature, most=3 * size + 4)
    for _ in range(random.randint(0, 2 * size)):
        reference = random.choice(metamodel.references)
        sources, targets = (
            list(model.graph.extent(reference.owner)),
            list(model.graph.extent(reference.target)),
        )
        if sources and targets:
            with suppress(RuleError):
                model.graph.link(random.choice(sources), reference, random.choice(targets))
    while wrong := [violation.node for violation in check_conformance(model)]:
        model.graph.delete(random.choice(wrong), "spo")
    return model


def _repair(model: Model, random: Random, node: int, reference: Reference, most: int) -> None:
    """One target more: an object that is there, else a new one."""
    candidates = list(model.graph.extent(reference.target))
    for candidate in random.sample(candidates, len(candidates)):
        with suppress(RuleError):
            if model.graph.link(node, reference, candidate):
                return
    classes = model.metamodel.concrete_classes(reference.target)
    if classes and len(model) < most:
        model.graph.new(random.choice(classes))
