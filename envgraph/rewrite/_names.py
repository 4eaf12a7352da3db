"""Names of rules, units and groups, and the signatures of their calls."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument, did_you_mean, name_hint
from envgraph.pattern import StaticType

Kind = Literal["rule", "unit", "group"]


@dataclass(frozen=True, slots=True)
class Taken:
    """A parameter as a caller sees it; `required`: the callee cannot find values for it."""

    name: str
    type: StaticType | None
    output: bool = False
    required: bool = False


@dataclass(frozen=True, slots=True)
class Signature:
    """Something that a unit can call; `variables` are those of the matches of a rule."""

    name: str
    kind: Kind
    package: str
    parameters: tuple[Taken, ...] = ()
    weight: float = 1.0
    priority: int = 0
    variables: tuple[Taken, ...] = ()

    @property
    def simple(self) -> str:
        """The name without its package."""
        return self.name.removeprefix(f"{self.package}.") if self.package else self.name


class Directory:
    """Qualified names of everything that can be called, and what a name means.

    First a definition of the caller's package, then a qualified name, then a simple name that only one has.
    """

    def __init__(self, signatures: Iterable[Signature] = ()) -> None:
        self.signatures: dict[str, Signature] = {}
        self._simple: dict[str, list[str]] = {}
        for signature in signatures:
            self.add(signature)

    def add(self, signature: Signature) -> None:
        """Make a definition known; the last one of a name counts."""
        if signature.name not in self.signatures:
            self._simple.setdefault(signature.simple, []).append(signature.name)
        self.signatures[signature.name] = signature

    def candidates(self, name: str, package: str = "") -> list[str]:
        """The qualified names that a name may mean: none if it is unknown, several if it is ambiguous."""
        for qualified in (f"{package}.{name}" if package else name, name):
            if qualified in self.signatures:
                return [qualified]
        return self._simple.get(name, [])

    def hint(self, name: str, others: Iterable[str] = ()) -> str | None:
        """The nearest known name, as short as it is understood."""
        known = [simple if len(names) == 1 else names[0] for simple, names in self._simple.items()]
        near = did_you_mean(name, [*known, *self.signatures, *others])
        return near or name_hint(name, known)

    def resolve(self, name: str, what: str = "rule, unit or group") -> str:
        """The one qualified name that a name means.

        Raises:
            InvalidArgument: it means nothing, or several things; or it is no name.
        """
        if not isinstance(name, str):
            raise InvalidArgument(f"a {what} is given by its name, not as {name!r}")
        found = self.candidates(name)
        if len(found) == 1:
            return found[0]
        if found:
            raise InvalidArgument(f"`{name}` is ambiguous: " + ", ".join(f"`{other}`" for other in found))
        raise InvalidArgument(f"unknown {what} `{name}`", self.hint(name))


Scope = Mapping[str, StaticType | None]
