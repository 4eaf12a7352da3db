"""Notices of what applications of rules come upon that is no mistake, but may not be meant: each once."""

from __future__ import annotations

import logging
from collections.abc import Callable

from envgraph.errors import Diagnostic, Severity
from envgraph.rewrite._plan import Link

Report = Callable[[str, Link, str, str], None]
"""Takes the name of a rule, what it creates, and the texts of the ends of the link."""


class Notices:
    """Reports, each once for a rule and a place in it; they also go to the logger "envgraph", as warnings."""

    def __init__(self) -> None:
        self._told: dict[tuple[str, Link], Diagnostic] = {}

    @property
    def all(self) -> tuple[Diagnostic, ...]:
        """In the order in which they came."""
        return tuple(self._told.values())

    def existing_link(self, rule: str, link: Link, source: str, target: str) -> None:
        """A rule creates a link that is there."""
        if (rule, link) in self._told:
            return
        message = f"rule `{rule}` creates {source} -{link.reference.name}-> {target}, which is there already"
        hint = "it stays one link; a `not` block can ask that there is none; this is reported once"
        notice = Diagnostic("existing-link", message, link.span, hint, Severity.WARNING)
        self._told[rule, link] = notice
        logging.getLogger("envgraph").warning("%s", notice)
