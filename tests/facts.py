"""The elementary facts that a model consists of, and what hears of their changes as views do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from envgraph.code import shorten_repr
from envgraph.graph import Model
from envgraph.metamodel import Attribute, Reference, Value


@shorten_repr
class ClassFact(NamedTuple):
    """The object is an instance of exactly this class."""

    cls: str
    node: int


@shorten_repr
class ValueFact(NamedTuple):
    """The object has this value in the attribute."""

    attribute: Attribute
    node: int
    value: Value


@shorten_repr
class LinkFact(NamedTuple):
    """There is a link from source to target, of the first reference of an opposite pair."""

    reference: Reference
    source: int
    target: int


Fact = ClassFact | ValueFact | LinkFact


class Hearer(Protocol):
    """Is notified of changes, one fact at a time."""

    def inserted(self, fact: Fact) -> None:
        """The fact is new; the model already has it."""

    def removing(self, fact: Fact) -> None:
        """The fact is about to go; the model still has it."""

    def restored(self) -> None:
        """The model is in an earlier or another state: a rollback, a checkout, or a load has ended."""


class Notified:
    """A `Follower` of a store that registers its functions there, behind those of others.

    Views that are made later register theirs in the same places: then it hears nothing more.
    """

    def __init__(self, model: Model, hearer: Hearer) -> None:
        self._store, self._hearer = model.graph.store, hearer
        self._store.followers.append(self)
        self._register()

    def _register(self) -> None:
        store, metamodel, hearer = self._store, self._store.metamodel, self._hearer

        def after(hook: Hook, fact: Callable[..., Fact]) -> Hook:
            return _both(hook, lambda *what: hearer.inserted(fact(*what)))

        def before(hook: Hook, fact: Callable[..., Fact]) -> Hook:
            return _both(hook, lambda *what: hearer.removing(fact(*what)))

        def class_fact(index: int) -> Callable[[int], Fact]:
            return lambda node: ClassFact(metamodel.class_list[index].name, node)

        def value_fact(attribute: Attribute) -> Callable[[int, Value], Fact]:
            return lambda node, value: ValueFact(attribute, node, value)

        def link_fact(reference: Reference) -> Callable[[int, int], Fact]:
            return lambda source, target: LinkFact(reference, source, target)

        for index in range(len(metamodel.class_list)):
            store.class_added[index] = after(store.class_added[index], class_fact(index))
            store.class_removing[index] = before(store.class_removing[index], class_fact(index))
        for attribute in metamodel.attributes:
            index, of_values = attribute.index, value_fact(attribute)
            store.value_added[index] = after(store.value_added[index], of_values)
            store.value_removing[index] = before(store.value_removing[index], of_values)
        for relation in store.relations:
            relation.added = after(relation.added, link_fact(relation.fact))
            relation.removing = before(relation.removing, link_fact(relation.fact))
        views = store.retyping_callbacks

        def retyping(old: int, new: int) -> tuple[Hook, Hook]:
            removing, added = views(old, new) if views else (None, None)
            return before(removing, class_fact(old)), after(added, class_fact(new))

        store.retyping_callbacks = retyping

    def process_pending(self) -> None:
        """Do nothing: nothing is ever pending."""

    def on_release(self) -> None:
        """Do nothing: all changes are known already."""

    def on_rollback(self) -> None:
        """Pass it on."""
        self._hearer.restored()

    on_checkout = on_interruption = on_rollback

    def on_load_start(self) -> None:
        """Hear nothing until the load has ended."""
        store = self._store
        for hooks in (store.class_added, store.class_removing, store.value_added, store.value_removing):
            hooks[:] = [None] * len(hooks)
        for relation in store.relations:
            relation.added = relation.removing = None
        store.retyping_callbacks = None

    def on_load_end(self) -> None:
        """Hear of changes again."""
        self._register()
        self._hearer.restored()


Hook = Callable[..., object] | None


def _both(first: Hook, second: Callable[..., object]) -> Callable[..., object]:
    def call(*arguments: Any) -> None:
        if first is not None:
            first(*arguments)
        second(*arguments)

    return call
