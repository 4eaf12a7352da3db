"""Which kinds of files the commands take."""

from __future__ import annotations

from envgraph.errors import InvalidArgument
from envgraph.lang import FORMATS, DiskFiles, file_format

DEFINITIONS = ("query", "vql", "rules", "environment")
METAMODELS = ("metamodel", "ecore")
MODELS = ("model", "xmi", "json")

A_METAMODEL = "a metamodel (.metamodel, .ecore)"
A_MODEL = "a model (.model, .xmi, .json)"
THE_DEFINITIONS = "a file of patterns or rules (.query, .vql, .rules)"


def take(path: str, formats: tuple[str, ...], wanted: str) -> None:
    """Refuse a file of another format; what is not there is for the command to look for.

    Whoever takes a family file takes its directory, too.

    Raises:
        InvalidArgument: it is another file; the message says what, and what is wanted.
    """
    files = DiskFiles()
    if files.exists(path):
        found = file_format(files, path)
        if found not in formats:
            what = FORMATS[found] if found else "of no format that is known"
            raise InvalidArgument(f"`{path}` is {what}, not {wanted}")
    elif files.is_directory(path) and "toml" not in formats:
        raise InvalidArgument(f"`{path}` is a directory, not {wanted}")
