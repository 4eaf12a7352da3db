"""Answer the messages of a page inside its browser, with texts in memory; `python.mjs` runs this file."""

import json
from collections.abc import Callable

from envgraph.lang import TextFiles
from envgraph.page import Connection, Target, Work


class Playground:
    """The connection of a page: pass each message of the page to `receive`; it calls `send` with each message back."""

    def __init__(self, send: Callable[[str], None], title: str, domain: str) -> None:
        """Open a domain, given as JSON with the names and texts of its files."""
        texts = {one["name"]: one["text"] for one in json.loads(domain)["files"]}
        self._connection = Connection(send, Target(title, TextFiles(texts), "."))

    def receive(self, text: str) -> None:
        """Answer a message."""
        self._do(self._connection.receive(text))

    def work(self) -> bool:
        """Check texts that were edited; return True if there may be more to do. Call this when no message waits."""
        work = self._connection.next_work()
        self._do(work)
        return work is not None

    def _do(self, work: Work | None) -> None:
        if work is not None:  # no other thread exists that could do it while messages are answered
            work.finish(work.run())
