"""Which files the commands take, and how they are read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from envgraph.cli._output import print_diagnostics
from envgraph.code import dataclass
from envgraph.errors import InvalidArgument
from envgraph.lang import FORMATS, DiskFiles, Workspace, file_format, open_workspace

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


def as_overrides(options: Mapping[str, int | None]) -> list[str]:
    """Return the given options as `--set` takes them; their names are keys of a family file."""
    return [f"{key}={value}" for key, value in options.items() if value is not None]


@dataclass(frozen=True, slots=True)
class Inputs:
    """How files are read: the options that many commands share.

    Attributes:
        metamodels: what else is read; () for none.
        allow_unresolved: whether links of EMF models to what is nowhere are left out.
        variant: which environment of a run or family is the model; None for a model of its own.
    """

    metamodels: Sequence[str] = ()
    allow_unresolved: bool = False
    variant: str | None = None

    def load(self, *paths: str, own: bool = False) -> Workspace:
        """Return what the metamodels and some files say; prints their warnings.

        What a model lacks is for `envgraph check` to say. The first of several `.ecore` files has the metamodel's own
        package: one of `paths` if these are `own`.

        Raises:
            LoadError: the files have errors.
        """
        self.check()
        files = (*paths, *self.metamodels) if own else (*self.metamodels, *paths)
        workspace = open_workspace(*files, allow_unresolved=self.allow_unresolved)
        workspace.raise_errors()
        print_diagnostics(one for one in workspace.diagnostics if one.code != "conformance")
        return workspace

    def check(self) -> None:
        """Refuse metamodels that are other files."""
        for one in self.metamodels:
            take(one, METAMODELS, A_METAMODEL)
