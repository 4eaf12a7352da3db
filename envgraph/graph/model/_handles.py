"""Handles of objects, and live lists of their targets and values, for users."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, MutableSequence, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeVar, overload

from envgraph.code import shorten_repr
from envgraph.errors import SHOWN, InvalidArgument, TypeMismatch, did_you_mean
from envgraph.graph.write import _write_errors as refusals
from envgraph.metamodel import LARGEST_INT, Attribute, Feature, Reference, Value

if TYPE_CHECKING:
    from envgraph.graph.model._model import Model


@shorten_repr
class Node:
    """A handle to an object of a model. Handles are compared by model and id.

    Features are attributes of the handle: `tile.x`, `tile.x = 3`, `tile.right = other`, `forest.states.append(tile)`.
    Reading a many-reference returns `Targets`, and reading a multi-valued attribute returns a `ValueList`. An unset
    attribute and an empty single reference read as None. `node["id"]` accesses a feature whose name the handle itself
    uses (`id`, `model`, `cls`, ...).
    """

    __slots__ = ("id", "model")

    id: int
    model: Model

    def __init__(self, model: Model, id: int) -> None:
        object.__setattr__(self, "model", model)
        object.__setattr__(self, "id", id)

    @property
    def cls(self) -> str:
        """Return the name of the object's class."""
        return self.model.graph.class_of(self.id)

    @property
    def object_name(self) -> str | None:
        """Return the name of the object, or None. Assigning renames the object."""
        self.model.graph.class_of(self.id)
        return self.model.graph.object_name(self.id)

    @object_name.setter
    def object_name(self, name: str | None) -> None:
        self.model.graph.set_object_name(self.id, name)

    @property
    def container(self) -> Node | None:
        """Return the object that contains this object, or None."""
        self.model.graph.class_of(self.id)
        found = self.model.graph.container(self.id)
        return Node(self.model, found[0]) if found else None

    def is_a(self, cls: str) -> bool:
        """Return True if the object is an instance of a class or of one of its subclasses."""
        return self.model.metamodel.is_a(self.cls, cls)

    def delete(self, semantics: Literal["dpo", "spo"] = "dpo") -> None:
        """Delete the object and everything that it contains. "dpo" refuses dangling links, "spo" deletes them too."""
        self.model.graph.delete(self.id, semantics)

    def retype(self, cls: str, lossy: bool = False) -> None:
        """Make the object an instance of another class. `lossy` removes links that it forbids; see `Graph.retype`."""
        self.model.graph.retype(self.id, cls, lossy)

    def __getattr__(self, name: str) -> Any:
        # Special names are never features. Looking them up must work without a model, for copying and pickling.
        if name.startswith("__"):
            raise AttributeError(name)
        return _read_feature(self, _feature_named(self, name))

    def __setattr__(self, name: str, value: object) -> None:
        if name in _OWN_NAMES:
            if name == "object_name":
                object.__setattr__(self, name, value)
                return
            raise AttributeError(
                f'`{name}` belongs to the handle; write `node["{name}"] = ...` for a feature of that name'
            )
        _write_feature(self, _feature_named(self, name), value)

    def __getitem__(self, name: str) -> Any:
        """Return the value of the feature with the given name; see `Node`."""
        return _read_feature(self, _feature_named(self, name))

    def __setitem__(self, name: str, value: object) -> None:
        """Set the value of the feature with the given name."""
        _write_feature(self, _feature_named(self, name), value)

    def __dir__(self) -> list[str]:
        names = set(object.__dir__(self))
        if self.model.graph.alive(self.id):
            names.update(self.model.metamodel.features(self.cls))
        return sorted(names)

    def __copy__(self) -> Node:
        return self

    def __deepcopy__(self, _: object) -> Node:
        """Return this handle itself, because its model is not copied with it."""
        return self

    def __reduce__(self) -> tuple[type[Node], tuple[Model, int]]:
        """Return the data for pickling: the model, which is pickled once for all handles together, and the id."""
        return Node, (self.model, self.id)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Node) and self.model is other.model and self.id == other.id

    def __hash__(self) -> int:
        return hash((id(self.model), self.id))

    def __repr__(self) -> str:
        if not self.model.graph.alive(self.id):
            return f"<no object {self.id}>"
        name = self.model.graph.object_name(self.id)
        key = (f"{key}={self[key]!r}" for key in self.model.metamodel.key(self.cls))
        return f"<{' '.join([f'{self.cls}#{self.id}', *([name] if name else []), *key])}>"


