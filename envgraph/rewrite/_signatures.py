"""Signatures of rules, units and groups, and the resolution of their names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument, did_you_mean, name_hint
from envgraph.pattern import StaticType

Kind = Literal["rule", "unit", "group"]


@dataclass(frozen=True, slots=True)
class CallParameter:
    """A parameter of a rule or unit, as callers see it: `is_output` marks `out` parameters.

    `is_required` is True if callers must pass a value, because the callee cannot find values by matching.
    """

    name: str
    type: StaticType | None
    is_output: bool = False
    is_required: bool = False


@dataclass(frozen=True, slots=True)
class Signature:
    """The signature of a rule, unit or group: the information that a call in a unit needs about its callee.

    `variables` are the variables of a rule's matches; units and groups have none.
    """

    name: str
    kind: Kind
    package: str
    parameters: tuple[CallParameter, ...] = ()
    weight: float = 1.0
    priority: int = 0
    variables: tuple[CallParameter, ...] = ()

    @property
    def simple_name(self) -> str:
        """Return the name without its package."""
        return self.name.removeprefix(f"{self.package}.") if self.package else self.name


class SignatureTable:
    """A table of the signatures of all callable rules, units and groups, which resolves names.

    A name is looked up first in the package of the caller, then as a qualified name, then as a simple name if only one
    definition has this simple name.
    """

    def __init__(self, signatures: Iterable[Signature] = ()) -> None:
        self.signatures: dict[str, Signature] = {}
        self._by_simple_name: dict[str, list[str]] = {}
        for signature in signatures:
            self.add_or_replace(signature)

    def add_or_replace(self, signature: Signature) -> None:
        """Add a signature, or replace the earlier signature of the same name."""
        if signature.name not in self.signatures:
            self._by_simple_name.setdefault(signature.simple_name, []).append(signature.name)
        self.signatures[signature.name] = signature

    def candidates(self, name: str, package: str = "") -> list[str]:
        """Return the qualified names that `name` may refer to: none if it is unknown, several if it is ambiguous."""
        for qualified in (f"{package}.{name}" if package else name, name):
            if qualified in self.signatures:
                return [qualified]
        return self._by_simple_name.get(name, [])

    def suggest_name(self, name: str) -> str | None:
        """Return a hint for an unknown name: the most similar name of the table.

        If no name is similar, the hint lists the names of the table. It is None if the table is empty.
        """
        known = [simple if len(names) == 1 else names[0] for simple, names in self._by_simple_name.items()]
        near = did_you_mean(name, [*known, *self.signatures])
        return near or name_hint(name, known)

    def resolve(self, name: str, noun: str = "rule, unit or group") -> str:
        """Return the qualified name that `name` refers to. `noun` is the word for the definition in messages ("rule").

        Raises:
            InvalidArgument: the name is unknown or ambiguous, or is not a string.
        """
        if not isinstance(name, str):
            raise InvalidArgument(f"expected the name of a {noun}, not {name!r}")
        found = self.candidates(name)
        if len(found) == 1:
            return found[0]
        if found:
            raise InvalidArgument(f"`{name}` is ambiguous: " + ", ".join(f"`{other}`" for other in found))
        raise InvalidArgument(f"unknown {noun} `{name}`", self.suggest_name(name))


Scope = Mapping[str, StaticType | None]
