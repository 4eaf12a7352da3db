"""The command `envgraph serve`: show a domain or a run on a page in the browser."""

from __future__ import annotations

import sys
from pathlib import Path

from envgraph.cli._output import print_line
from envgraph.page import serve


def serve_page(shown: str | None, *, port: int | None, no_browser: bool, directory: Path) -> None:
    """Serve the page of a folder, a bundled domain or a run until Ctrl-C, and print its address."""

    def announce(line: str) -> None:
        print_line(line)
        sys.stdout.flush()  # the command goes on

    serve(shown, announce, port=port, browser=not no_browser, runs=directory)
