"""CLIPS 6.4 through clipspy, where it is installed: rules fired by a Rete network in C."""

from __future__ import annotations

from typing import Any

from benchmarks._peers import peer

clips = peer("clips")


class Clips:
    """An environment with some constructs, reset.

    Args:
        constructs: in the language of CLIPS, one after the other.
    """

    def __init__(self, constructs: str) -> None:
        self.environment = clips.Environment()
        for construct in split(constructs):
            self.environment.build(construct)
        self.environment.reset()
        self.symbol = clips.Symbol

    def add(self, template: str, **slots: object) -> Any:
        """Assert a fact."""
        return self.environment.find_template(template).assert_fact(**slots)

    def run(self, limit: int | None = None) -> int:
        """Fire rules, at most so many, and tell how many."""
        return int(self.environment.run(limit))

    def count(self, template: str) -> int:
        """The number of facts of a template."""
        return sum(1 for fact in self.environment.facts() if fact.template.name == template)


def split(constructs: str) -> list[str]:
    """The constructs of a text: what stands between outermost parentheses.

    >>> split("(a (b)) (c)")
    ['(a (b))', '(c)']
    """
    found, depth, start = [], 0, 0
    for place, letter in enumerate(constructs):
        if letter == "(":
            start = place if depth == 0 else start
            depth += 1
        elif letter == ")":
            depth -= 1
            if depth == 0:
                found.append(constructs[start : place + 1])
    return found
