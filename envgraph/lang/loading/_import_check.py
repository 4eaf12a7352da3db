"""Check the imports of files: report imports that find nothing, and imports that are not used."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import field, replace

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Severity, Source, did_you_mean
from envgraph.lang.read._ecore_types import well_known_types
from envgraph.lang.read._imports import Import
from envgraph.lang.read._query_header import PatternImport
from envgraph.lang.syntax._bundled_data import bundled_domains
from envgraph.lang.syntax._file_formats import suffix_of
from envgraph.lang.syntax._parser import ParseResult
from envgraph.metamodel import Metamodel, simple_name
from envgraph.pattern import Pattern, UnknownNames

LANGUAGES = ("metamodel", "model", "query", "rules", "environment")

LANGUAGE_OF = {language: language for language in LANGUAGES} | {
    "ecore": "metamodel",
    "xmi": "model",
    "json": "model",
    "vql": "query",
}
"""The formats of imported files, each with the language that it is read as."""

NAME_METAMODEL_HINT = "write the path of the metamodel's file, or load that file too, for example with `--metamodel`"


@dataclass(slots=True)
class LoadedFile:
    """A file of a workspace, with the results of reading it.

    Attributes:
        format: the format's name; "" if it or the file's content is unknown.
        source: the text; None if it cannot be read, or does not come from a file.
        parsed: the syntax tree, if the file is in one of envgraph's own languages.
        imports: the imports, each with the name of the imported file, or with None if no file matches.
        patterns: the patterns that the file imports by name.
        mentioned_names: all names in a `.query` file; None for other files, whose imports may take effect unmentioned.
        defined_names: the names that this file defines.
        is_metamodel: True if the file is a metamodel.
    """

    format: str = ""
    source: Source | None = None
    parsed: ParseResult | None = None
    imports: list[tuple[Import, str | None]] = field(default_factory=list)
    patterns: Sequence[PatternImport] = ()
    mentioned_names: frozenset[str] | None = None
    defined_names: set[str] = field(default_factory=set)
    is_metamodel: bool = False


def is_path(text: str) -> bool:
    """Return True if the text of an import looks like a path; otherwise it may be the URI or name of a metamodel."""
    return "://" not in text and suffix_of(text) in LANGUAGE_OF


def blame_import(problem: Diagnostic, import_: Import | None, name: str) -> Diagnostic:
    """Return a problem of a file as a whole with the span of the import that named the file.

    A problem at a position inside the file is returned unchanged. So is every problem without an import (`import_` is
    None), but the name of an unknown bundled domain gets a hint.
    """
    if import_ is None or (problem.span and problem.span.source.text):
        if problem.code == "missing-file" and problem.hint is None and "." not in name:
            return replace(problem, hint=did_you_mean(name, bundled_domains()))
        return problem
    if not import_.path.strip():
        hint = 'write `import "name.metamodel"`'
        return Diagnostic("missing-file", "the path of this import is empty", import_.span, hint)
    if problem.code == "missing-file" and problem.hint is None and not is_path(import_.path):
        message = f"`{import_.path}` is neither a file nor the URI or name of a loaded metamodel"
        return Diagnostic("missing-file", message, import_.span, NAME_METAMODEL_HINT)
    return Diagnostic(problem.code, f"`{import_.path}`: {problem.message}", import_.span, problem.hint)


def defined_names(metamodel: Metamodel, calls: Collection[str] | None = None) -> set[str]:
    """Return the names that a metamodel defines: of itself, its classes, features, enums and literals.

    With `calls`, return only the names of classes, features, enums and literals in packages with these URIs.
    """
    paths = {one.path for one in metamodel.packages if calls is None or one.uri in calls}
    found = {metamodel.name} if calls is None else set()
    for enum in (one for one in metamodel.enum_types if one.package in paths):
        found.update((simple_name(enum.name), *enum.literals))
    for cls in (one for one in metamodel.class_list if one.package in paths):
        found.add(simple_name(cls.name))
        found.update(feature.name for feature in cls.features)
    return found


def check_imported_patterns(
    file: LoadedFile, patterns: Mapping[str, Pattern], name: str, unknown: UnknownNames
) -> Iterator[Diagnostic]:
    """Yield an error for each pattern that a file imports but that is unknown, or private in another file.

    Args:
        file: the file that imports.
        patterns: the patterns of all files, by qualified name.
        name: the name of the file.
        unknown: names of patterns that may be defined in unreadable text; these are not reported.
    """
    for one in file.patterns:
        found = patterns.get(one.name)
        if found is None and one.name in unknown:
            continue
        if found is None:
            near = did_you_mean(one.name, (known for known, each in patterns.items() if not each.private))
            hint = f'import the file of the pattern too; write the path of a file in quotes: `import "{one.name}"`'
            if one.name.rpartition(".")[2] in ("metamodel", "ecore", "query", "vql", "rules"):
                near = f'write the path of a file in quotes: `import "{one.name}"`'
            message = f"unknown pattern `{one.name}`"
            yield Diagnostic("unknown-pattern", message, one.span, near or hint, subject=(one.name,))
        elif found.private and found.span is not None and found.span.source.name != name:
            hint = "use it only in its own file, or remove `private`"
            message = f"pattern `{one.name}` is private"
            yield Diagnostic("private-pattern", message, one.span, hint, subject=(one.name,))


def warn_unused_files(files: Mapping[str, LoadedFile]) -> Iterator[Diagnostic]:
    """Yield a warning for each import of a query file that is repeated, or that provides no name that the file uses.

    Files that define nothing are skipped, because they only combine other files.
    """
    for name, file in files.items():
        if file.mentioned_names is None or not file.defined_names:
            continue  # This file only combines others.
        kept = [target for _, target in file.imports if target in files and target != name]
        known: set[str] = set()
        for import_, target in file.imports:
            if target is None:
                types = well_known_types(import_.path) or {}
                if types and not file.mentioned_names & types.keys():
                    yield _unused_import(import_, f"no type of `{import_.path}` is used")
            elif target in known and import_.alias is None:
                yield _unused_import(import_, f"`{import_.path}` is already imported")
            elif target in kept and not _is_used(files, name, target, kept):
                kept = [other for other in kept if other != target]
                yield _unused_import(import_, f"nothing that `{import_.path}` defines is used")
            if import_.alias is None:
                known.add(target or "")


def _unused_import(import_: Import, message: str) -> Diagnostic:
    return Diagnostic("unused-import", message, import_.span, "leave the import out", Severity.WARNING)


def _is_used(files: Mapping[str, LoadedFile], name: str, target: str, imported: Iterable[str | None]) -> bool:
    """Return True if a file uses a name of `target`, or if only `target` imports a metamodel or another used name."""
    mentioned = files[name].mentioned_names or frozenset()
    if mentioned & files[target].defined_names:
        return True
    others = set(_imported_files(files, (one for one in imported if one != target), name))
    return any(
        files[one].is_metamodel or mentioned & files[one].defined_names
        for one in _imported_files(files, [target], name)
        if one not in others
    )


def _imported_files(files: Mapping[str, LoadedFile], starts: Iterable[str | None], without: str) -> Iterator[str]:
    """Yield the files `starts` and all files that they import, directly or indirectly, except the file `without`."""
    seen = {without}
    waiting = list(starts)
    while waiting:
        one = waiting.pop()
        if one is not None and one not in seen and one in files:
            seen.add(one)
            yield one
            waiting += [target for _, target in files[one].imports]
