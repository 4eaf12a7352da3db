"""Read `.xmi` files as models.

A file is read as a stream. Each tag becomes an object at once, and references are linked after all objects exist.
pyecore stops at the first mistake, reports only lines, overlooks some mistakes, and takes four times as long. Tests
compare the results of both. A document may refer to objects of other documents, which are read into the same model.
"""

from __future__ import annotations

import posixpath
from urllib.parse import unquote

from envgraph.errors import Source, has_errors
from envgraph.graph import Model
from envgraph.lang.interchange._xmi_document import FetchDocument, ObjectSpans, XmiDocument, XmiReading
from envgraph.lang.interchange._xmi_links import Linker
from envgraph.lang.interchange._xmi_tags import TagReader
from envgraph.lang.read._model_reader import ModelFile, ModelText
from envgraph.lang.syntax._xml_parser import XSI, StopParsing, XmlPositions, XmlReader, declared_namespaces
from envgraph.metamodel import Metamodel

_HEAD_LENGTH = 100_000
"""Number of characters at the start of a file that are searched for its first tag."""


def read_xmi(
    source: Source,
    metamodel: Metamodel | None,
    lost: frozenset[str] = frozenset(),
    fetch: FetchDocument | None = None,
    *,
    allow_unresolved: bool = False,
) -> ModelFile:
    """Return the model of an `.xmi` file with all diagnostics; after errors, the model is None.

    Args:
        source: the file.
        metamodel: the metamodel of the objects; None if it could not be loaded: then only the XML syntax is checked.
        lost: names that files with errors may define; they are not reported as unknown.
        fetch: reads another file by its path and the name of the file that refers to it; None if links to other files
            are not allowed.
        allow_unresolved: if True, links to missing objects are left out with a warning.
    """
    name = posixpath.basename(source.name).rpartition(".")[0] or source.name
    model = Model(metamodel or Metamodel("", ()), name)
    reading = XmiReading(model, lost, fetch, allow_unresolved=allow_unresolved)
    folder = posixpath.dirname(source.name)
    for uri, place in _schema_locations(source).items():
        model.graph.schema_locations[uri] = place if "://" in place else posixpath.join(folder, unquote(place))
    with reading.model.loading():
        first = reading.add_document(source)
        if metamodel is None:
            TagReader(first).check_syntax()
        else:
            _read_documents(first)
    reading.diagnostics.extend(reading.omission_warnings())
    complete = metamodel is not None and not has_errors(reading.diagnostics)
    text = ModelText(
        name,
        source.span_between(0, 0),
        metamodel.name if metamodel else "",
        reading.model if complete else None,
        ObjectSpans(reading),
    )
    return ModelFile((text,), tuple(reading.diagnostics), tuple(reading.documents))


def _read_documents(first: XmiDocument) -> None:
    """Read a document and all documents that it refers to, then link all references; stop after too many errors."""
    try:
        linkers = []
        waiting = [first]
        for document in waiting:
            TagReader(document).read()
            linkers.append(Linker(document))
            waiting.extend(linkers[-1].read_linked_documents())
        spans = ObjectSpans(first.reading)
        for linker in linkers:
            linker.link_targets(spans)
        for linker in linkers:
            linker.restore_order()
    except StopParsing:
        return
    for document in waiting:
        document.places.free_memory()
        document.links.clear()


def schema_paths(source: Source) -> list[str]:
    """Return the `.ecore` and `.metamodel` paths, but no URLs, in the `xsi:schemaLocation` of a file's first tag."""
    paths = dict.fromkeys(unquote(one.partition("#")[0]) for one in _schema_locations(source).values())
    return [path for path in paths if path.endswith((".ecore", ".metamodel")) and "://" not in path]


def _schema_locations(source: Source) -> dict[str, str]:
    """Return the paths and URLs in the `xsi:schemaLocation` of a file's first tag, by namespace URI."""
    found: dict[str, str] = {}

    def start(_: str, attributes: dict[str, str]) -> None:
        scope = declared_namespaces(attributes)
        for key, value in attributes.items():
            prefix, _, local = key.rpartition(":")
            if local == "schemaLocation" and scope.get(prefix) == XSI:
                words = value.split()
                found.update(zip(words[::2], words[1::2], strict=False))
        raise StopParsing

    head = Source(source.name, source.text[:_HEAD_LENGTH])
    XmlReader(XmlPositions(head)).parse(start)
    return found
