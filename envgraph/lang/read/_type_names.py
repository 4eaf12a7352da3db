"""Which class or enum a name means in a file: what stands before `::`, and names that several packages have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

from envgraph.code import dataclass
from envgraph.metamodel import Metamodel, Package, simple_name


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
