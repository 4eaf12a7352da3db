"""The model for users, with handles of objects. Programs use its `Graph`, with ids."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from copy import copy

from envgraph.code import shorten_repr
from envgraph.graph.compare import _canonical_hash
from envgraph.graph.history._history import Savepoint
from envgraph.graph.history._version_tree import Version
from envgraph.graph.model import _model_picture
from envgraph.graph.model._graph import Graph
from envgraph.graph.model._handles import Node, assign_features
from envgraph.graph.store import _state_hash
from envgraph.graph.write import _write_errors as refusals
from envgraph.metamodel import Metamodel


@shorten_repr
class Model:
    """A typed attributed graph that instantiates a metamodel.

    Its objects are `Node`s (`create`, `nodes`, `model["name"]`). Writes to them raise the errors that `Graph`
    describes.

    Args:
        metamodel: the metamodel that defines the classes of the objects.
        name: the name in reports.

    Attributes:
        graph: the same objects by ids, for programs.
    """

    def __init__(self, metamodel: Metamodel, name: str = "model") -> None:
        self.metamodel = metamodel
        self.graph = Graph(self, metamodel, name)

    state_hash = _state_hash.state_hash
    canonical_hash = _canonical_hash.canonical_hash

    picture = _model_picture.picture
    to_dot = _model_picture.to_dot
    to_svg = _model_picture.to_svg
    _repr_svg_ = _model_picture.notebook_svg

    @property
    def name(self) -> str:
        """Return the name of the model in reports."""
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
            **features: attribute values; targets as `Node`s, for a many-reference an iterable of `Node`s.

        Raises:
            TypeMismatch: an unknown or abstract class, an unknown feature, a value of the wrong type.
            InvalidArgument: another object has the name.
            RuleError: a reference is full. The object is not created then.
        """
        if self.graph.store.loading:
            return _create_node(self, cls, object_name, features)
        with self.transaction():
            return _create_node(self, cls, object_name, features)

    def node(self, id: int) -> Node:
        """Return a handle to the object with an id.

        Raises:
            InvalidArgument: no object has this id.
        """
        if not self.graph.alive(id):
            raise refusals.missing_object_error(self.graph, id)
        return Node(self, id)

    def nodes(self, cls: str | None = None) -> list[Node]:
        """Return handles to all objects, or to the instances of a class and its subclasses."""
        ids = self.graph.store.nodes() if cls is None else self.graph.extent(cls)
        return [Node(self, id) for id in ids]

    def __getitem__(self, object_name: str) -> Node:
        """Return the object with a name, or at a grid position in a file, such as `tile[3, 1]`.

        Raises:
            InvalidArgument: no object has the name.
        """
        found = self.graph.find_object(object_name)
        if found is None:
            raise refusals.unknown_object_error(self.graph, object_name)
        return Node(self, found)

    def __contains__(self, item: object) -> bool:
        """Return True if `item` is a name that `model[item]` finds, or a handle to an existing object of this model."""
        if isinstance(item, Node):
            return item.model is self and self.graph.alive(item.id)
        return isinstance(item, str) and self.graph.find_object(item) is not None

    def __iter__(self) -> Iterator[Node]:
        """Iterate over handles to all objects that exist at the start of the iteration."""
        return iter(self.nodes())

    def __len__(self) -> int:
        return sum(map(len, self.graph.store.extents))

    def __bool__(self) -> bool:
        """Return True, even for a model without objects."""
        return True

    def copy(self) -> Model:
        """Return another model in the same state (ids, every order, hash), without versions, savepoints and views."""
        return copy(self)  # implemented in `envgraph.graph.interchange._copying`

    def __deepcopy__(self, _: object) -> Model:
        return self.copy()

    def __repr__(self) -> str:
        return f"<Model {self.name}: {len(self)} objects of {self.metamodel.name}>"

    # --- transactions and versions

    def transaction(self) -> AbstractContextManager[Savepoint]:
        """Return a context manager that undoes the changes of its block if an exception leaves it, else keeps them."""
        return self.graph.history.transaction()

    def unwind(self) -> None:
        """Close all open savepoints and undo the changes made since the outermost one was opened.

        Ctrl-C may arrive before a program has received a new savepoint. Only this method can close that savepoint.
        """
        self.graph.history.unwind(0)

    def loading(self) -> AbstractContextManager[None]:
        """Return a context manager for building a model without a journal. Views are recomputed at its end.

        Raises:
            TransactionError: a savepoint is open or a version is in use, or a savepoint is requested inside the block.
        """
        return self.graph.history.load()

    @property
    def version(self) -> Version | None:
        """Return the version of the current state, or None if the state is not committed or a savepoint is open."""
        return self.graph.history.version()

    def commit(self) -> Version:
        """Create a version of the current state, or return the last version if nothing has changed since.

        The version exists as long as a program refers to it.

        Raises:
            TransactionError: a savepoint is open, or the model is loading.
        """
        return self.graph.history.commit()

    def checkout(self, version: Version, *, discard: bool = False) -> None:
        """Restore a committed state exactly: ids, order, hash.

        Args:
            version: a version of this model.
            discard: undo uncommitted changes instead of refusing.

        Raises:
            InvalidArgument: `version` is not a version.
            TransactionError: a version of another model, an open savepoint, or uncommitted changes.
        """
        self.graph.history.checkout(version, discard)

    def check_integrity(self) -> None:
        """Assert that all stored data are consistent, by recomputing them. A failure is a bug of envgraph."""
        self.graph.check_integrity()


def _create_node(model: Model, cls: str, object_name: str | None, features: Mapping[str, object]) -> Node:
    node = Node(model, model.graph.new(cls, object_name))
    assign_features(node, features)
    return node
