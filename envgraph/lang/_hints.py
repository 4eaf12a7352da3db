"""What may come next, in the words of a hint."""

from __future__ import annotations

from collections.abc import Sequence

from envgraph.lang._grammar import Grammar

VALUE_WORDS = frozenset(
    ["true", "false", "TRUE", "FALSE", "none", "eval", "count", "sum", "min", "max", "avg"]
)
"""Keywords that a value may start with; they start statements too, so they say little about where one begins."""

_VALUES = frozenset(
    ["a name", "a string", "a whole number", "a number", "`_`", "`#`", "`-`", "`!`", "`(`", "`::`"]
    + [f"`{word}`" for word in VALUE_WORDS]
)
_OPERATORS = frozenset(
    f"`{sign}`"
    for group in (".?+-*/%<>=", ("<=", ">=", "==", "===", "!=", "&&", "||", "and", "or", "as", "instanceof"))
    for sign in group
)
_MOST_SHOWN = 9


def expectation(grammar: Grammar, states: list[int]) -> str:
    """The terminals that a parser with this stack of states takes, as `expected a name or `;``.

    What values start with is called a value, and what continues an expression an operator.
    """
    expected = grammar.expected(states)
    spelt: Sequence[str] = list(dict.fromkeys(grammar.spelling[terminal] for terminal in expected))
    if {"NAME", "STRING", "INT"} <= set(expected):
        spelt = ["a value", *(one for one in spelt if one not in _VALUES)]
    if sum(one in _OPERATORS for one in spelt) > 4:
        spelt = ["an operator", *(one for one in spelt if one not in _OPERATORS)]
    # Kinds of tokens, then signs, then keywords.
    spelt = sorted(
        spelt, key=lambda one: (one.startswith("`") and one[1].isalpha(), one.startswith("`"), one)
    )
    if len(spelt) > _MOST_SHOWN:
        spelt = [*spelt[: _MOST_SHOWN - 1], "another statement"]
    return "expected " + (" or ".join([", ".join(spelt[:-1]), spelt[-1]]) if len(spelt) > 1 else spelt[0])
