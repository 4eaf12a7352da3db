"""The state of reading one file: its diagnostics, its imports, and the meaning of its type names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import field
from itertools import takewhile
from typing import TypeVar

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Note, Severity, Span, did_you_mean, sort_diagnostics
from envgraph.lang.read._ecore_types import ECORE_TYPES
from envgraph.lang.syntax._parser import ParseResult, select_tokens, span_of
from envgraph.metamodel import Metamodel, Package, simple_name, type_name


@dataclass(frozen=True, slots=True)
class TypeNames:
    """The classes and enums that type names stand for in one file.

    Attributes:
        metamodel: None if it is unknown; then a name keeps its qualifier.
        aliases: the paths of packages, by the aliases that the file gives them.
        imported: the paths of packages imported without an alias. If several packages have a class of the same name,
            the class of an imported package is meant.
    """

    metamodel: Metamodel | None = None
    aliases: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    imported: tuple[str, ...] = ()

    def packages(self, qualifier: str) -> tuple[str, ...]:
        """Return the paths of the packages that `qualifier::` names: by an alias, or else by their name or prefix."""
        if qualifier in self.aliases:
            return self.aliases[qualifier]
        known = self.metamodel.packages if self.metamodel else ()
        return tuple(one.path for one in known if qualifier in self._package_names(one))

    def _package_names(self, package: Package) -> tuple[str, ...]:
        assert self.metamodel is not None
        own = (self.metamodel.name,) if not package.path else (package.path.rpartition(".")[2],)
        return (*own, package.prefix)

    def find(self, name: str, qualifier: str | None = None, enums: bool = False) -> list[str]:
        """Return the qualified names of the classes and enums that a name may mean; several if the name is ambiguous.

        Args:
            name: the name without the qualifier before `::`. Without a metamodel, it is returned with its qualifier.
            qualifier: the alias or package before `::`; None if there is none.
            enums: True to find enums only.
        """
        if self.metamodel is None:
            return [f"{qualifier}::{name}" if qualifier else name]
        found = {
            path: one
            for path, one in self.metamodel.full_names(name).items()
            if not enums or one in self.metamodel.enums
        }
        if qualifier is not None:
            if f"{qualifier}::{name}" in found.values() and qualifier not in self.aliases:
                return [f"{qualifier}::{name}"]
            paths = self.packages(qualifier)
            return [one for path, one in found.items() if path in paths]
        near = [one for path, one in found.items() if path in self.imported]
        return near if len(near) == 1 else [*found.values()]

    def suggest_qualified_names(self, name: str) -> str | None:
        """Return a hint for an ambiguous or unknown class name: its full names or a similar name (None: no hint)."""
        return self.metamodel.suggest_class(name) if self.metamodel else None

    def is_unambiguous(self, name: str) -> bool:
        """Return True if a simple name is unknown, or names a single class or enum that is in no package."""
        known = self.metamodel.full_names(name) if self.metamodel else {}
        return len(known) < 2 and all(one == simple_name(one) for one in known.values())


_Item = TypeVar("_Item", Tree[Token], Token)


@dataclass(slots=True)
class FileReading:
    """The state of reading one file.

    A gap is a part of the text that is missing in the data because of an error. Definitions with gaps are left out.
    Their names are then "lost": other definitions may use these names without a report.

    Attributes:
        diagnostics: errors and warnings, added while the file is read.
        aliases: the names after `as` of the imports, with their spans.
        imported: the qualified names of imported patterns, by simple name.
        data_types: names of additional data types that imports define, with the scalar types that they stand for.
    """

    parsed: ParseResult
    diagnostics: list[Diagnostic] = field(default_factory=list)
    aliases: dict[str, Span] = field(default_factory=dict)
    imported: dict[str, str] = field(default_factory=dict)
    data_types: dict[str, str] = field(default_factory=dict)
    java_imports: dict[str, Span] = field(default_factory=dict)
    """The spans of the imports of Java classes, by simple class name."""
    used_names: set[str] = field(default_factory=set)
    """Aliases, imported patterns and Java classes that the file uses."""
    gaps: list[tuple[int, int]] = field(default_factory=list)
    """Start and end of each gap, besides those of syntax errors."""
    types: TypeNames | None = None
    """The meaning of type names; None if there is no metamodel."""
    lost: set[str] = field(default_factory=set)
    """Names of definitions that are left out because they contain gaps."""

    def span(self, item: Tree[Token] | Token) -> Span:
        """Return the span of a tree or token."""
        return span_of(self.parsed.source, item)

    def spans(self, items: Iterable[Tree[Token] | Token]) -> tuple[Span, ...]:
        """Return the spans of several trees or tokens."""
        return tuple(self.span(item) for item in items)

    def text(self, item: Tree[Token] | Token) -> str:
        """Return the source text of a tree or token, with line breaks replaced by blanks."""
        return " ".join(self.span(item).text.split())

    def add(self, diagnostic: Diagnostic) -> None:
        """Record a diagnostic."""
        self.diagnostics.append(diagnostic)

    def error(
        self,
        code: str,
        message: str,
        where: Tree[Token] | Token | Span,
        hint: str | None = None,
        notes: tuple[Note, ...] = (),
    ) -> None:
        """Record an error."""
        span = where if isinstance(where, Span) else self.span(where)
        self.add(Diagnostic(code, message, span, hint, notes=notes))

    def warn(self, code: str, message: str, where: Tree[Token] | Token | Span, hint: str | None = None) -> None:
        """Record a warning."""
        span = where if isinstance(where, Span) else self.span(where)
        self.add(Diagnostic(code, message, span, hint, Severity.WARNING))

    def first_or_report(self, noun: str, items: Iterable[_Item], hint: str | None = None) -> _Item | None:
        """Return the first item (None if there is none), and report all further items as duplicates of `noun`."""
        first: _Item | None = None
        for item in items:
            if first is None:
                first = item
                continue
            notes = (Note("the first one is here", self.span(first)),)
            self.error(
                "duplicate-part",
                f"{noun} occurs twice, but is allowed only once here",
                item,
                hint or "leave one out",
                notes,
            )
        return first

    def record_gap(self, tree: Tree[Token]) -> None:
        """Record the text of a tree as a gap: an error, already reported, keeps its content out of the data."""
        span = self.span(tree)
        self.gaps.append((span.start, span.end))

    def has_gap(self, tree: Tree[Token]) -> bool:
        """Return True if the text of a tree contains a gap or syntax error, so that its data is incomplete."""
        span = self.span(tree)
        if any(span.start <= start < span.end for start, _ in self.parsed.skipped_ranges):
            return True
        # Definitions are read one after the other, so the gaps of the current one are the last.
        recent = takewhile(lambda gap: gap[0] >= span.start, reversed(self.gaps))
        return any(start < span.end for start, _ in recent)

    def check_complete(self, name: Token, tree: Tree[Token]) -> bool:
        """Return True if the text of a definition has no gap; otherwise return False and record its name as lost."""
        if self.has_gap(tree):
            self.lost.add(str(name))
            return False
        return True

    def sorted_diagnostics(self) -> tuple[Diagnostic, ...]:
        """Return all diagnostics in the order of the text, without diagnostics that follow from others."""
        return tuple(sort_diagnostics(self.diagnostics))

    def all_lost(self) -> frozenset[str]:
        """Return all names that may be defined in text that could not be read."""
        return self.parsed.lost_names | self.lost

    def use_alias(self, token: Token) -> None:
        """Record the use of an import alias or package name; report an unknown alias."""
        known = {*self.aliases, *self.parsed.lost_names}
        packages = self.types and (self.types.metamodel is None or self.types.packages(str(token)))
        if token not in known and not packages:
            hint = did_you_mean(token, self.aliases) or f'write `import "..." as {token}`'
            self.error("unknown-alias", f"no import has the alias `{token}`", token, hint)
        self.used_names.add(str(token))


def resolve_type(reading: FileReading, tree: Tree[Token]) -> str:
    """Resolve the `type` tree of a class, enum or data type, and return its name in the metamodel; report errors."""
    alias, name = tree.children
    if isinstance(alias, Token):
        reading.use_alias(alias)
    data = reading.data_types.get(str(name))
    own = reading.types is not None and reading.types.metamodel is not None and reading.types.find(str(name))
    if data is None and not own and not isinstance(alias, Token) and name in ECORE_TYPES:
        data = type_name(ECORE_TYPES[str(name)].type)
    return data or resolve_type_name(reading, str(name), alias if isinstance(alias, Token) else None, tree)


def resolve_type_name(
    reading: FileReading, name: str, alias: Token | None, tree: Tree[Token], enums: bool = False
) -> str:
    """Return the name in the metamodel of a class or enum; return an unknown name unchanged.

    If the name is ambiguous or missing in the package before `::`, report it, record a gap, and return it unchanged.
    """
    types = reading.types
    if types is None or (alias is None and types.is_unambiguous(name)):
        return name
    if types.metamodel is None and alias in reading.aliases:
        return name  # Imports were not followed, so the alias cannot be resolved.
    found = types.find(name, None if alias is None else str(alias), enums)
    if len(found) == 1:
        return found[0]
    where = next(token for token in reversed(select_tokens(tree.children)) if token == name)
    if found:
        reading.error("ambiguous-type", f"`{name}` is in several packages", where, types.suggest_qualified_names(name))
        reading.record_gap(tree)
    elif alias is not None and types.packages(str(alias)) and types.find(name):
        message = f"package `{alias}` has no `{name}`"
        reading.error("unknown-type", message, where, types.suggest_qualified_names(name))
        reading.record_gap(tree)
    return name


def type_name_span(reading: FileReading, tree: Tree[Token]) -> Span:
    """Return the span of the name in a `type` tree, without its qualifier."""
    return reading.span(select_tokens(tree.children)[-1])
