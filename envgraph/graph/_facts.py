"""The elementary facts that a model consists of, and who may hear of their changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from envgraph.errors import InvalidArgument
from envgraph.metamodel import Attribute, Reference, Value

if TYPE_CHECKING:
    from envgraph.graph._graph import Graph


class ClassFact(NamedTuple):
    """The object is an instance of exactly this class."""

    cls: str
    node: int


class ValueFact(NamedTuple):
    """The object has this value in the attribute."""

    attribute: Attribute
    node: int
    value: Value


class LinkFact(NamedTuple):
    """There is a link from source to target.

    The two references of an opposite pair hold the same links: such a link is one fact, of the reference that is
    declared first. A link of a reference that is its own opposite is one fact too, from the lower id to the higher.
    """

    reference: Reference
    source: int
    target: int


Fact = ClassFact | ValueFact | LinkFact


class Listener(Protocol):
    """Hears of every change of a model, one elementary fact at a time. It must not write to the model.

    Setting a value, retyping and moving are removals followed by insertions.
    """

    def inserted(self, fact: Fact) -> None:
        """The fact is new; the model already has it."""

    def removing(self, fact: Fact) -> None:
        """The fact is about to go; the model still has it."""

    def restored(self) -> None:
        """The model is in an earlier or another state: a rollback, a checkout, or a load has ended."""


def subscribe(graph: Graph, listener: Listener) -> None:
    """Tell a listener of every change from now on, after those that are there already."""
    graph.store.listeners.append(listener)


def unsubscribe(graph: Graph, listener: Listener) -> None:
    """Stop notifying a listener.

    Raises:
        InvalidArgument: it is not subscribed.
    """
    for index, other in enumerate(graph.store.listeners):
        if other is listener:
            del graph.store.listeners[index]
            return
    raise InvalidArgument("the listener is not subscribed")
