"""The domains of action parameters: types and numbers of values."""

from __future__ import annotations

from envgraph.behaviour._behaviour import Domain
from envgraph.metamodel import EnumType, Metamodel, Scalar
from envgraph.pattern import ObjectType, StaticType


def domain_type(domain: Domain, metamodel: Metamodel) -> StaticType | None:
    """Return the type of a domain's values; None if its name is neither that of an enum nor of a class."""
    name = domain.enum or domain.cls
    if name is None:
        return Scalar.INT
    if name in metamodel.enums:
        return metamodel.enums[name]
    return ObjectType(name) if name in metamodel.classes else None


def domain_size(domain: Domain, metamodel: Metamodel) -> int:
    """Return the number of values in a domain; 1 for objects, whose number only a model determines."""
    type_ = domain_type(domain, metamodel)
    if type_ is Scalar.INT:
        return max(0, domain.high - domain.low + 1)
    return len(type_.literals) if isinstance(type_, EnumType) else 1
