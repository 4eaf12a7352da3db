"""The language server without its connection: it takes requests and notifications as JSON objects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from envgraph.editor._documents import JsonObject

Notify = Callable[[str, JsonObject], None]
"""A function that sends a notification, by its method and parameters, to the editor."""


class LanguageService:
    """The state of a language server: the open documents and what is known of their files."""

    def __init__(self, notify: Notify) -> None:
        """Create a service without documents; `notify` sends its notifications."""
        self.notify = notify

    def answer(self, method: str, params: JsonObject) -> Any:
        """Return the result of a request or, for a notification of the editor, None.

        Raises:
            InvalidArgument: there is no such method.
        """
        raise NotImplementedError


METHODS: Final[dict[str, Callable[[LanguageService, JsonObject], Any]]] = {}
"""The function that answers each method of the protocol."""
