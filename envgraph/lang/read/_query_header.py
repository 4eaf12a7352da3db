"""Read files with definitions, and the package and imports at their beginning (`.query`, `.rules`, `.environment`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import field
from typing import Generic, TypeVar

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Span
from envgraph.lang.read._ecore_types import library_types
from envgraph.lang.read._imports import Import
from envgraph.lang.read._reading import Reading, TypeNames
from envgraph.lang.syntax._parsing import Parsed, qualified_name_of, tokens, trees
from envgraph.metamodel import type_name

Definition = TypeVar("Definition")

_KINDS = ("package", "import_file", "import_pattern", "import_java")


@dataclass(frozen=True, slots=True)
class PatternImport:
    """The import of a pattern by name: after `import pattern a.b.c` the file may call the pattern `c`."""

    name: str
    span: Span = field(compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Header:
    """The package of a file ("" for none) and its imports, in the order of the text."""

    package: str = ""
    imports: tuple[Import, ...] = ()
    patterns: tuple[PatternImport, ...] = ()


@dataclass(frozen=True, slots=True)
class DefinitionsFile(Generic[Definition]):
    """The definitions of a file that could be read, with its header and diagnostics.

    Attributes:
        lost: names that may be defined or used in text that could not be read.
    """

    header: Header
    definitions: tuple[Definition, ...]
    diagnostics: tuple[Diagnostic, ...]
    lost: frozenset[str] = frozenset()


def read_definitions(
    parsed: Parsed,
    types: TypeNames | None,
    read: Callable[[Reading, str, Tree[Token]], Definition],
    *,
    keep: bool = False,
    missing: tuple[str, str, str] | None = None,
) -> DefinitionsFile[Definition]:
    """Return the definitions of a parsed file, with the diagnostics that are found before names are resolved.

    Args:
        parsed: the file.
        types: the meaning of type names in the file.
        read: converts the tree of one definition; its second argument is the package.
        keep: True to keep definitions with parts that could not be read; otherwise they are left out.
        missing: code, message and hint of the error for a file without definitions; None if such a file is valid.
    """
    reading = Reading(parsed, list(parsed.diagnostics), types=types)
    header, found = header_of(reading), []
    parts = [*definitions_of(reading)]
    for tree in parts:
        one = read(reading, header.package, tree)
        if keep or reading.whole(name_of(tree), tree):
            found.append(one)
    if missing and not parts and not parsed.diagnostics:
        end = len(parsed.source.text)
        reading.error(*missing[:2], parsed.source.span(end, end), missing[2])
    unused_imports(reading, header)
    return DefinitionsFile(header, tuple(found), reading.result(), reading.all_lost())


def name_of(tree: Tree[Token]) -> Token:
    """Return the name token of a definition."""
    return tokens(tree.children, "NAME")[0]


def header_of(reading: Reading) -> Header:
    """Parse the package and imports; record aliases, imported patterns, Java classes and data types in `reading`."""
    definitions = trees(reading.parsed.tree.children) if reading.parsed.tree else []
    package = _package(reading, definitions)
    imports: list[Import] = []
    patterns: list[PatternImport] = []
    for tree in definitions:
        match tree.data:
            case "import_file":
                imports.append(_file(reading, tree))
            case "import_pattern":
                patterns.append(_pattern(reading, tree))
            case "import_java":
                name = qualified_name_of(trees(tree.children, "qualified_name")[0])
                reading.java.setdefault(name.rpartition(".")[2], reading.span(tree))
    return Header(package, tuple(imports), tuple(patterns))


def definitions_of(reading: Reading) -> Iterator[Tree[Token]]:
    """Yield the trees of the file's definitions, without package and imports."""
    if reading.parsed.tree:
        yield from (tree for tree in trees(reading.parsed.tree.children) if tree.data not in _KINDS)


def unused_imports(reading: Reading, header: Header) -> None:
    """Report a warning for each alias, imported Java class and imported pattern that the file does not use."""
    for name, span in reading.aliases.items():
        if name not in reading.used:
            hint = f"leave `as {name}` out, or write `{name}::Type`"
            reading.warn("unused-import", f"the alias `{name}` is not used", span, hint)
    for name, span in reading.java.items():
        if name not in reading.used:  # An unknown Java class is reported where the file uses it.
            hint = "remove this line: Java classes have no effect here"
            reading.warn("unused-import", f"the Java class `{name}` is not used", span, hint)
    for pattern in header.patterns:
        simple = pattern.name.rpartition(".")[2]
        if simple not in reading.used and pattern.name not in reading.used:
            reading.warn(
                "unused-import",
                f"the imported pattern `{simple}` is not used",
                pattern.span,
                "leave the import out",
            )


def _package(reading: Reading, definitions: list[Tree[Token]]) -> str:
    package = reading.only(
        "`package`", trees(definitions, "package"), "remove one: a file has only one package"
    )
    if package is None:
        return ""
    if package is not definitions[0]:
        hint = "move this line above the imports and definitions"
        reading.error("misplaced-header", "the line with the package must come first", package, hint)
    return qualified_name_of(trees(package.children)[0])


def _file(reading: Reading, tree: Tree[Token]) -> Import:
    found = tokens(tree.children)
    place = next(place for place, token in enumerate(found) if token.type == "STRING")
    path, word, alias = found[place], found[:place], found[place + 1 :]
    if word and word[0] != "epackage":
        reading.error("unexpected-token", f"unexpected `{word[0]}`", word[0], "leave it out")
    for name in alias:
        if name in reading.aliases:
            reading.error(
                "duplicate-definition",
                f"another import has the same alias `{name}`",
                name,
                "choose another name",
            )
        reading.aliases.setdefault(str(name), reading.span(name))
    types = library_types(str(path)) or {}
    reading.data_types.update((name, type_name(one.type)) for name, one in types.items())
    return Import(str(path), reading.span(path), str(alias[0]) if alias else None)


def _pattern(reading: Reading, tree: Tree[Token]) -> PatternImport:
    part = trees(tree.children, "qualified_name")[0]
    name = qualified_name_of(part)
    simple = name.rpartition(".")[2]
    other = reading.imported.setdefault(simple, name)
    if other != name:
        hint = f"leave one of the imports out, and call its pattern by the full name, such as `{name}`"
        message = f"`{simple}` already stands for the imported pattern `{other}`"
        reading.error("duplicate-definition", message, part, hint)
    return PatternImport(name, reading.span(part))
