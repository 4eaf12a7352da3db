"""Number objects by their keys, so that an index means the same object in every member of a family."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import product
from typing import Any, Self

from envgraph.behaviour._behaviour import Action, Agent, Behaviour, Domain, ObserveObject
from envgraph.behaviour._parameter_domains import domain_type
from envgraph.code import dataclass
from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.graph import Model
from envgraph.metamodel import Attribute, EnumType, Metamodel, Value, accepts
from envgraph.pattern import ObjectType

Key = tuple[Value, ...]
"""The key of an object: the values of its class's key attributes, or (id,) if the class has no key."""


def indexed_classes(behaviour: Behaviour, metamodel: Metamodel) -> tuple[str, ...]:
    """Return the classes whose objects a behaviour numbers: domains of actions, `among`, `for`, and agents."""
    agents = (agent.cls for agent in behaviour.agents)
    return tuple(dict.fromkeys([*ranged_classes(behaviour, metamodel), *agents]))


def ranged_classes(behaviour: Behaviour, metamodel: Metamodel) -> tuple[str, ...]:
    """Return the classes over whose objects actions or observations range; the classes of agents are not included."""
    found: dict[str, None] = {}
    owners: tuple[Behaviour | Agent, ...] = (behaviour, *behaviour.agents)
    for owner in owners:
        for action in owner.actions:
            types = [domain_type(domain, metamodel) for _, domain in action.parameters]
            found.update((type_.cls, None) for type_ in types if isinstance(type_, ObjectType))
        for observation in owner.observations:
            if isinstance(observation, ObserveObject):
                found[observation.among] = None
            if observation.each and observation.each.type:
                found[observation.each.type] = None
    return tuple(found)


