"""One file while its tree becomes data: what readers report, and what names of types mean in it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import field
from itertools import takewhile
from typing import TypeVar

from lark import Token, Tree

from envgraph.code import dataclass
from envgraph.errors import Diagnostic, Note, Severity, Span, did_you_mean, sort_diagnostics
from envgraph.lang.read._ecore_types import ECORE_TYPES
from envgraph.lang.syntax._parsing import Parsed, span_of, tokens
from envgraph.metamodel import Metamodel, Package, simple_name, type_name


@dataclass(frozen=True, slots=True)
class TypeNames:
    """What names of types mean in one file.

    Attributes:
        metamodel: None where it is not known: then a name keeps what stands before it.
        aliases: what the file calls packages, with their paths.
        imported: the paths of the packages that the file imports without an alias: where others have a class of the
            same name, theirs is meant.
    """

    metamodel: Metamodel | None = None
    aliases: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    imported: tuple[str, ...] = ()

    def packages(self, qualifier: str) -> tuple[str, ...]:
        """The paths of the packages that `qualifier::` names."""
        if qualifier in self.aliases:
            return self.aliases[qualifier]
        known = self.metamodel.packages if self.metamodel else ()
        return tuple(one.path for one in known if qualifier in self._calls(one))

    def _calls(self, package: Package) -> tuple[str, ...]:
        assert self.metamodel is not None
        own = (self.metamodel.name,) if not package.path else (package.path.rpartition(".")[2],)
        return (*own, package.prefix)

    def find(self, name: str, qualifier: str | None = None, enums: bool = False) -> list[str]:
        """The classes and enums that may be meant, several where that is not clear.

        Args:
            name: without what stands before `::`.
            qualifier: what stands there.
            enums: whether only an enum can stand here.
        """
        if self.metamodel is None:
            return [f"{qualifier}::{name}" if qualifier else name]
        found = {
            path: one
            for path, one in self.metamodel.named(name).items()
            if not enums or one in self.metamodel.enums
        }
        if qualifier is not None:
            if f"{qualifier}::{name}" in found.values() and qualifier not in self.aliases:
                return [f"{qualifier}::{name}"]
            paths = self.packages(qualifier)
            return [one for path, one in found.items() if path in paths]
        near = [one for path, one in found.items() if path in self.imported]
        return near if len(near) == 1 else [*found.values()]

    def others(self, name: str) -> str | None:
        """Return how to write a name, in all of its packages."""
        return self.metamodel.likely(name) if self.metamodel else None

    def plain(self, name: str) -> bool:
        """Return whether a name needs no look-up: one class or enum at most has it, and is called just so."""
        known = self.metamodel.named(name) if self.metamodel else {}
        return len(known) < 2 and all(one == simple_name(one) for one in known.values())


_Item = TypeVar("_Item", Tree[Token], Token)


@dataclass(slots=True)
class Reading:
    """One file while its tree becomes data.

    Attributes:
        diagnostics: what the tree says that no data can hold, added to while reading.
        aliases: the names after `as` of the imports, with their places.
        imported: simple to qualified name of the patterns that are imported by name.
        data_types: other names of data types that imports bring along.
    """

    parsed: Parsed
    diagnostics: list[Diagnostic] = field(default_factory=list)
    aliases: dict[str, Span] = field(default_factory=dict)
    imported: dict[str, str] = field(default_factory=dict)
    data_types: dict[str, str] = field(default_factory=dict)
    java: dict[str, Span] = field(default_factory=dict)
    """Imported classes of Java, with the imports."""
    used: set[str] = field(default_factory=set)
    """Aliases and imported patterns that the file mentions."""
    gaps: list[tuple[int, int]] = field(default_factory=list)
    """Stretches of the text that are in no data, besides those that the parser gave up."""
    types: TypeNames | None = None
    """What names of types mean; None where there is no metamodel."""
    lost: set[str] = field(default_factory=set)
    """Names of definitions that are left out because of gaps in them."""

    def span(self, item: Tree[Token] | Token) -> Span:
        """The characters that a tree or token was made of."""
        return span_of(self.parsed.source, item)

    def spans(self, items: Iterable[Tree[Token] | Token]) -> tuple[Span, ...]:
        """The same for each of several."""
        return tuple(self.span(item) for item in items)

    def text(self, item: Tree[Token] | Token) -> str:
        """The same as it is written, on one line."""
        return " ".join(self.span(item).text.split())

    def add(self, diagnostic: Diagnostic) -> None:
        """Adds what is wrong."""
        self.diagnostics.append(diagnostic)

    def error(
        self,
        code: str,
        message: str,
        where: Tree[Token] | Token | Span,
        hint: str | None = None,
        notes: tuple[Note, ...] = (),
    ) -> None:
        """Adds an error."""
        span = where if isinstance(where, Span) else self.span(where)
        self.add(Diagnostic(code, message, span, hint, notes=notes))

    def warn(
        self, code: str, message: str, where: Tree[Token] | Token | Span, hint: str | None = None
    ) -> None:
        """Adds a warning."""
        span = where if isinstance(where, Span) else self.span(where)
        self.add(Diagnostic(code, message, span, hint, Severity.WARNING))

    def only(self, what: str, items: Iterable[_Item], hint: str | None = None) -> _Item | None:
        """The first of the items, None if there is none; the others are reported."""
        first: _Item | None = None
        for item in items:
            if first is None:
                first = item
                continue
            notes = (Note("the first one is here", self.span(first)),)
            self.error("duplicate-part", f"{what} stands here twice", item, hint or "leave one out", notes)
        return first

    def gap(self, tree: Tree[Token]) -> None:
        """Notes that the data lacks what a tree says; that has been reported."""
        span = self.span(tree)
        self.gaps.append((span.start, span.end))

    def broken(self, tree: Tree[Token]) -> bool:
        """Return whether the data of a tree lacks something that it says, and may seem wrong for want of it."""
        span = self.span(tree)
        if any(span.start <= start < span.end for start, _ in self.parsed.gaps):
            return True
        # Definitions are read one after the other: the gaps of this one are the last.
        recent = takewhile(lambda gap: gap[0] >= span.start, reversed(self.gaps))
        return any(start < span.end for start, _ in recent)

    def whole(self, name: Token, tree: Tree[Token]) -> bool:
        """Return whether a definition can be checked. If it has gaps, its name is lost: to mention it is no mistake."""
        if self.broken(tree):
            self.lost.add(str(name))
            return False
        return True

    def result(self) -> tuple[Diagnostic, ...]:
        """All diagnostics in the order of the text, without those that follow from others."""
        return tuple(sort_diagnostics(self.diagnostics))

    def all_lost(self) -> frozenset[str]:
        """All names that may be defined in what is not in the data."""
        return self.parsed.lost | self.lost

    def alias(self, token: Token) -> None:
        """A mention of an import by its alias, or of a package by its name."""
        known = {*self.aliases, *self.parsed.lost}
        packages = self.types and (self.types.metamodel is None or self.types.packages(str(token)))
        if token not in known and not packages:
            hint = did_you_mean(token, self.aliases) or f'write `import "..." as {token}`'
            self.error("unknown-alias", f"no import is called `{token}`", token, hint)
        self.used.add(str(token))


def type_of(reading: Reading, tree: Tree[Token]) -> str:
    """The name of a `type` tree in the metamodel; what stands before it is looked up."""
    alias, name = tree.children
    if isinstance(alias, Token):
        reading.alias(alias)
    data = reading.data_types.get(str(name))
    own = reading.types is not None and reading.types.metamodel is not None and reading.types.find(str(name))
    if data is None and not own and not isinstance(alias, Token) and name in ECORE_TYPES:
        data = type_name(ECORE_TYPES[str(name)].type)
    return data or type_named(reading, str(name), alias if isinstance(alias, Token) else None, tree)


def type_named(
    reading: Reading, name: str, alias: Token | None, tree: Tree[Token], enums: bool = False
) -> str:
    """The class or enum of a name; where several packages have one, and no import decides, that is reported."""
    types = reading.types
    if types is None or (alias is None and types.plain(name)):
        return name
    if types.metamodel is None and alias in reading.aliases:
        return name  # imports are not followed
    found = types.find(name, None if alias is None else str(alias), enums)
    if len(found) == 1:
        return found[0]
    where = next(token for token in reversed(tokens(tree.children)) if token == name)
    if found:
        reading.error("ambiguous-type", f"`{name}` is in several packages", where, types.others(name))
        reading.gap(tree)
    elif alias is not None and types.packages(str(alias)) and types.find(name):
        message = f"package `{alias}` has no `{name}`"
        reading.error("unknown-type", message, where, types.others(name))
        reading.gap(tree)
    return name


def type_span_of(reading: Reading, tree: Tree[Token]) -> Span:
    """Return where the name itself stands in a `type` tree."""
    return reading.span(tokens(tree.children)[-1])
