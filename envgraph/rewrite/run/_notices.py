"""Notices about effects of applications that are allowed but may be unintended, each reported once."""

from __future__ import annotations

import logging
from collections.abc import Callable

from envgraph.errors import Diagnostic, Severity
from envgraph.rewrite._rule_plan import AddLink

ReportLink = Callable[[str, AddLink, str, str], None]
"""A function that is called with the name of a rule, the operation, and the texts of both ends of the link."""


class Notices:
    """A collection of notices, one for each rule and operation; also logged as warnings to the logger "envgraph"."""

    def __init__(self) -> None:
        self._reported: dict[tuple[str, AddLink], Diagnostic] = {}

    @property
    def all(self) -> tuple[Diagnostic, ...]:
        """Return the notices in the order of their first occurrence."""
        return tuple(self._reported.values())

    def existing_link(self, rule: str, link: AddLink, source: str, target: str) -> None:
        """Add and log a notice that a rule creates a link that already exists, once for each rule and operation."""
        if (rule, link) in self._reported:
            return
        message = f"rule `{rule}` creates {source} -{link.reference.name}-> {target}, which exists already"
        hint = "add a `not` block if the rule should match only without this link; this is reported once"
        notice = Diagnostic("existing-link", message, link.span, hint, Severity.WARNING)
        self._reported[rule, link] = notice
        logging.getLogger("envgraph").warning("%s", notice)