@dataclass(frozen=True, slots=True)
class KeyIndex:
    """The keys of objects over a family, by class, in the order of their indices.

    The index of an object is the rank of its key in the sorted union over all members of a family (an enum sorts by
    the order of its literals). Objects of a class without `@key` are identified by their ids, which follow the order
    of creation; those that are created in an episode have no index.

    Attributes:
        keys: the sorted keys of each class that the behaviour numbers.
    """

    keys: Mapping[str, tuple[Key, ...]]

    @classmethod
    def of_model(cls, model: Model, classes: Iterable[str]) -> Self:
        """Return the index of one model for some classes; `merge` combines the indices of a family.

        Raises:
            EvaluationError: an object has no value in a key attribute, or two objects have the same key.
        """
        return cls.of_models([model], classes, model.metamodel)

    @classmethod
    def of_models(cls, models: Iterable[Model], classes: Iterable[str], metamodel: Metamodel) -> Self:
        """Return the index over several models, each of which is read before the next one is requested.

        Raises:
            EvaluationError: as for `of_model`.
        """
        found: dict[str, set[Key]] = {name: set() for name in classes}
        for model in models:
            for name, keys in found.items():
                keys |= _distinct_keys(model, name)
        return cls({name: _sort_keys(keys, metamodel, name) for name, keys in found.items()})

    def merge(self, other: KeyIndex, metamodel: Metamodel) -> KeyIndex:
        """Return the index over the members of the family that this index or the other one covers."""
        names = dict.fromkeys([*self.keys, *other.keys])
        return KeyIndex(
            {name: _sort_keys({*self.keys.get(name, ()), *other.keys.get(name, ())}, metamodel, name) for name in names}
        )

    def keys_of(self, cls: str) -> tuple[Key, ...]:
        """Return the keys of a class, in the order of their indices.

        Raises:
            InvalidArgument: the index does not contain the class.
        """
        if cls not in self.keys:
            raise InvalidArgument(f"the index has no class `{cls}`; it has {', '.join(self.keys) or 'no classes'}")
        return self.keys[cls]

    def size(self, cls: str) -> int:
        """Return the number of indices of a class, which is the number of its different keys in the family."""
        return len(self.keys_of(cls))

    def index(self, model: Model, cls: str, node: int) -> int:
        """Return the index of an object in a class.

        Raises:
            EvaluationError: the family has no such key: the object was created, or its key changed, during an episode.
        """
        return self.indexer(model, cls)(node)

    def indexer(self, model: Model, cls: str) -> Callable[[int], int]:
        """Return a function that maps object ids to indices as `index` does, but faster, for one model and class.

        Without key attributes, objects that are created later have no index.
        """
        created, key_of = (model.graph.store.next_id,), key_reader(model, cls)
        has_key = bool(key_attributes(model.metamodel, cls))
        rank = {key: position for position, key in enumerate(self.keys_of(cls)) if has_key or key < created}

        def index(node: int) -> int:
            found = rank.get(key_of(node))
            if found is None:
                missing = "no initial model of the family has an object with its key"
                raise EvaluationError(f"{model.node(node)!r} has no index among `{cls}`: {missing}")
            return found

        return index

    def objects(self, model: Model, cls: str) -> list[int | None]:
        """Return for each index of a class the id of the oldest object that has it; None if there is none."""
        class_of, covers = model.graph.class_of, {*model.metamodel.concrete_classes(cls)}
        return [
            next((node for node in nodes if class_of(node) in covers), None) for nodes in self.candidates(model, cls)
        ]

    def candidates(self, model: Model, cls: str) -> list[list[int]]:
        """Return the objects with the key of each index, oldest first, also those that may be retyped to the class."""
        found: dict[Key, list[int]] = {key: [] for key in self.keys_of(cls)}
        if not key_attributes(model.metamodel, cls):
            return [[node] if model.graph.alive(node) else [] for (node,) in found]  # type: ignore[arg-type, list-item]
        key_of = key_reader(model, cls)
        for name in indexable_classes(model.metamodel, cls):
            for node in model.graph.exact_extent(name):
                found.get(key_of(node), []).append(node)
        return [*map(sorted, found.values())]

    def to_json(self) -> dict[str, list[list[Value]]]:
        """Return the index as JSON-ready data, for the family file."""
        return {name: [list(key) for key in keys] for name, keys in self.keys.items()}

    @classmethod
    def from_json(cls, data: Any, metamodel: Metamodel) -> Self:
        """Return the index that `to_json` wrote.

        Raises:
            InvalidArgument: the data has another form, or does not fit the metamodel.
        """
        if not isinstance(data, dict):
            raise InvalidArgument("the index of keys must be an object of lists")
        for name, keys in data.items():
            if name not in metamodel.classes:
                raise InvalidArgument(f"the index of keys names an unknown class `{name}`")
            if not isinstance(keys, list) or not all(_is_valid_key(metamodel, name, key) for key in keys):
                raise InvalidArgument(f"the keys of `{name}` do not fit its key attributes")
        return cls({name: _sort_keys({tuple(key) for key in keys}, metamodel, name) for name, keys in data.items()})


def ordered_objects(model: Model, cls: str) -> list[int]:
    """Return the objects of a class ordered by key; by creation if a key is missing, or if the class has none."""
    order = _sort_function(model.metamodel, cls)
    try:
        keys = {node: order(key) for node, key in _object_keys(model, cls).items()}
    except EvaluationError:
        return sorted(model.graph.extent(cls))
    return sorted(keys, key=lambda node: (keys[node], node))


def expand_action(
    action: Action, keys: KeyIndex, metamodel: Metamodel
) -> Iterator[tuple[str, tuple[int | Value, ...]]]:
    """Yield every action of a clause: its name, such as `move(a, 2)`, and its arguments, where objects are indices."""
    domains = [list(_domain_values(domain, keys, metamodel)) for _, domain in action.parameters]
    for values in product(*domains):
        shown = ", ".join(text for text, _ in values)
        yield f"{action.name}({shown})" if values else action.name, tuple(value for _, value in values)


def _domain_values(domain: Domain, keys: KeyIndex, metamodel: Metamodel) -> Iterator[tuple[str, int | Value]]:
    """Yield each element of a domain as text (for the names of actions) and as value, for an object its index."""
    match domain_type(domain, metamodel):
        case ObjectType(cls):
            for index, key in enumerate(keys.keys_of(cls)):
                yield ", ".join(map(str, key)), index
        case EnumType(literals=literals):
            yield from ((literal, literal) for literal in literals)
        case _:
            yield from ((str(number), number) for number in range(domain.low, domain.high + 1))


