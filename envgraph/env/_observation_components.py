"""Create functions that read the components of an observation from the model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import count as count_from, zip_longest
from typing import Any

from envgraph.behaviour import (
    Behaviour,
    FeatureReader,
    KeyIndex,
    Observation,
    ObserveAround,
    ObserveAttribute,
    ObservedWindow,
    ObserveFind,
    ObserveObject,
    ObservePath,
    ObserveRange,
    follow_path,
    key_attributes,
    key_reader,
)
from envgraph.env._float_ranges import LARGEST_FLOAT32, FloatRange, float_rank
from envgraph.env._prepared_clauses import NameClasses, NameValues, Owner, merge_clauses
from envgraph.errors import EvaluationError
from envgraph.graph import Model
from envgraph.metamodel import Attribute, EnumType, Metamodel, Scalar, Value
from envgraph.pattern import (
    ColumnMark,
    Constant,
    EnumLiteral,
    Expression,
    Navigation,
    ObjectType,
    PatternCall,
    StaticType,
    Variable,
    check_expression,
)


class KeyedObjects:
    """A list of the current objects of a class by index, the oldest of several with one key; updated after changes."""

    def __init__(self, model: Model, keys: KeyIndex, cls: str) -> None:
        self.keys = keys.keys_of(cls)
        self._model, self._index, self._cls = model, keys, cls
        self._key_of, self._has_key = key_reader(model, cls), bool(key_attributes(model.metamodel, cls))
        self._initial = keys.candidates(model, cls)
        self._found: list[int | None] = []
        self._revision = -1

    def get(self, position: int) -> int | None:
        """Return the object that has the index `position` in the current state, or None."""
        for node in self._initial[position]:
            if self._has_index(node, position):
                return node
        if not self._has_key:
            return None
        if self._revision != self._model.graph.store.revision:  # objects may have been created, or have new keys
            self._found = self._index.objects(self._model, self._cls)
            self._revision = self._model.graph.store.revision
        return self._found[position]

    def _has_index(self, node: int, position: int) -> bool:
        model = self._model
        if not model.graph.alive(node) or not model.metamodel.is_a(model.graph.class_of(node), self._cls):
            return False
        return self._key_of(node) == self.keys[position]


def component_size(
    observation: ObservePath | ObserveFind, types: NameClasses, keys: KeyIndex, metamodel: Metamodel
) -> int:
    """Return the number of values of a clause's components, with one more for `or none`, and one for hidden objects.

    For floats it is a `FloatRange`.
    """
    unseen = observation.visible is not None
    match observation:
        case ObserveFind(up_to=None):
            return 2 + unseen
        case ObserveObject(among=among, or_none=or_none):
            return keys.size(among) + or_none + unseen
    limits = observed_range(observation, types, metamodel)
    if limits is not None:
        low, high, is_float = limits
        return FloatRange(low, high, unseen) if is_float else int(high - low) + 1 + unseen
    type_ = path_type(observation, types, metamodel)
    return (len(type_.literals) if isinstance(type_, EnumType) else 2) + unseen


def observed_range(
    observation: ObservePath | ObserveFind, types: NameClasses, metamodel: Metamodel
) -> tuple[float, float, bool] | None:
    """Return the range of an observed number, in the clause or by `@range`, and True for a float; None for others."""
    is_float = False
    match observation:
        case ObserveFind(low=low, up_to=int() | float() as high) | ObserveRange(low=low, high=high):
            is_float = not (isinstance(low, int) and isinstance(high, int))
        case ObserveAttribute(path=Navigation(object=before, feature=name)):
            owner = path_type(replace(observation, path=before), types, metamodel)
            assert isinstance(owner, ObjectType), "the behaviour was checked"
            attribute = metamodel.feature(owner.cls, name)
            if not isinstance(attribute, Attribute) or attribute.range is None:
                return None
            low, high, _ = attribute.range
        case _:
            return None
    if not is_float and path_type(observation, types, metamodel) is not Scalar.FLOAT:
        return low, high, False
    return max(float(low), -LARGEST_FLOAT32), min(float(high), LARGEST_FLOAT32), True


def component_sizes(
    observations: Iterable[tuple[Observation, NameClasses]], keys: KeyIndex, metamodel: Metamodel, behaviour: Behaviour
) -> list[int]:
    """Return the number of values of each component of some `observe` clauses, each with the classes of its names."""
    found: list[int] = []
    for observation, types in observations:
        if isinstance(observation, ObserveAround):
            found += ObservedWindow(observation, behaviour.draw, types, metamodel).sizes
            continue
        size = component_size(observation, types, keys, metamodel)
        found += [size] * (1 if observation.each is None else keys.size(observation.each.type or ""))
    return found


def merge_sizes(sizes_of_blocks: Iterable[Sequence[int]], *, mixed: bool = False) -> list[int]:
    """Return for each component of an observation the maximum number of values over all `agent` blocks.

    Raises:
        EvaluationError: a component is a float for one block, and something else for another, but not `mixed`.
    """
    columns = [[size for size in column if size is not None] for column in zip_longest(*sizes_of_blocks)]
    for place, column in enumerate(columns, start=1):
        if not mixed and len({getattr(size, "limits", None) for size in column}) > 1:
            message = f"component {place} of an observation is a float for agents of one block, but not for all others"
            hint = "observe floats first in each `agent` block, in the same order and with equal ranges"
            raise EvaluationError(message, hint=hint)
    return [max(column) for column in columns]


def path_type(observation: ObservePath | ObserveFind, types: NameClasses, metamodel: Metamodel) -> StaticType | None:
    """Return the type of the value or object that an observed path leads to; None for matches."""
    if isinstance(observation, ObserveFind):
        return None
    scope: dict[str, StaticType | None] = {name: ObjectType(cls) for name, cls in types.items()}
    if observation.each is not None:
        scope[observation.each.name] = ObjectType(observation.each.type or "")
    return check_expression(observation.path, scope, metamodel)[0]


def component_reader(
    path: Expression,
    owner: Owner,
    model: Model,
    read: FeatureReader,
    index: Callable[[Value | None], int],
    padding: int,
) -> Callable[[], int]:
    """Return a function that reads a component of an observation.

    Args:
        path: the observed path.
        owner: the name at which the path begins, and a function that returns its object, or None if it is missing.
        model: the model, which names objects for messages.
        read: a function that reads features of objects.
        index: converts the value of the path to the component.
        padding: the component if the owner's object is missing.
    """
    name, value = owner

    def observe() -> int:
        scope = {name: value()}
        if scope[name] is None:
            return padding
        found: Value | int | None = 0
        try:
            found = follow_path(path, scope, read)
            return index(found)
        except EvaluationError as error:
            where = _describe_gap(model, path, scope, read) if found is None else ""
            raise EvaluationError(f"{error.message}{where}", path.span, error.hint) from None

    return observe


def path_target_reader(path: Expression, owner: Owner, read: FeatureReader) -> Callable[[], int | None]:
    """Return a function that returns the object at the end of a path, or None if the path leads to no object."""
    name, value = owner

    def read_target_index() -> int | None:
        try:
            found = follow_path(path, {name: value()}, read)
        except EvaluationError:  # an object on the path was deleted
            return None
        return found if type(found) is int else None

    return read_target_index


def observe_clauses(behaviour: Behaviour) -> list[Observation]:
    """Return all distinct `observe` clauses: those of `agent` blocks, then those that all agents share."""
    own = (one for agent in behaviour.agents for one in agent.observations)
    return [*dict.fromkeys([*own, *behaviour.observations])]


def clause_name(observation: Observation) -> str:
    """Return the text of an `observe` clause, with spaces for dots (for PyTorch): `hero at`, `count reached(_)`."""
    if isinstance(observation, ObserveAround):
        return f"around {observation.centre.name}"
    if isinstance(observation, ObserveFind):
        what = _format_expression(observation.call)
        return what if observation.up_to is None else f"{observation.aggregate} {what}"
    return _format_expression(observation.path)


def component_names(behaviour: Behaviour, keys: KeyIndex, count: int) -> tuple[str, ...]:
    """Return distinct names for the first `count` components of an observation.

    If the agents of several blocks have different components at one position, "or" joins their names.
    """
    rows = [
        [
            name
            for one, _ in merge_clauses(own, {}, behaviour.observations, {})
            for name in _clause_component_names(one, keys)
        ]
        for own in ([agent.observations for agent in behaviour.agents] or [()])
    ]
    columns = [dict.fromkeys(name for name in column if name) for column in zip_longest(*rows)]
    lead = ["agent"] if len(rows) > 1 else []
    return _make_distinct([*lead, *(" or ".join(column) for column in columns)][:count])


def combined_component_names(behaviour: Behaviour, keys: KeyIndex, seats: Iterable[tuple[str, int]]) -> tuple[str, ...]:
    """Return distinct names for the observed components of all simultaneous agents: own ones, then shared ones.

    Args:
        behaviour: a behaviour whose agents act simultaneously.
        keys: the indices of objects.
        seats: for each agent its name, and the number of its `agent` block.
    """
    found = []
    for who, number in seats:
        agent = behaviour.agents[number]
        for name in (name for one in agent.observations for name in _clause_component_names(one, keys)):
            found.append(f"{who.replace('.', '_')} {name.removeprefix(f'{agent.variable} ')}")
    return _make_distinct(
        [*found, *(name for one in behaviour.observations for name in _clause_component_names(one, keys))]
    )


def _make_distinct(names: Iterable[str]) -> tuple[str, ...]:
    found: dict[str, None] = {}
    for name in names:
        copies = (f"{name} {number}" for number in count_from(2))
        found[name if name not in found else next(one for one in copies if one not in found)] = None
    return tuple(found)


def _clause_component_names(observation: Observation, keys: KeyIndex) -> list[str]:
    name = clause_name(observation)
    if isinstance(observation, ObserveAround):
        rows, columns = (range(-(size // 2), size // 2 + 1) for size in (observation.height, observation.width))
        return [f"{name} {x} {y} {kind}" for y in rows for x in columns for kind in ("cell", "object")]
    each = observation.each
    if each is None or each.type is None:
        return [name]
    rest = f" {name}" if isinstance(observation, ObserveFind) else name.removeprefix(each.name)
    texts = (", ".join(map(str, key)).replace(".", "_") for key in keys.keys_of(each.type))
    return [f"{each.name}[{text}]{rest}" for text in texts]


def _format_expression(one: object) -> str:
    match one:
        case Navigation(object=owner, feature=feature):
            return f"{_format_expression(owner)} {feature}"
        case PatternCall(pattern=pattern, arguments=arguments, closure=closure):
            return f"{pattern.rpartition('.')[2]}{closure}({', '.join(map(_format_expression, arguments))})"
        case Variable(name=name):
            return "_" if name.startswith("_") else name
        case EnumLiteral(literal=literal):
            return f"::{literal}"
        case ColumnMark():
            return "#"
        case Constant(value=value):
            return str(value).replace(".", "_")
        case _:
            return ".."


def _describe_gap(model: Model, path: Expression, scope: NameValues, read: FeatureReader) -> str:
    """Return a text such as ": Hero h has no `read_target_index`" for the object at which a path ends without a value;
    or "".
    """
    while isinstance(path, Navigation):
        owner = follow_path(path.object, scope, read)
        if type(owner) is int:
            return f": {model.graph.describe(owner)} has no `{path.feature}`"
        path = path.object
    return ""


def object_indexer(
    model: Model, indexer: Callable[[int], int], missing: int | None, cls: str, path_class: str
) -> Callable[[Value | None], int]:
    """Return a function that converts an object to its index within a class, or raises EvaluationError.

    Args:
        model: the model of the objects.
        indexer: returns the index of an object of the class.
        missing: the index for no object and for objects of other classes; None if these are errors.
        cls: the class.
        path_class: the class that a path leads to; objects may have subclasses of it.
    """
    metamodel = model.metamodel
    certain = metamodel.covers(cls, path_class)

    def index(value: Value | None) -> int:
        if type(value) is int and (certain or metamodel.is_a(model.graph.class_of(value), cls)):
            return indexer(value)
        if missing is not None:
            return missing
        if type(value) is int:
            message = f"an observed path leads to {model.graph.describe(value)}, which is not of class `{cls}`"
            raise EvaluationError(message, hint=f"write `among {path_class}`, or `among {cls} or none`")
        raise EvaluationError("an observed path has no value", hint=f"write `among {cls} or none`")

    return index


def number_index(low: float, high: float, is_float: bool) -> Callable[[float], int]:
    """Return a function from a number to its index in a range, which is the distance from the lowest number."""
    rank: Callable[[float], int] = (lambda value: float_rank(float(value))) if is_float else int
    first = rank(low)
    return lambda value: rank(min(max(value, low), high)) - first


def value_indexer(rank: Callable[[Any], int]) -> Callable[[Value | None], int]:
    """Return a function that returns the rank of a value, or raises EvaluationError if the value is missing."""

    def index(value: Value | None) -> int:
        if value is None:
            hint = "give the attribute a value in each state, or observe a pattern with `find`"
            raise EvaluationError("an observed attribute has no value", hint=hint)
        return rank(value)

    return index
