"""Link the references of an `.xmi` file after all objects exist, and read the documents that it refers to."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from urllib.parse import unquote

from envgraph.errors import LoadError, Source, Span
from envgraph.graph import arrange_targets
from envgraph.lang.interchange._xmi_document import (
    LEAVE_OUT_HINT,
    UNREAD_OBJECT,
    ObjectSpans,
    PendingLink,
    TypeLibrary,
    XmiDocument,
    shortened,
)
from envgraph.lang.read._ecore_types import ECORE, well_known_types
from envgraph.lang.read._object_features import LinkBuilder
from envgraph.metamodel import Reference


class Linker:
    """A linker of the references of one document."""

    def __init__(self, document: XmiDocument) -> None:
        self._document = document
        self._reading = document.reading
        self._model = document.model
        self._order: dict[tuple[int, int], tuple[Reference, list[int]]] = {}

    def read_linked_documents(self) -> Iterator[XmiDocument]:
        """Fetch and yield the documents that links refer to, except those fetched before; report missing documents."""
        for link in self._document.links:
            if "#" not in link.text:
                continue
            for word in (one for one in _link_words(link) if "#" in one):
                path = unquote(word.partition("#")[0])
                name = self._document.name_beside(path)
                if not path or name in self._reading.documents:
                    continue
                self._reading.documents[name] = None
                found = self._fetch(path, link)
                if found:
                    yield found

    def _fetch(self, path: str, link: PendingLink) -> XmiDocument | None:
        span = self._document.word_span(link, next(one for one in _link_words(link) if unquote(one).startswith(path)))
        try:
            source = self._reading.fetch(path, self._document.source.name) if self._reading.fetch else None
        except LoadError as error:
            for problem in error.diagnostics:
                if problem.span is not None and problem.span.source.text:
                    self._reading.report_error(problem)
                else:
                    hint = f"{problem.hint} {LEAVE_OUT_HINT}" if problem.hint else LEAVE_OUT_HINT
                    self._reading.report_unresolved(problem.code, f"`{path}`: {problem.message}", span, hint)
            return None
        if source is None:
            if well_known_types(path) is not None and ECORE in self._reading.packages:
                library = TypeLibrary(self._reading, Source(path, ""))
                self._reading.documents[self._document.name_beside(path)] = library
            elif ":" in path or self._reading.fetch:
                message = f"`{shortened(path)}` is not read, since it is a URL and not the path of a file"
                self._reading.report_unresolved("other-file", message, span, LEAVE_OUT_HINT)
            else:
                message = f"`{shortened(path)}`: there is no such file"
                self._reading.report_unresolved(
                    "missing-file", message, span, "read the model from a file: a text cannot link to files"
                )
            return None
        known = self._reading.documents.get(source.name)  # read before, by another path
        document = known or self._reading.add_document(source)
        self._reading.documents[self._document.name_beside(path)] = document
        return None if known else document

    def link_targets(self, spans: ObjectSpans) -> None:
        """Link the targets of all references that the document has recorded, each target once, and report mistakes."""
        # A target that is named twice is linked once, as in EMF.
        links = LinkBuilder(self._model, self._document.report, spans, repeated=False)
        for link in self._document.links:
            targets = links.link_targets(link.node, link.reference, self._resolved_targets(link))
            if link.reference.many and (link.child_index >= 0 or link.reference.opposite is not None):
                key = link.node, link.reference.index
                _, first = self._order.setdefault(key, (link.reference, targets))
                first += targets if first is not targets else []

    def _resolved_targets(self, link: PendingLink) -> Iterator[tuple[int, Callable[[], Span]]]:
        words = link.text.split() if link.attribute_key != "href" else [link.text]
        for index, word in enumerate(words):
            if ":" in word and "#" not in word and index + 1 < len(words) and "#" in words[index + 1]:
                continue  # the type of the next word's object
            if link.child_index < 0:
                target = self._document.resolve_target(link, word)
            else:
                target = self._reading.child_at(link.node, link.reference.name, link.child_index)
            if target is not None and target != UNREAD_OBJECT:
                yield target, partial(self._document.word_span, link, word)

    def restore_order(self) -> None:
        """Restore the text's order in many-valued references, which links from the opposite end may change."""
        for (node, _), (reference, targets) in self._order.items():
            if (node, reference.name) in self._reading.children:
                targets = [*self._reading.children_in(node, reference)]
            ends = list(self._model.graph.targets(node, reference))
            if ends != targets:
                known = set(ends)
                wanted = [one for one in dict.fromkeys((*targets, *ends)) if one in known]
                arrange_targets(self._model, node, reference, wanted)


def _link_words(link: PendingLink) -> list[str]:
    """Return the words of a link, which name objects and types; an `href` is one word, even if it contains blanks."""
    return [link.text] if link.attribute_key == "href" else link.text.split()
