"""The command line."""

from envgraph.cli._app import app, main

__all__ = ["app", "main"]
