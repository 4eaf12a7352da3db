"""Start the server of the page, and open the browser."""

from __future__ import annotations

import asyncio
import gc
import socket
from collections.abc import Callable
from pathlib import Path
from secrets import token_urlsafe
from threading import Thread
from typing import Final

from envgraph.errors import InvalidArgument
from envgraph.page._targets import find_target

BUILT: Final = Path(__file__).with_name("built")
"""The directory of the built page: `make page` writes it, and wheels contain it."""


def serve(
    location: str | None,
    announce: Callable[[str], None],
    *,
    port: int | None = None,
    browser: bool = True,
    runs: Path = Path("runs"),
) -> None:
    """Serve a page about a folder, a bundled domain or a run to browsers on this machine, until it is interrupted.

    Args:
        location: see `find_target`.
        announce: called with the address of the page.
        port: None for a free port.
        browser: True to open the address in the browser.
        runs: the directory of all runs.

    Raises:
        InvalidArgument: the extra `web` or the built page is missing, there is nothing at the location, or the port is
            used by another program.
    """
    try:
        import uvicorn

        from envgraph.page._server import MAX_MESSAGE, make_app
    except ImportError as error:
        raise InvalidArgument(f"the page needs a web server: {error}", 'run `pip install "envgraph[web]"`') from error
    if not (BUILT / "index.html").is_file():
        raise InvalidArgument("the page is not built", "run `make page` in its checkout, then install envgraph again")
    target = find_target(location, runs)
    with _listen(port or 0) as listening:
        chosen = listening.getsockname()[1]
        token = token_urlsafe(24)
        address = f"http://127.0.0.1:{chosen}/?token={token}"
        app = make_app(target, BUILT, token, chosen)
        config = uvicorn.Config(
            app, log_level="warning", ws_max_size=4 * MAX_MESSAGE, timeout_graceful_shutdown=2, lifespan="off"
        )
        gc.set_threshold(100_000)  # as in `serve_stdio`

        async def run() -> None:  # Ctrl-C ends it from its first line on
            announce(f"{target.title}: {address}")
            announce("Ctrl-C stops the server")
            if browser:
                import webbrowser

                # Browsers in a terminal return only when they are closed.
                Thread(target=webbrowser.open, args=(address,), daemon=True).start()
            await uvicorn.Server(config).serve(sockets=[listening])

        asyncio.run(run())


def _listen(port: int) -> socket.socket:
    """Return a socket of this machine that waits for connections at a port; 0 for a free port."""
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(("127.0.0.1", port))
        listening.listen(100)
    except OSError as error:
        listening.close()
        message = f"port {port} cannot be used: {error.strerror}"
        raise InvalidArgument(message, "choose another with `--port`, or leave it out") from error
    return listening
