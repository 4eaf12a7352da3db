"""Read files and their imports, and check all of them together."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

from envgraph.code import dataclass
from envgraph.errors import RAISE_LIMIT_HINT, Diagnostic, LoadError, Severity, Source, did_you_mean, scaled_limit
from envgraph.lang.family._family_reader import FAMILY_FILE, PROBLEM_FILE, read_family
from envgraph.lang.family._family_spec import FamilySpec
from envgraph.lang.loading._family_check import check_family
from envgraph.lang.loading._import_check import (
    LANGUAGE_OF,
    NAME_METAMODEL_HINT,
    LoadedFile,
    blame_import,
    check_imported_patterns,
    defined_names,
    is_path,
    warn_unused_files,
)
from envgraph.lang.loading._metamodels import Metamodels
from envgraph.lang.loading._reading_cache import ReadingCache
from envgraph.lang.loading._workspace import Workspace
from envgraph.lang.loading._workspace_check import check_workspace, conformance_warnings
from envgraph.lang.read._ecore_types import ECORE
from envgraph.lang.read._file_reading import FileReading, TypeNames
from envgraph.lang.read._imports import Import, similar_uri_hint
from envgraph.lang.read._metamodel_reader import read_metamodel
from envgraph.lang.read._model_reader import ModelText, parse_imports, read_models
from envgraph.lang.read._query_header import DefinitionsFile, parse_header
from envgraph.lang.read._query_reader import read_query
from envgraph.lang.read._suppressions import Suppression, apply_suppressions, find_suppressions
from envgraph.lang.syntax._bundled_data import bundled_domains, data_path
from envgraph.lang.syntax._file_formats import FORMATS, suffix_of
from envgraph.lang.syntax._grammar import load_grammar
from envgraph.lang.syntax._merge_diagnostics import merge_unknown_names
from envgraph.lang.syntax._parser import ParseResult, parse_tokens
from envgraph.lang.syntax._source_files import DiskFiles, Files, file_format, file_in_directory, read_source
from envgraph.lang.syntax._xml_parser import declare_utf8
from envgraph.metamodel import Metamodel
from envgraph.pattern import Derivation, FunctionDeclaration, Library, Pattern, Rule, Unit, UnknownNames
from envgraph.rewrite import Registration

if TYPE_CHECKING:  # These modules are loaded with the first file that needs them.
    from envgraph.behaviour import Behaviour
    from envgraph.lang.interchange._ecore_document import EcoreDocument

_LIBRARIES = (ECORE, "http://www.eclipse.org/emf/2003/XMLType")
"""Packages with data types, which every `.vql` file may import."""

_Kind = TypeVar("_Kind")


def directory_of(files: Files, path: str) -> str | None:
    """Return the directory that a path names, possibly that of a bundled domain; None if it names no directory."""
    name = files.name(path)
    if files.is_directory(name):
        return name
    if isinstance(files, DiskFiles) and path in bundled_domains() and name not in files.entries("."):
        return DiskFiles().name(str(data_path("rules", path)))
    return None


@dataclass(slots=True)
class Loader:
    """A loader that reads each file once, and the imports of a file right after the file, in the order of the text."""

    files: Files
    components: Mapping[str, Collection[str]]
    metamodels: Metamodels
    overrides: Sequence[str] = ()
    cache: ReadingCache = field(default_factory=ReadingCache)
    diagnostics: list[Diagnostic] = field(default_factory=list)
    roots: list[str] = field(default_factory=list)
    files_read: dict[str, LoadedFile] = field(default_factory=dict)
    """All files in the order of reading, including those that could not be read."""
    lost: set[str] = field(default_factory=set)
    definitions: list[Any] = field(default_factory=list)
    """Patterns, functions, rules, units, derivations and behaviours."""
    families: list[FamilySpec] = field(default_factory=list)
    suppressions: list[Suppression] = field(default_factory=list)
    incomplete_families: set[str] = field(default_factory=set)
    unresolved_imports: list[tuple[Import, str]] = field(default_factory=list)
    """Imports that may be the URI or name of a metamodel, each with the importing file."""
    mentioned_schemas: list[str] = field(default_factory=list)
    """Metamodels that models refer to; read if no other metamodel is given."""
    incomplete: bool = False
    """True if a file is missing; names that it may define are then not reported as unknown."""

    # --- reading ---

    def add_root(self, path: str) -> None:
        """Read the file that the caller named, or all files in envgraph's languages in a directory, and their imports.

        A directory's family file is read too. Report a directory without such files.
        """
        directory = directory_of(self.files, path)
        if directory is None:
            name = self.files.name(path)
            self.roots.append(name)
            self._read_with_imports(name)
            return
        known = self._files_of_known_formats(directory)
        found = [name for name in known if not name.endswith(".toml")]
        families = (file_in_directory(directory, file) for file in (FAMILY_FILE, PROBLEM_FILE))
        found += [family for family in families if family in known]
        if not found:
            self.files_read.setdefault(directory, LoadedFile())
            place = Source(directory, "").span_between(0, 0)
            message = "the directory contains no file in a language of envgraph"
            self.diagnostics.append(Diagnostic("missing-file", message, place, _languages_hint()))
        for name in found:
            self.roots.append(name)
            self._read_with_imports(name)

    def _files_of_known_formats(self, directory: str) -> list[str]:
        known = (*LANGUAGE_OF.keys() - {"json"}, "toml")  # JSON files often hold other data
        return [name for name in self.files.entries(directory) if suffix_of(name) in known]

    def _read_with_imports(self, first: str, import_: Import | None = None) -> None:
        """Read a file and all its imports, depth first; if too many files are read together, report this and stop."""
        waiting: list[tuple[str, Import | None]] = [(first, import_)]
        most = scaled_limit("files")
        while waiting:
            name, import_ = waiting.pop()
            if name not in self.files_read:
                if len(self.files_read) == most:
                    span = import_.span if import_ else Source(name, "").span_between(0, 0)
                    message = f"more than {most} files would be read together"
                    self.diagnostics.append(Diagnostic("too-many-files", message, span, RAISE_LIMIT_HINT))
                    self.incomplete = True
                    return
                self.files_read[name] = LoadedFile()
                waiting.extend(reversed(self._read_file(name, import_)))

    def _read_file(self, name: str, import_: Import | None) -> list[tuple[str, Import | None]]:
        """Read and parse one file; record errors. Return its imports by path and the names of the imported files.

        Imports by URI or name are added to `named`, to be resolved after all files are read.
        """
        file, format = self.files_read[name], file_format(self.files, name)
        try:
            if format == "toml" and import_ is None:
                return self._read_family(name)
            if format not in LANGUAGE_OF and self.files.exists(name):
                self._refuse_format(name, format, import_)
            file.source = read_source(self.files, name)
        except LoadError as error:
            self.diagnostics.extend(blame_import(one, import_, name) for one in error.diagnostics)
            self.incomplete = True
            return []
        assert format is not None
        file.format = format
        imports = self._parse_file(file, file.source, import_)
        self.unresolved_imports.extend((one, name) for one in imports if not is_path(one.path))
        found = [(one, self.files.name(one.path, beside=name)) for one in imports if is_path(one.path)]
        if format == "ecore":
            found = self._other_packages(self.metamodels.ecore[name][0])
        file.imports += found
        return [(target, one) for one, target in found]

    def _other_packages(self, document: EcoreDocument) -> list[tuple[Import, str]]:
        """Return the existing `.ecore` files that an `.ecore` file refers to, and record their names in the document.

        Missing files are not reported, because files that are read later may contain the same packages.
        """
        from envgraph.lang.interchange._ecore_document import find_linked_file

        name, found = document.source.name, []
        for text, span in document.mentioned_documents().items():
            target = find_linked_file(self.files, text, name)
            if target and target.endswith(".ecore") and target != name:
                document.paths[text] = target
                found.append((Import(text, span), target))
        return found

    def _refuse_format(self, name: str, format: str | None, import_: Import | None) -> NoReturn:
        span = import_.span if import_ else Source(name, "").span_between(0, 0)
        suffix = suffix_of(name)
        hint = did_you_mean(suffix, LANGUAGE_OF) if suffix and format is None else None
        if format == "xsd":
            hint = "convert it to an `.ecore` file first, for example with EMF"
        what = f"{FORMATS[format]}, not a file" if format else "not a file"
        message = f"`{name.rpartition('/')[2]}` is {what} in a language of envgraph"
        raise LoadError.from_problem("unknown-language", message, span, hint or _languages_hint())

    def _parse_file(self, file: LoadedFile, source: Source, import_: Import | None) -> Sequence[Import]:
        """Parse a file and store its content; return its imports. XMI and JSON files are parsed later, as models."""
        if file.format == "ecore":
            from envgraph.lang.interchange._ecore_document import EcoreDocument

            self.metamodels.ecore[source.name] = EcoreDocument(source), import_
        elif file.format == "xmi":
            from envgraph.lang.interchange._xmi_reader import schema_paths

            self.mentioned_schemas += [self.files.name(path, source.name) for path in schema_paths(source)]
        elif file.format != "json":
            return self._parse_text_file(file, source, import_)
        return ()

    def _parse_text_file(self, file: LoadedFile, source: Source, import_: Import | None) -> Sequence[Import]:
        language = LANGUAGE_OF[file.format]
        parsed, names = self.cache.call(source.name, _parse_text, language, source.name, source.text)
        file.source = parsed.source
        self.lost |= parsed.lost_names
        self.incomplete |= any(one.code == "other-language" for one in parsed.diagnostics)
        suppressions, problems = find_suppressions(parsed)
        self.suppressions += suppressions
        self.diagnostics += problems
        if language == "metamodel":
            self.metamodels.files[source.name] = self.cache.call(source.name, read_metamodel, parsed), import_
            return ()
        file.parsed = parsed
        if language == "model":
            return parse_imports(parsed)
        if language == "query":
            file.mentioned_names = names
        return parse_header(FileReading(parsed)).imports

    def _files_in(self, *languages: str) -> list[tuple[str, LoadedFile]]:
        """Return the files of these languages in the order of reading, each with its name."""
        return [(name, one) for name, one in self.files_read.items() if LANGUAGE_OF.get(one.format) in languages]

    def _type_names(self, name: str, metamodel: Metamodel | None) -> TypeNames | None:
        """Return the metamodel, package aliases and imported packages by which type names in a file are resolved.

        Return None if the metamodel is None.
        """
        if metamodel is None:
            return None
        aliases: dict[str, tuple[str, ...]] = {}
        imported: list[str] = []
        for import_, target in self.files_read[name].imports:
            paths = tuple(one.path for one in metamodel.packages if one.uri == import_.path)
            if not paths and target in self.metamodels.ecore:
                calls = set(self.metamodels.ecore[target][0].import_names())
                paths = tuple(one.path for one in metamodel.packages if one.uri in calls)
            if import_.alias is None:
                imported += paths
            elif paths or target is not None:
                aliases[import_.alias] = paths or tuple(one.path for one in metamodel.packages)
        return TypeNames(metamodel, aliases, tuple(imported))

    def _read_definitions(self, file: LoadedFile, parsed: ParseResult, types: TypeNames | None) -> None:
        """Parse the definitions of a file; store them, their diagnostics, and the patterns that the file imports."""
        read: Callable[[ParseResult, TypeNames | None], DefinitionsFile[Any]]
        match LANGUAGE_OF[file.format]:
            case "query":
                read = read_query
            case "rules":
                from envgraph.lang.read._rules_reader import read_rules as read
            case _:
                from envgraph.lang.read._environment_reader import read_environment as read
        found = self.cache.call(parsed.source.name, read, parsed, types)
        self.definitions += found.definitions
        self._record(found.diagnostics, found.lost)
        file.patterns, file.defined_names = found.header.patterns, {one.name for one in found.definitions}

    def _record(self, diagnostics: Iterable[Diagnostic], lost: frozenset[str]) -> None:
        self.diagnostics.extend(diagnostics)
        self.lost |= lost

    def _read_family(self, name: str) -> list[tuple[str, Import | None]]:
        self.files_read[name].source = read_source(self.files, name)
        found = read_family(name, self.files, self.overrides)
        spec = found.spec
        self.diagnostics.extend(found.diagnostics)
        self.families.append(spec)
        if not found.complete:
            self.incomplete_families.add(spec.path)
        named = (spec.model, *spec.imports, spec.environment)
        return [(one.text, Import(one.text, one.span)) for one in named if one and one.span]

    # --- checking ---

    def check_all(self) -> Workspace:
        """Check all files that were read together, and return their content as a workspace, with all diagnostics."""
        self._read_schemas()
        self._resolve_names()
        metamodel = self._combine_metamodels()
        clear = not self.metamodels.additional()  # otherwise names are ambiguous
        for name, file in self._files_in("query", "rules", "environment"):
            if file.parsed is not None:
                self._read_definitions(file, file.parsed, self._type_names(name, metamodel if clear else None))
        lost = frozenset(self.lost)
        unknown = UnknownNames(lost, self.incomplete)
        imports = self._check_imports(unknown) if clear else []
        models = self._read_models(metamodel if clear else None, lost)
        workspace = Workspace(
            metamodel,
            tuple(models),
            self._definitions_of(Pattern),
            self._definitions_of(Rule),
            self._definitions_of(Unit),
            self._definitions_of(Derivation),
            self._behaviours(metamodel),
            tuple(self.families),
            functions=self._definitions_of(FunctionDeclaration),
            roots=tuple(dict.fromkeys(self.roots)),
            sources={
                name: declare_utf8(one.source.text) if one.format in ("ecore", "xmi") else one.source.text
                for name, one in self.files_read.items()
                if one.source is not None
            },
            unknown=unknown | (str(name) for one in imports for name in one.subject),
            unread=frozenset(
                one.span.source.name for one in self.diagnostics if one.severity is Severity.ERROR and one.span
            ),
        )
        self.diagnostics += imports
        if clear:
            if metamodel is not None:
                library = Library(metamodel)
                library.unknown = workspace.unknown
                library.earlier = None if workspace.functions else self.cache.patterns
                registration = Registration(workspace.definitions, library)
                self.cache.patterns = None if workspace.functions else registration.checked_patterns
                workspace = replace(workspace, registration=registration)
            checked = check_workspace(workspace)
            # A syntax error may hide the import beside it, so a missing metamodel is not reported for such files.
            cut = {_file_name(one) for one in self.diagnostics if one.span and "import" in one.span.source.text}
            xmi = {name for name, one in self.files_read.items() if one.format == "xmi"}
            broken = {_file_name(one) for one in self.diagnostics} & xmi | cut
            checked = [one for one in checked if one.code != "no-metamodel" or _file_name(one) not in broken]
            wrong = {one.span for one in self.diagnostics}  # arguments of a call without brackets are not counted
            self.diagnostics += [one for one in checked if one.code != "wrong-arity" or one.span not in wrong]
            for spec in self.families:
                if spec.path not in self.incomplete_families:
                    self.diagnostics += check_family(spec, workspace, self.components)
        self.diagnostics += self._check_conformance(models)
        return replace(workspace, diagnostics=self._sorted_diagnostics())

    def _definitions_of(self, kind: type[_Kind]) -> tuple[_Kind, ...]:
        """Return the definitions that are instances of `kind`."""
        return tuple(one for one in self.definitions if isinstance(one, kind))

    def _behaviours(self, metamodel: Metamodel | None) -> tuple[Behaviour, ...]:
        """Return the behaviours; if the metamodel is known, action parameters that name an enum are marked as enums."""
        if not self._files_in("environment"):
            return ()
        from envgraph.behaviour import Behaviour
        from envgraph.lang.read._environment_reader import mark_enum_domains

        found = self._definitions_of(Behaviour)
        return tuple(mark_enum_domains(one, metamodel) for one in found) if metamodel else found

    def _check_imports(self, unknown: UnknownNames) -> list[Diagnostic]:
        """Return errors for imported patterns that are unknown or private; without errors, warnings for unused files.

        Return no warnings if names may be defined in text that could not be read. Discard recorded warnings that call
        an import unused if it is returned as an error.
        """
        patterns = {one.qualified_name: one for one in self._definitions_of(Pattern)}
        wrong = [
            one
            for name, file in self.files_read.items()
            for one in check_imported_patterns(file, patterns, name, unknown)
        ]
        places = {one.span for one in wrong}
        # An unknown pattern is not also reported as unused.
        self.diagnostics = [one for one in self.diagnostics if one.code != "unused-import" or one.span not in places]
        if wrong or unknown:
            return wrong
        for name, (file, _) in self.metamodels.files.items():
            self.files_read[name].is_metamodel = True
            self.files_read[name].defined_names = defined_names(file.metamodel) if file.metamodel else set()
            if name in self.metamodels.ecore and file.metamodel:
                for other, (document, _) in self.metamodels.ecore.items():
                    self.files_read[other].is_metamodel = True
                    self.files_read[other].defined_names = defined_names(file.metamodel, set(document.import_names()))
        given = self.metamodels.given
        if given is not None and not self.metamodels.files:
            self.files_read[""] = LoadedFile(defined_names=defined_names(given), is_metamodel=True)
        return list(warn_unused_files(self.files_read))

    def _check_conformance(self, models: Iterable[ModelText]) -> list[Diagnostic]:
        """Return the violations by models: errors if the initial model of a family is incomplete, else warnings."""
        initial = {spec.model.text for spec in self.families if spec.optimise is None}
        return [
            replace(one, severity=Severity.ERROR)
            if one.code == "conformance" and text.span.source.name in initial
            else one
            for text in models
            for one in conformance_warnings(text)
        ]

    def _combine_metamodels(self) -> Metamodel | None:
        self.diagnostics += self.metamodels.combine_ecore(self._reading_order())
        for file, _ in self.metamodels.files.values():
            self._record(file.diagnostics, file.lost)
        self.diagnostics += self.metamodels.check_single()
        return self.metamodels.main

    def _read_schemas(self) -> None:
        """Read the existing metamodel files that models refer to, if no metamodel was given or imported."""
        if not self.metamodels:
            for name in dict.fromkeys(self.mentioned_schemas):
                if self.files.exists(name):
                    self._read_with_imports(name)

    def _resolve_names(self) -> None:
        """Find the metamodels that are imported by URI or name; report unknown URIs; read other imports as paths."""
        uris = {one.path for one, _ in self.unresolved_imports}
        if ECORE in uris and uris <= set(_LIBRARIES) and not self.metamodels:
            from envgraph.lang.interchange._ecore_document import ecore_metamodel_document

            self.metamodels.ecore[ECORE] = ecore_metamodel_document(), None
            self.files_read[ECORE] = LoadedFile()
        read = [self.files_read[name].source for name in self.roots if not name.endswith(".toml")]
        while self.unresolved_imports:
            import_, beside = self.unresolved_imports.pop(0)
            known = self.metamodels.importable_names()
            if import_.path in known or import_.path in _LIBRARIES:
                self.files_read[beside].imports.append((import_, known.get(import_.path)))
                continue
            if not re.match(r"[a-zA-Z][\w+.-]+:", import_.path):
                target = self.files.name(import_.path, beside=beside)
                self.files_read[beside].imports.append((import_, target))
                self._read_with_imports(target, import_)
                continue
            if None in read or self.metamodels.has_unreadable_file:
                continue  # A file that could not be read may be the metamodel, or name it.
            hint = similar_uri_hint(import_.path, known)
            if hint is None:
                hint = NAME_METAMODEL_HINT
            message = f"no metamodel has the uri `{import_.path}`"
            self.incomplete = True
            self.diagnostics.append(Diagnostic("unknown-uri", message, import_.span, hint))

    def _read_models(self, metamodel: Metamodel | None, lost: frozenset[str]) -> list[ModelText]:
        """Return the models of all files; an XMI document that another one refers to is part of the other's model."""
        models: list[ModelText] = []
        parts: set[str] = set()
        for name, file in self._files_in("model"):
            if name in parts or file.source is None:
                continue
            if file.parsed is not None:
                found = read_models(file.parsed, metamodel)
            elif file.format == "json":
                from envgraph.lang.interchange._json_reader import read_json_model

                found = read_json_model(file.source, metamodel)
            else:
                from envgraph.lang.interchange._xmi_reader import read_xmi

                unresolved = self.metamodels.allow_unresolved
                found = read_xmi(file.source, metamodel, lost, self._read_document, allow_unresolved=unresolved)
            models += found.models
            self.diagnostics += found.diagnostics
            parts.update(one for one in found.parts if one != name)
        return [one for one in models if one.span.source.name not in parts]

    def _read_document(self, path: str, beside: str) -> Source | None:
        """Return another XMI document, or the metamodel file with this nsURI; None for an unknown URI.

        Raises:
            LoadError: the document cannot be read.
        """
        from envgraph.lang.interchange._ecore_document import find_linked_file

        for document, _ in self.metamodels.ecore.values():
            # The name of a built-in file is its nsURI.
            if path in document.uris and document.source.name != path:
                return document.source
        name = find_linked_file(self.files, path, beside)
        if name is None:
            if re.match(r"[a-zA-Z][\w+.-]+:", path):
                return None
            name = self.files.name(path, beside=beside)
        file = self.files_read.setdefault(name, LoadedFile("xmi"))
        if file.source is None:
            file.source = read_source(self.files, name)
        return file.source

    def _reading_order(self) -> dict[str, int]:
        """Return the position of each file in the order of reading."""
        return {name: place for place, name in enumerate(self.files_read)}

    def _sorted_diagnostics(self) -> tuple[Diagnostic, ...]:
        """Return the diagnostics in the order of reading and of the text, without suppressed and repeated ones."""
        order = self._reading_order()

        def key(one: Diagnostic) -> tuple[int, int, int]:
            if one.span is None:
                return (-1, 0, 0)
            return (order.get(one.span.source.name, -1), one.span.start, one.span.end)

        found = dict.fromkeys(apply_suppressions(self.diagnostics, self.suppressions))
        return tuple(merge_unknown_names(sorted(found, key=key)))


def _parse_text(language: str, name: str, text: str) -> tuple[ParseResult, frozenset[str]]:
    """Return the parsed text of a file, and all names in it."""
    parsed, lexemes = parse_tokens(load_grammar(language), Source(name, text))
    return parsed, frozenset(one.value for one in lexemes if one.kind == "NAME")


def _file_name(problem: Diagnostic) -> str | None:
    return problem.span.source.name if problem.span else None


def _languages_hint() -> str:
    return "use files that end in " + ", ".join(f"`.{language}`" for language in LANGUAGE_OF)
