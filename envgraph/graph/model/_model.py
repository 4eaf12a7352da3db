"""The model: what people use of it, with handles; programs use its `Graph`, by ids."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from copy import copy

from envgraph.code import short_repr
from envgraph.graph.compare import _canonical
from envgraph.graph.history._history import Savepoint
from envgraph.graph.history._versions import Version
from envgraph.graph.model import _picture
from envgraph.graph.model._graph import Graph
from envgraph.graph.model._node import Node, assign_features
from envgraph.graph.store import _hashing
from envgraph.graph.write import _refusals as refusals
from envgraph.metamodel import Metamodel


@short_repr
class Model:
    """A typed attributed graph that instantiates a metamodel.

    Its objects are `Node`s (`create`, `nodes`, `model["name"]`); writing to them raises what `Graph` says.

    Args:
        metamodel: what the objects are instances of.
        name: for reports.

    Attributes:
        graph: the same objects by ids, for programs.
    """

    def __init__(self, metamodel: Metamodel, name: str = "model") -> None:
        self.metamodel = metamodel
        self.graph = Graph(self, metamodel, name)

    state_hash = _hashing.state_hash
    canonical_hash = _canonical.canonical_hash

    picture = _picture.picture
    to_dot = _picture.to_dot
    to_svg = _picture.to_svg
    _repr_svg_ = _picture.as_svg

    @property
    def name(self) -> str:
        """Name of the model, for reports."""
        return self.graph.name

    @name.setter
    def name(self, name: str) -> None:
        self.graph.name = name

    # --- handles

    def create(self, cls: str, /, *, object_name: str | None = None, **features: object) -> Node:
        """Create an object, set its features, and return a handle to it.

        Args:
            cls: a concrete class.
            object_name: unique name of the object, or None.
            **features: attribute values; targets as `Node`s, for a many-reference an iterable of them.

        Raises:
            TypeMismatch: an unknown or abstract class, an unknown feature, a value of the wrong type.
            InvalidArgument: the object name is taken.
            RuleError: a reference is full. The object is not created then.
        """
        if self.graph.store.loading:
            return _create(self, cls, object_name, features)
        with self.transaction():
            return _create(self, cls, object_name, features)

    def node(self, id: int) -> Node:
        """A handle to an object.

        Raises:
            InvalidArgument: there is no such object.
        """
        if not self.graph.alive(id):
            raise refusals.missing(self.graph, id)
        return Node(self, id)

    def nodes(self, cls: str | None = None) -> list[Node]:
        """Handles to all objects, or to the instances of a class, subclasses included."""
        ids = self.graph.store.nodes() if cls is None else self.graph.extent(cls)
        return [Node(self, id) for id in ids]

    def __getitem__(self, object_name: str) -> Node:
        """The object with this name.

        Raises:
            InvalidArgument: no object has it.
        """
        found = self.graph.find_object(object_name)
        if found is None:
            raise refusals.unknown_object(self.graph, object_name)
        return Node(self, found)

    def __contains__(self, item: object) -> bool:
        """Return whether an object has this name, or this handle stands for an object of the model."""
        if isinstance(item, Node):
            return item.model is self and self.graph.alive(item.id)
        return isinstance(item, str) and self.graph.find_object(item) is not None

    def __iter__(self) -> Iterator[Node]:
        """Handles to all objects, as they are at the start."""
        return iter(self.nodes())

    def __len__(self) -> int:
        return sum(map(len, self.graph.store.extents))

    def __bool__(self) -> bool:
        """True: a model without objects is a model."""
        return True

    def copy(self) -> Model:
        """Another model in the same state (ids, every order, hash), without versions, savepoints and views."""
        return copy(self)  # `envgraph.graph.interchange._copying` says how

    def __deepcopy__(self, _: object) -> Model:
        return self.copy()

    def __repr__(self) -> str:
        return f"<Model {self.name}: {len(self)} objects of {self.metamodel.name}>"

    # --- transactions and versions

    def transaction(self) -> AbstractContextManager[Savepoint]:
        """Everything inside happens, or, if an exception leaves the block, nothing of it."""
        return self.graph.history.transaction()

    def unwind(self) -> None:
        """Roll back until no savepoint is open.

        Ctrl-C may come before what `savepoint` returns has reached anybody. Then only this closes it.
        """
        self.graph.history.unwind(0)

    def loading(self) -> AbstractContextManager[None]:
        """Build a model without a journal; views are made anew at the end.

        Raises:
            TransactionError: a savepoint is open or a version is held; or, inside the block, a savepoint is asked for.
        """
        return self.graph.history.load()

    @property
    def version(self) -> Version | None:
        """The version that the model is in; None if there are uncommitted changes, or nobody holds a version."""
        return self.graph.history.version()

    def commit(self) -> Version:
        """Name the present state. The version lives as long as somebody holds it.

        Raises:
            TransactionError: a savepoint is open.
        """
        return self.graph.history.commit()

    def checkout(self, version: Version, *, discard: bool = False) -> None:
        """Put the model into a committed state, exactly as it was then: ids, order, hash.

        Args:
            version: a version of this model.
            discard: lose uncommitted changes instead of refusing.

        Raises:
            InvalidArgument: that is no version.
            TransactionError: a version of another model, an open savepoint, or uncommitted changes.
        """
        self.graph.history.checkout(version, discard)

    def check_integrity(self) -> None:
        """Assert that all that is stored agrees, by a computation from scratch: a failure is a bug of envgraph."""
        self.graph.check_integrity()


def _create(model: Model, cls: str, object_name: str | None, features: Mapping[str, object]) -> Node:
    node = Node(model, model.graph.new(cls, object_name))
    assign_features(node, features)
    return node
