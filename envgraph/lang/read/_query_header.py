"""Read files with definitions, and the package and imports at their beginning (`.query`, `.rules`, `.environment`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import field
from typing import Generic, TypeVar

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Span
from envgraph.lang.read._ecore_types import well_known_types
from envgraph.lang.read._file_reading import FileReading, TypeNames
from envgraph.lang.read._imports import Import
from envgraph.lang.syntax._parser import ParseResult, qualified_name_of, select_tokens, select_trees
from envgraph.metamodel import type_name

Definition = TypeVar("Definition")

_HEADER_KINDS = ("package", "import_file", "import_pattern", "import_java")


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
    parsed: ParseResult,
    types: TypeNames | None,
    read: Callable[[FileReading, str, Tree[Token]], Definition],
    *,
    keep_broken: bool = False,
    missing: tuple[str, str, str] | None = None,
) -> DefinitionsFile[Definition]:
    """Return the definitions of a parsed file, with the diagnostics that are found before names are resolved.

    Args:
        parsed: the file.
        types: the meaning of type names in the file.
        read: converts the tree of one definition; its second argument is the package.
        keep_broken: True to keep definitions with parts that could not be read; otherwise they are left out.
        missing: code, message and hint of the error for a file without definitions; None if such a file is valid.
    """
    reading = FileReading(parsed, list(parsed.diagnostics), types=types)
    header, found = parse_header(reading), []
    parts = [*definition_trees(reading)]
    for tree in parts:
        one = read(reading, header.package, tree)
        if keep_broken or reading.check_complete(name_token(tree), tree):
            found.append(one)
    if missing and not parts and not parsed.diagnostics:
        end = len(parsed.source.text)
        reading.error(*missing[:2], parsed.source.span_between(end, end), missing[2])
    warn_unused_imports(reading, header)
    return DefinitionsFile(header, tuple(found), reading.sorted_diagnostics(), reading.all_lost())


def name_token(tree: Tree[Token]) -> Token:
    """Return the name token of a definition."""
    return select_tokens(tree.children, "NAME")[0]


def parse_header(reading: FileReading) -> Header:
    """Parse the package and imports; record aliases, imported patterns, Java classes and data types in `reading`."""
    definitions = select_trees(reading.parsed.tree.children) if reading.parsed.tree else []
    package = _parse_package(reading, definitions)
    imports: list[Import] = []
    patterns: list[PatternImport] = []
    for tree in definitions:
        match tree.data:
            case "import_file":
                imports.append(_parse_file_import(reading, tree))
            case "import_pattern":
                patterns.append(_parse_pattern_import(reading, tree))
            case "import_java":
                name = qualified_name_of(select_trees(tree.children, "qualified_name")[0])
                reading.java_imports.setdefault(name.rpartition(".")[2], reading.span(tree))
    return Header(package, tuple(imports), tuple(patterns))


def definition_trees(reading: FileReading) -> Iterator[Tree[Token]]:
    """Yield the trees of the file's definitions, without package and imports."""
    if reading.parsed.tree:
        yield from (tree for tree in select_trees(reading.parsed.tree.children) if tree.data not in _HEADER_KINDS)


def warn_unused_imports(reading: FileReading, header: Header) -> None:
    """Report a warning for each alias, imported Java class and imported pattern that the file does not use."""
    for name, span in reading.aliases.items():
        if name not in reading.used_names:
            hint = f"leave `as {name}` out, or write `{name}::Type`"
            reading.warn("unused-import", f"the alias `{name}` is not used", span, hint)
    for name, span in reading.java_imports.items():
        if name not in reading.used_names:  # An unknown Java class is reported where the file uses it.
            hint = "remove this line: Java classes have no effect here"
            reading.warn("unused-import", f"the Java class `{name}` is not used", span, hint)
    for pattern in header.patterns:
        simple = pattern.name.rpartition(".")[2]
        if simple not in reading.used_names and pattern.name not in reading.used_names:
            reading.warn(
                "unused-import",
                f"the imported pattern `{simple}` is not used",
                pattern.span,
                "leave the import out",
            )


def _parse_package(reading: FileReading, definitions: list[Tree[Token]]) -> str:
    package = reading.first_or_report(
        "`package`", select_trees(definitions, "package"), "remove one: a file has only one package"
    )
    if package is None:
        return ""
    if package is not definitions[0]:
        hint = "move this line above the imports and definitions"
        reading.error("misplaced-header", "the line with the package must come first", package, hint)
    return qualified_name_of(select_trees(package.children)[0])


def _parse_file_import(reading: FileReading, tree: Tree[Token]) -> Import:
    found = select_tokens(tree.children)
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
    types = well_known_types(str(path)) or {}
    reading.data_types.update((name, type_name(one.type)) for name, one in types.items())
    return Import(str(path), reading.span(path), str(alias[0]) if alias else None)


def _parse_pattern_import(reading: FileReading, tree: Tree[Token]) -> PatternImport:
    part = select_trees(tree.children, "qualified_name")[0]
    name = qualified_name_of(part)
    simple = name.rpartition(".")[2]
    other = reading.imported.setdefault(simple, name)
    if other != name:
        hint = f"leave one of the imports out, and call its pattern by the full name, such as `{name}`"
        message = f"`{simple}` already stands for the imported pattern `{other}`"
        reading.error("duplicate-definition", message, part, hint)
    return PatternImport(name, reading.span(part))
