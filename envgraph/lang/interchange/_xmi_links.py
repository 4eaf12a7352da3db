"""The references of an `.xmi` file: other documents, and links between objects that are all there."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from urllib.parse import unquote

from envgraph.errors import LoadError, Span, name_hint
from envgraph.graph import arrange_targets
from envgraph.lang.interchange._xmi_document import LOST, Document, Link, Spans, short
from envgraph.lang.read._features import Links
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
        # To name an object twice is to name it once, as in EMF.
        links = Links(self._model, self._document.report, Spans(self._reading), repeated=False)
        for link in self._document.links:
            targets = links.fill(link.node, link.reference, self._targets(link))
            if len(targets) > 1 and link.reference.opposite is not None:
                self._lists.append((link.node, link.reference, targets))

    def _targets(self, link: Link) -> Iterator[tuple[int, Callable[[], Span]]]:
        words = link.text.split()
        for index, word in enumerate(words):
            if ":" in word and "#" not in word and index + 1 < len(words) and "#" in words[index + 1]:
                continue  # the type of the object that comes next
            target = self._target(link, word)
            if target is not None and target != LOST:
                yield target, partial(self._document.where, link, word)

    def reorder(self) -> None:
        """Gives many-valued references the order of the text, which making links from the other end has changed."""
        for node, reference, targets in self._lists:
            ends = self._model.targets(node, reference)
            if list(ends) != targets and sorted(ends) == sorted(targets):
                arrange_targets(self._model, node, reference, targets)

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
