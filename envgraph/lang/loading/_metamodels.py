"""Combine all `.ecore` files into one metamodel, and report a second metamodel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Note, Span
from envgraph.lang.read._imports import Import
from envgraph.lang.read._metamodel_reader import MetamodelFile
from envgraph.metamodel import Metamodel

if TYPE_CHECKING:  # The module is loaded with the first file that needs it.
    from envgraph.lang.interchange._ecore_document import EcoreDocument


def is_same_metamodel(one: Metamodel, other: Metamodel) -> bool:
    """Return True if two metamodels have the same classes and enums."""
    return one is other or (one.class_list == other.class_list and one.enum_types == other.enum_types)


@dataclass(slots=True)
class Metamodels:
    """The metamodels of a set of files, each with the import that asked for it (None if the caller named the file).

    Attributes:
        given: a metamodel that the caller passed in; None if there is none.
        files: the metamodel files by name, in the order of reading.
        ecore: the `.ecore` files, which are combined into one metamodel after all of them are read.
    """

    given: Metamodel | None = None
    allow_unresolved: bool = False
    files: dict[str, tuple[MetamodelFile, Import | None]] = field(default_factory=dict)
    ecore: dict[str, tuple[EcoreDocument, Import | None]] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.files or self.ecore or self.given)

    @property
    def main(self) -> Metamodel | None:
        """Return the metamodel of the first file, or `given` without files; None if it has errors or there is none."""
        found = [file.metamodel for file, _ in self.files.values()]
        return found[0] if found else self.given

    @property
    def has_unreadable_file(self) -> bool:
        """Return True if a metamodel file could not be read."""
        return any(file.metamodel is None for file, _ in self.files.values()) or any(
            document.root is None for document, _ in self.ecore.values()
        )

    def combine_ecore(self, order: Mapping[str, int]) -> list[Diagnostic]:
        """Combine the `.ecore` files into one entry of `files`; return errors for packages that two files contain.

        Packages with the same content in both files are not reported.

        Args:
            order: the position of each file in the order of reading.
        """
        problems = []
        first: dict[str, EcoreDocument] = {}
        doubles: dict[str, EcoreDocument] = {}
        homes: dict[str, EcoreDocument] = {}
        for name, (document, asked) in self.ecore.items():
            uris = [one for one in document.uris if one in homes]
            known = homes[uris[0]] if uris else document
            homes.update((one, document) for one in document.uris if one not in homes)
            if known is document:
                first[document.uri or name] = document
            else:
                doubles[name] = known
                if known.uri != document.uri or not self._define_same(known, document):
                    message = f"the package `{uris[0]}` is also in another file, with different content"
                    hint = "load only one of the two files"
                    problems.append(_second_metamodel(message, asked, document.span, known.span, hint))
        if first:
            name, (_, asked) = next(iter(self.ecore.items()))
            documents = tuple(first.values())
            from envgraph.lang.interchange._ecore_reader import read_ecore

            read = read_ecore(documents, doubles, allow_unresolved=self.allow_unresolved)
            self.files[name] = read, asked
            self.files = dict(sorted(self.files.items(), key=lambda one: order[one[0]]))
        return problems

    def _define_same(self, one: EcoreDocument, other: EcoreDocument) -> bool:
        """Return True if two `.ecore` files define the same metamodel; False if one of them has errors."""
        if one.source.text == other.source.text:
            return True
        from envgraph.lang.interchange._ecore_reader import read_ecore

        documents = {each.uri or name: each for name, (each, _) in reversed(self.ecore.items())}
        names = [name for name, (each, _) in self.ecore.items() if each.uri == one.uri]
        first, second = (
            read_ecore(tuple({**documents, each.uri or "": each}.values()), dict.fromkeys(names, each)).metamodel
            for each in (one, other)
        )
        return first is not None and second is not None and is_same_metamodel(first, second)

    def importable_names(self) -> dict[str, str]:
        """Map the URIs and names by which metamodels can be imported to the names of their files ("" for `given`)."""
        found = {file: one.metamodel for file, (one, _) in self.files.items()}
        if not found and not self.ecore:
            found = {"": self.given}
        known = {
            name: file
            for file, metamodel in found.items()
            if metamodel
            for name in (*(package.uri for package in metamodel.packages), metamodel.name)
        }
        calls = {name: file for file, (one, _) in self.ecore.items() for name in one.import_names()}
        return {**calls, **known}

    def additional(self) -> list[tuple[MetamodelFile, Import | None]]:
        """Return the metamodel files after the first that differ from it; equal ones in another format are left out."""
        found = list(self.files.values())
        first = found[0][0].metamodel if found else None
        return [
            (file, asked)
            for file, asked in found[1:]
            if not (first and file.metamodel and is_same_metamodel(first, file.metamodel))
        ]

    def check_single(self) -> list[Diagnostic]:
        """Return an error for each metamodel that differs from the first one, since only one is allowed."""
        problems = []
        for other, asked in self.additional():
            first = next(iter(self.files.values()))[0]
            hint = "put all classes into one metamodel, since an engine has only one"
            if any(one.name.endswith(".ecore") for one in (other.span.source, first.span.source)):
                hint = f"{hint}, or load only `.ecore` files, which are combined into one"
            problems.append(_second_metamodel("this is a second metamodel", asked, other.span, first.span, hint))
        return problems


def _second_metamodel(message: str, import_: Import | None, span: Span, first: Span, hint: str) -> Diagnostic:
    notes = (Note("the first one is here", first),)
    return Diagnostic("two-metamodels", message, import_.span if import_ else span, hint, notes=notes)