_OWN_NAMES = frozenset(name for name in dir(Node) if not name.startswith("_"))


_Item = TypeVar("_Item")


class _LiveList(Sequence[_Item]):
    """A live sequence of the values or targets of a feature: each access reads the model."""

    __slots__ = ("_feature", "_node")

    def __init__(self, node: Node, feature: Any) -> None:
        self._node = node
        self._feature = feature

    def _item_for(self, held: Any) -> _Item:
        """Return the item for a stored value: the value itself, or the handle for the id of a target."""
        return held  # type: ignore[no-any-return]

    def __len__(self) -> int:
        return len(_stored_items(self._node, self._feature))

    @overload
    def __getitem__(self, index: int) -> _Item: ...
    @overload
    def __getitem__(self, index: slice) -> list[_Item]: ...
    def __getitem__(self, index: int | slice) -> _Item | list[_Item]:
        held = _stored_items(self._node, self._feature)
        return [*map(self._item_for, held[index])] if isinstance(index, slice) else self._item_for(held[index])

    def __eq__(self, other: object) -> bool:
        """Return True if `other` is a list, tuple or sequence of the same kind with equal items in the same order."""
        if isinstance(other, list | tuple | type(self)):
            return list(self) == list(other)
        return NotImplemented

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        """Return the text of a list; if the list is long, only its first items and the number of all items."""
        if len(self) <= SHOWN.items:
            return repr(list(self))
        return f"[{', '.join(map(repr, self[: SHOWN.items]))}, ... {len(self):,} in all]"


@shorten_repr
class Targets(_LiveList[Node]):
    """The live targets of a many-reference: reading and writing accesses the model.

    An iteration covers the targets that exist at its start. Targets are in the order in which they were added. If there
    are more than 32, a removal moves the last target into the gap.
    """

    __slots__ = ()

    def _item_for(self, held: int) -> Node:
        return Node(self._node.model, held)

    def append(self, target: Node) -> None:
        """Add a target. A target linked already is left unchanged.

        As with an assignment, the target is first unlinked from its old container, or from its old source if the
        opposite is single-valued.
        """
        model = self._node.model
        model.graph.add_target(self._node.id, self._feature, _target_id(model, self._feature, target))

    def insert(self, index: int, target: Node) -> None:
        """Add a target at a position, as `list.insert` does. A target linked already is moved.

        Raises:
            InvalidArgument: the position is not an int.
        """
        if type(index) is not int:
            raise InvalidArgument(f"a position must be an int, not {index!r}")
        model = self._node.model
        model.graph.insert_target(self._node.id, self._feature, index, _target_id(model, self._feature, target))

    def extend(self, targets: Iterable[Node]) -> None:
        """Add several targets, as `append` does one by one."""
        for target in list(targets):
            self.append(target)

    def remove(self, target: Node) -> None:
        """Remove a target.

        Raises:
            InvalidArgument: the object is not a target.
            TypeMismatch: a query defines the reference.
        """
        model = self._node.model
        if model.graph.defined_features and self._feature in model.graph.defined_features:
            raise refusals.lacks_feature_error(model.graph, self._node.id, self._feature)
        if not model.graph.unlink(self._node.id, self._feature, _target_id(model, self._feature, target)):
            raise InvalidArgument(f"{target!r} is not among the targets of `{self._feature.name}`")

    def clear(self) -> None:
        """Remove all targets."""
        self._node.model.graph.set_targets(self._node.id, self._feature, ())

    def __iter__(self) -> Iterator[Node]:
        model = self._node.model
        return (Node(model, id) for id in tuple(_stored_items(self._node, self._feature)))

    def __contains__(self, item: object) -> bool:
        if not isinstance(item, Node) or item.model is not self._node.model:
            return False
        return item.id in _stored_items(self._node, self._feature)


