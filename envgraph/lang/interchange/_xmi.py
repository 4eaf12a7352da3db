"""`.xmi` files: the XML to objects.

A file is read as it streams by: each tag becomes an object at once, and only references wait until all objects are
there. pyecore ends at the first mistake, knows lines alone, lets some mistakes pass, and takes four times as long; the
two are compared in the tests.

A document may name objects of others; those are read into the same model.
"""

from __future__ import annotations

import posixpath
from urllib.parse import unquote

from envgraph.errors import Source, has_errors
from envgraph.graph import Model
from envgraph.lang.interchange._xmi_document import Document, Fetch, Reading, Spans
from envgraph.lang.interchange._xmi_links import Linker
from envgraph.lang.interchange._xmi_tags import TagReader
from envgraph.lang.read._model import ModelFile, ModelText
from envgraph.lang.syntax._xml import XSI, Reader, Stop, XmlPlaces, namespaces
from envgraph.metamodel import Metamodel

_HEAD = 100_000
"""The first tag of a file ends before this character."""


def read_xmi(
    source: Source,
    metamodel: Metamodel | None,
    lost: frozenset[str] = frozenset(),
    fetch: Fetch | None = None,
    *,
    allow_unresolved: bool = False,
) -> ModelFile:
    """The model of an `.xmi` file, and all that is wrong with it.

    Args:
        source: the file.
        metamodel: what its objects are instances of; None when that could not be loaded: then only the XML is checked.
        lost: names that errors elsewhere may have taken away.
        fetch: reads another file, by its path and the name of the file that names it; None when there are no others.
        allow_unresolved: whether links to what is nowhere are left out, with a warning.
    """
    name = posixpath.basename(source.name).rpartition(".")[0] or source.name
    model = Model(metamodel or Metamodel("", ()), name)
    reading = Reading(model, lost, fetch, allow_unresolved=allow_unresolved)
    with reading.model.loading():
        first = reading.enter(source)
        if metamodel is None:
            TagReader(first).check_syntax()
        else:
            _read_all(first)
    reading.diagnostics.extend(reading.omissions())
    complete = metamodel is not None and not has_errors(reading.diagnostics)
    text = ModelText(
        name,
        source.span(0, 0),
        metamodel.name if metamodel else "",
        reading.model if complete else None,
        Spans(reading),
    )
    return ModelFile((text,), tuple(reading.diagnostics), tuple(reading.documents))


def _read_all(first: Document) -> None:
    """Reads a document, those that it names, and then all references."""
    try:
        linkers = []
        waiting = [first]
        for document in waiting:
            TagReader(document).read()
            linkers.append(Linker(document))
            waiting.extend(linkers[-1].others())
        spans = Spans(first.reading)
        for linker in linkers:
            linker.link(spans)
        for linker in linkers:
            linker.reorder()
    except Stop:
        return
    for document in waiting:
        document.places.forget()
        document.links.clear()


def schema_paths(source: Source) -> list[str]:
    """The paths in the `xsi:schemaLocation` of the first tag of a file: where its metamodel may be."""
    found: list[str] = []

    def start(_: str, attributes: dict[str, str]) -> None:
        scope = namespaces(attributes)
        for key, value in attributes.items():
            prefix, _, local = key.rpartition(":")
            if local == "schemaLocation" and scope.get(prefix) == XSI:
                found.extend(value.split()[1::2])
        raise Stop

    def nothing(_: str) -> None:
        return

    head = Source(source.name, source.text[:_HEAD])
    Reader(XmlPlaces(head)).read(start, nothing, nothing)
    paths = dict.fromkeys(unquote(one.partition("#")[0]) for one in found)
    return [path for path in paths if path.endswith((".ecore", ".metamodel")) and "://" not in path]
