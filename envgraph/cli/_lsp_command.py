"""The command `envgraph lsp`: the language server for text editors."""

from __future__ import annotations

from envgraph.errors import InvalidArgument


def serve_editor() -> int:
    """Answer an editor over standard input and output until it ends the session; return the exit code.

    Raises:
        InvalidArgument: pygls is not installed.
    """
    try:
        from envgraph.editor import serve_stdio
    except ImportError as error:
        raise InvalidArgument("the language server needs pygls", "run `pip install 'envgraph[editor]'`") from error
    return serve_stdio()
