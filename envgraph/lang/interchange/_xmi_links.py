"""The references of an `.xmi` file: other documents, and links between objects that are all there."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from urllib.parse import unquote

from envgraph.errors import LoadError, Note, Span, name_hint, with_article
from envgraph.graph import arrange_targets
from envgraph.lang.interchange._xmi_document import LOST, Document, Link, Spans, short
from envgraph.lang.read._features import add_link, has_room
from envgraph.metamodel import Reference

_NAMED = "objects are named by `xmi:id`, by an `iD` attribute of the metamodel, or by place: `//@...`"

_LEAVE_OUT = "`--allow-unresolved` leaves out links to what is nowhere"

_MANY = 1000
"""Among more names than this, nobody looks for the nearest."""


class Linker:
    """Makes the links of one document."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._reading = document.reading
        self._model = document.model
        self._lists: list[tuple[int, Reference, list[int]]] = []

    def others(self) -> Iterator[Document]:
        """The documents that links name, read now."""
        for link in self._document.links:
            if "#" not in link.text:
                continue
            for word in (one for one in link.text.split() if "#" in one):
                path = unquote(word.partition("#")[0])
                name = self._document.beside(path)
                if not path or name in self._reading.documents:
                    continue
                self._reading.documents[name] = None
                found = self._fetch(path, link)
                if found:
                    yield found

    def _fetch(self, path: str, link: Link) -> Document | None:
        span = self._document.where(
            link, next(one for one in link.text.split() if unquote(one).startswith(path))
        )
        if re.match(r"[a-zA-Z][a-zA-Z0-9+.-]+:", path):
            message = f"`{short(path)}` is not read: only files beside this one are"
            self._reading.unresolved("other-file", message, span, _LEAVE_OUT)
            return None
        if self._reading.fetch is None:
            message = f"`{short(path)}`: there is no such file"
            self._reading.unresolved("missing-file", message, span, "a text that is no file names no others")
            return None
        try:
            source = self._reading.fetch(path, self._document.source.name)
        except LoadError as error:
            for problem in error.diagnostics:
                if problem.span is not None and problem.span.source.text:
                    self._reading.add(problem)
                else:
                    hint = f"{problem.hint} {_LEAVE_OUT}" if problem.hint else _LEAVE_OUT
                    self._reading.unresolved(problem.code, f"`{path}`: {problem.message}", span, hint)
            return None
        known = self._reading.documents.get(source.name)  # by another path
        document = known or self._reading.enter(source)
        self._reading.documents[self._document.beside(path)] = document
        return None if known else document

    def link(self) -> None:
        """Makes the links of all references."""
        for link in self._document.links:
            self._resolve_link(link)

    def _resolve_link(self, link: Link) -> None:
        model, reference = self._model, link.reference
        words = link.text.split()
        targets: dict[int, None] = {}
        for index, word in enumerate(words):
            if ":" in word and "#" not in word and index + 1 < len(words) and "#" in words[index + 1]:
                continue  # the type of the object that comes next
            target = self._target(link, word)
            where = partial(self._document.where, link, word)
            if target is None or target == LOST or target in targets:
                continue  # to say it twice is to say it once, as in EMF
            if not self._reading.metamodel.is_a(model.class_of(target), reference.target):
                self._wrong_class(link, word, target)
            elif not has_room(reference, len(targets), self._document.report, where):
                break
            else:
                targets[target] = None
                self._add(link, target, where)
        if len(targets) > 1 and reference.opposite is not None:
            self._lists.append((link.node, reference, list(targets)))

    def _add(self, link: Link, target: int, where: Callable[[], Span]) -> None:
        model, reference = self._model, link.reference
        if model.has_link(link.node, reference, target):
            return  # the opposite has said so
        relation = model.store.relations[reference.index]
        child = target if relation.containment else link.node if relation.contained else None
        if child is not None and model.container(child) is not None:
            message = f"{model.describe(child)} is in another container already"
            hint = "an object has one container at most"
            self._document.report("two-containers", message, where(), hint)
            return
        add_link(model, link.node, reference, target, self._document.report, where)

    def reorder(self) -> None:
        """Gives many-valued references the order of the text, which making links from the other end has changed."""
        for node, reference, targets in self._lists:
            ends = self._model.targets(node, reference)
            if list(ends) != targets and sorted(ends) == sorted(targets):
                arrange_targets(self._model, node, reference, targets)

    def _wrong_class(self, link: Link, word: str, target: int) -> None:
        cls = self._model.class_of(target)
        message = (
            f"`{link.reference}` takes objects of class `{link.reference.target}`, "
            f"and {self._model.describe(target)} is {with_article(cls)}"
        )
        hint = f"name {with_article(link.reference.target)}"
        where = self._document.where(link, word)
        self._document.report("wrong-type", message, where, hint, notes=self._note(target))

    def _note(self, target: int) -> tuple[Note, ...]:
        span = Spans(self._reading).get(target)
        return (Note("it is here", span),) if span else ()

    def _target(self, link: Link, word: str) -> int | None:
        """The object that a word names; None, reported, if there is none."""
        path, mark, fragment = word.rpartition("#")
        if not mark:
            fragment = word
        document: Document | None = self._document
        if path:
            document = self._reading.documents.get(self._document.beside(unquote(path)))
            if document is None:
                return LOST  # which was reported
        assert document is not None
        found = document.find(fragment)
        if found is None:
            known = (*document.ids, *document.identified)
            hint = name_hint(fragment, known) if len(known) <= _MANY and fragment[:1] != "/" else None
            if not known and not fragment.startswith("/"):
                hint = _NAMED
            if hint is None and fragment.startswith("/"):
                hint = "a path begins at the root, and counts from 0: `//@reference.0`"
            where = self._document.where(link, word)
            self._reading.unresolved(
                "unknown-object", f"there is no object `{short(word)}`", where, hint or _LEAVE_OUT
            )
        return found
