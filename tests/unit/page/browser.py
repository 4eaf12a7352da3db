"""A page without a browser: it sends requests to a connection, and keeps what it was sent."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from envgraph.page import Connection, Target, find_target


class Refused(Exception):
    """An error that a request was answered with; `data` is the error."""

    def __init__(self, data: dict[str, Any]) -> None:
        super().__init__(data["message"])
        self.data = data


class Page:
    """A page that shows a target, or what is at a location."""

    def __init__(self, target: Target | str, runs: Path = Path("no-runs")) -> None:
        self.sent: list[dict[str, Any]] = []
        found = target if isinstance(target, Target) else find_target(target, runs)
        self.connection = Connection(lambda text: self.sent.append(json.loads(text)), found)
        self._last = 0

    def ask(self, method: str, **params: Any) -> Any:
        """Return the result of a request; long work is done at once."""
        self._last += 1
        self.receive({"jsonrpc": "2.0", "id": self._last, "method": method, "params": params})
        (answer,) = (one for one in self.sent if one.get("id") == self._last)
        if "error" in answer:
            raise Refused(answer["error"])
        return answer["result"]

    def receive(self, message: Any) -> None:
        text = message if isinstance(message, str) else json.dumps(message)
        work = self.connection.receive(text)
        if work is not None:
            work.finish(work.run())

    def tell(self, method: str, **params: Any) -> None:
        """Send a notification, and let the connection check the texts."""
        self.receive({"jsonrpc": "2.0", "method": method, "params": params})
        while (work := self.connection.next_work()) is not None:
            work.finish(work.run())

    def edit(self, name: str, old: str, new: str) -> None:
        """Replace a part of a text of the folder, in the editor."""
        file = next(one for one in self.ask("page/open")["files"] if one["name"] == name)
        document = {"uri": file["uri"], "version": 1, "languageId": file["language"], "text": file["text"]}
        assert old in file["text"]
        self.tell("textDocument/didOpen", textDocument=document)
        self.tell(
            "textDocument/didChange",
            textDocument={"uri": file["uri"], "version": 2},
            contentChanges=[{"text": file["text"].replace(old, new)}],
        )

    def notifications(self, method: str) -> list[Any]:
        return [one["params"] for one in self.sent if one.get("method") == method]
