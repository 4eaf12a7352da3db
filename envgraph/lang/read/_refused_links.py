"""How to mend a link that a model refuses, wherever it was written."""

from __future__ import annotations

from envgraph.errors import RuleError, TypeMismatch
from envgraph.metamodel import Reference


def link_hint(error: RuleError | TypeMismatch, reference: Reference) -> str:
    """What to write instead of a link of the reference."""
    match error:
        case RuleError(reason="full"):
            return "leave one of the links out; how many there may be stands in the metamodel"
        case RuleError(reason="containment"):
            return "nothing can be inside itself: leave one of the links out"
    return f"name an object of class `{reference.target}`"