@shorten_repr
class ValueList(_LiveList[Value], MutableSequence[Value]):
    """The live values of a multi-valued attribute: a list that reads and writes the model.

    An iteration covers the values that exist at its start. If values must be unique, inserting an existing value
    changes nothing. Errors are the errors of `Graph.set_value`.
    """

    __slots__ = ()

    def _set_values(self, values: list[Value]) -> None:
        self._node.model.graph.set_value(self._node.id, self._feature, values)

    def insert(self, index: int, value: Value) -> None:
        """Insert a value as `list.insert` does. If values must be unique, an existing value is not inserted."""
        self._node.model.graph.insert_value(self._node.id, self._feature, index, value)

    def __setitem__(self, index: Any, value: Any) -> None:
        values = list(self)
        values[index] = value
        self._set_values(values)

    def __delitem__(self, index: int | slice) -> None:
        if isinstance(index, slice):
            values = list(self)
            del values[index]
            self._set_values(values)
        else:
            self._node.model.graph.remove_value_at(self._node.id, self._feature, index)

    def reverse(self) -> None:
        """Reverse the order of the values in one write, because swapping them singly would repeat unique values."""
        self._set_values(list(self)[::-1])

    def __iter__(self) -> Iterator[Value]:
        return iter(tuple(_stored_items(self._node, self._feature)))

    def __contains__(self, item: object) -> bool:
        return item in _stored_items(self._node, self._feature)


def assign_features(node: Node, features: Mapping[str, object]) -> None:
    """Set several features of an object, given by name. Raise TypeMismatch for an unknown name."""
    for name, value in features.items():
        _write_feature(node, _feature_named(node, name, TypeMismatch), value)


def _feature_named(node: Node, name: str, error: type[Exception] = AttributeError) -> Feature:
    features = node.model.metamodel.features(node.cls)
    found = features.get(name)
    if found is None:
        hint = did_you_mean(name, features)
        raise error(f"`{node.cls}` has no feature `{name}`" + (f"; {hint}" if hint else ""))
    return found


def _read_feature(node: Node, feature: Feature) -> Value | ValueList | Node | Targets | None:
    graph = node.model.graph
    if feature.many:
        return ValueList(node, feature) if isinstance(feature, Attribute) else Targets(node, feature)
    if graph.defined_features and feature in graph.defined_features:
        found = _stored_items(node, feature)
        if len(found) > 1:
            query = graph.defined_features[feature].query
            raise InvalidArgument(
                f"`{feature}` has at most one value, but query `{query}` returns {len(found)} for {node!r}"
            )
        return next((one if isinstance(feature, Attribute) else Node(node.model, one) for one in found), None)
    if isinstance(feature, Attribute):
        return graph.value(node.id, feature)
    target = graph.target(node.id, feature)
    return None if target is None else Node(node.model, target)


def _stored_items(node: Node, feature: Feature) -> Sequence[Any]:
    """Return the values of a feature, or the ids of its targets; see `Graph.read_feature`."""
    node.cls  # noqa: B018 - raises for a deleted object
    return node.model.graph.read_feature(node.id, feature)


def _write_feature(node: Node, feature: Feature, value: object) -> None:
    model = node.model
    if isinstance(feature, Attribute):
        if type(value) is int and not -LARGEST_INT - 1 <= value <= LARGEST_INT:
            raise refusals.wrong_value_error(feature, value)
        if feature.many and isinstance(value, Iterable) and not isinstance(value, str):
            value = list(value)
        model.graph.set_value(node.id, feature, value)  # type: ignore[arg-type]  # checked there
    elif feature.many:
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise TypeMismatch(f"`{feature}` takes several objects: write a list of them, not {value!r}")
        model.graph.set_targets(node.id, feature, [_target_id(model, feature, target) for target in value])
    else:
        model.graph.set_target(node.id, feature, None if value is None else _target_id(model, feature, value))


def _target_id(model: Model, reference: Reference, target: object) -> int:
    if not isinstance(target, Node):
        raise TypeMismatch(f"`{reference}` leads to `{reference.target}`, not to {target!r} ({type(target).__name__})")
    if target.model is not model:
        raise TypeMismatch(f"{target!r} is an object of another model")
    return target.id
