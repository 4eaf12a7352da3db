"""The elementary facts that a model consists of, and who may hear of their changes."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from envgraph.code import short_repr
from envgraph.metamodel import Attribute, Reference, Value


@short_repr
class ClassFact(NamedTuple):
    """The object is an instance of exactly this class."""

    cls: str
    node: int


@short_repr
class ValueFact(NamedTuple):
    """The object has this value in the attribute."""

    attribute: Attribute
    node: int
    value: Value


@short_repr
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
    """Hears of every change of a store that lists it in `listeners`, one elementary fact at a time. It must not write.

    Setting a value, retyping and moving are removals followed by insertions.
    """

    def inserted(self, fact: Fact) -> None:
        """The fact is new; the model already has it."""

    def removing(self, fact: Fact) -> None:
        """The fact is about to go; the model still has it."""

    def restored(self) -> None:
        """The model is in an earlier or another state: a rollback, a checkout, or a load has ended."""
