"""Whether a blank stands between two tokens."""

from __future__ import annotations

from typing import Final

from envgraph.lang.format._tokens import Tokens

_SIGNED: Final = frozenset({"unary", "constant", "positive", "number", "bound", "annotation_number", "index"})
"""Where `-` or `!` belongs to what comes after it."""

_ARROWS: Final = frozenset({"forward", "backward", "half_arrow", "unnamed"})

_CALLS: Final = frozenset(
    {
        "annotation", "arguments", "call", "domains", "evaluation", "function", "method", "parameters",
        "static_method", "terms", "unwind",
    }
)  # fmt: skip
"""What has its `(` directly behind a name."""

_TYPES: Final = frozenset({"aliased_literal", "enum_literal", "static_method", "type"})


def spaced(tokens: Tokens, index: int) -> bool:
    """Return whether a blank stands between a token and the next one."""
    left, right = tokens.words[index], tokens.words[index + 1]
    owner, following = tokens.owners[index], tokens.owners[index + 1]
    if tokens.kinds[index] == "STRING" or tokens.kinds[index] == "TEXT":
        return right not in _CLOSING
    if left in _OPENING or right in _CLOSING or left == "::":
        return False
    if owner == "closure" or left == "#":
        return False
    if left in ("-", "!", "+") and owner in _SIGNED:
        return False
    if owner in _ARROWS and (following in _ARROWS or following == "closure"):
        return False
    return _spaced_before(tokens, index, left, right, following)


_OPENING: Final = frozenset({"(", "[", "@", ".", ".."})
_CLOSING: Final = frozenset({")", "]", ",", ";", ".", ".."})


def _spaced_before(tokens: Tokens, index: int, left: str, right: str, owner: str) -> bool:
    if right == "::":
        return tokens.owners[index] != owner or owner not in _TYPES
    if owner == "closure" or (owner == "nesting" and right == "+"):
        return False
    if right == "(":
        return not (owner in _CALLS or (owner == "group" and _whole_check(tokens, index)))
    if right == "[":
        return owner not in ("multiplicity", "cell")
    if owner == "annotation_named" and (left == "{" or right == "}"):
        return False
    return not (right == ":" and owner == "branch")


def _whole_check(tokens: Tokens, index: int) -> bool:
    """Return whether the brackets after a token are all that it checks: `check(x)`, but `check (x) && (y)`."""
    return index in tokens.whole