def key_reader(model: Model, cls: str) -> Callable[[int], Key]:
    """Return a function that reads the key of an object of a class; it contains None for missing values."""
    attributes, value = key_attributes(model.metamodel, cls), model.graph.value
    if not attributes:
        return lambda node: (node,)
    return lambda node: tuple([value(node, attribute) for attribute in attributes])  # type: ignore[misc]


def key_attributes(metamodel: Metamodel, cls: str) -> tuple[Attribute, ...]:
    """Return the key attributes of a class; () if it has no key."""
    features = metamodel.features(cls)
    return tuple(f for name in metamodel.key(cls) if isinstance(f := features[name], Attribute))


def indexable_classes(metamodel: Metamodel, cls: str) -> tuple[str, ...]:
    """Return the concrete classes that have the key attributes of a class, so that their objects can have an index."""
    key = key_attributes(metamodel, cls)
    return tuple(
        one.name
        for one in metamodel.class_list
        if not one.abstract
        and (
            metamodel.is_a(one.name, cls)
            or (key and all(metamodel.is_a(one.name, attribute.owner) for attribute in key))
        )
    )


class DuplicateKeyError(EvaluationError):
    """An error: two objects of a class have the same key.

    Attributes:
        nodes: the ids of the objects, in the order of their creation.
    """

    def __init__(self, model: Model, cls: str, nodes: tuple[int, int], key: Key) -> None:
        self.nodes = nodes
        names = " and ".join(
            f"`{model.graph.display_name(node) or f'{model.graph.class_of(node)}#{node}'}`" for node in nodes
        )
        attributes = key_attributes(model.metamodel, cls)
        values = ", ".join(f"{one.name} = {value}" for one, value in zip(attributes, key, strict=True))
        super().__init__(f"{names} have the same key, {values}, but each object of `{cls}` needs its own")


def _object_keys(model: Model, cls: str) -> dict[int, Key]:
    read, names = key_reader(model, cls), model.metamodel.key(cls)
    found = {node: read(node) for node in model.graph.extent(cls)}
    for node, key in found.items():
        if None in key:
            lacking = names[key.index(None)]
            raise EvaluationError(f"{model.node(node)!r} has no `{lacking}`, which is part of its key")
    return found


def _distinct_keys(model: Model, cls: str) -> set[Key]:
    """Return the keys of all objects of a class; raise `DuplicateKeyError` if two objects have the same key."""
    found = _object_keys(model, cls)
    keys = set(found.values())
    if len(keys) < len(found):
        owner: dict[Key, int] = {}
        for node, key in found.items():
            if key in owner:
                raise DuplicateKeyError(model, cls, (owner[key], node), key)
            owner[key] = node
    return keys


def _sort_keys(keys: set[Key], metamodel: Metamodel, cls: str) -> tuple[Key, ...]:
    return tuple(sorted(keys, key=_sort_function(metamodel, cls)))


def _sort_function(metamodel: Metamodel, cls: str) -> Callable[[Key], tuple[Any, ...]]:
    """Return the function that `sorted` needs to sort keys: by their values, enum literals by their position."""
    attributes = key_attributes(metamodel, cls)
    if not attributes:
        return lambda key: key
    ranks = [a.type.literals.index if isinstance(a.type, EnumType) else lambda value: value for a in attributes]
    return lambda key: tuple(rank(value) for rank, value in zip(ranks, key, strict=True))


def _is_valid_key(metamodel: Metamodel, cls: str, key: Any) -> bool:
    attributes = key_attributes(metamodel, cls)
    if not isinstance(key, list):
        return False
    if not attributes:
        return len(key) == 1 and type(key[0]) is int
    return len(key) == len(attributes) and all(
        accepts(attribute.type, value) for attribute, value in zip(attributes, key, strict=True)
    )
