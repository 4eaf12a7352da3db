"""Read the files that commands take."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from shlex import quote

from envgraph.cli._output import print_diagnostics
from envgraph.code import dataclass
from envgraph.errors import InvalidArgument, count_with_noun, escape_unprintable
from envgraph.lang import FORMATS, DiskFiles, Workspace, file_format, open_workspace

DEFINITIONS = ("query", "vql", "rules", "environment")
_DEFINITION_SUFFIXES = tuple(f".{one}" for one in DEFINITIONS)
METAMODELS = ("metamodel", "ecore")
MODELS = ("model", "xmi", "json")

METAMODEL_PHRASE = "a metamodel (.metamodel, .ecore)"
MODEL_PHRASE = "a model (.model, .xmi, .json)"
DEFINITIONS_PHRASE = "a file of patterns or rules (.query, .vql, .rules)"


def check_file_format(path: str, formats: tuple[str, ...], wanted: str) -> None:
    """Raise an error if a file has none of the formats; a missing file passes, because the command reports it.

    A directory passes if "toml" is among the formats, because it may hold a family file.

    Args:
        wanted: a phrase for the formats in the message, such as "a model".

    Raises:
        InvalidArgument: the file has another format.
    """
    files = DiskFiles()
    if files.exists(path):
        found = file_format(files, path)
        if found not in formats:
            what = FORMATS[found] if found else "of an unknown format"
            raise InvalidArgument(f"`{path}` is {what}, not {wanted}")
    elif files.is_directory(path) and "toml" not in formats:
        raise InvalidArgument(f"`{path}` is a directory, not {wanted}")


def as_overrides(options: Mapping[str, int | None]) -> list[str]:
    """Return the given options as arguments of `--set`; the names are keys of a family file."""
    return [f"{key}={value}" for key, value in options.items() if value is not None]


@dataclass(frozen=True, slots=True)
class Inputs:
    """The options for reading files that many commands share.

    Attributes:
        metamodels: metamodel files to read in addition.
        allow_unresolved: True to drop links of EMF models to missing objects.
        variant: name of the environment of a run or family to use as model; None if the model is a file.
    """

    metamodels: Sequence[str] = ()
    allow_unresolved: bool = False
    variant: str | None = None

    def load(self, *paths: str, own: bool = False, counts_warnings_of: str | None = None) -> Workspace:
        """Return the workspace of the files and the metamodels; print its warnings, except those about conformance.

        Print only the number of warnings in definitions if `counts_warnings_of` names the file with the definitions.

        If there are several `.ecore` files, the first one gives the metamodel its name and URI. The files in `paths`
        come first if `own` is True, otherwise the files in `metamodels`.

        Raises:
            LoadError: the files have errors.
        """
        self.check_metamodels()
        files = (*paths, *self.metamodels) if own else (*self.metamodels, *paths)
        workspace = open_workspace(*files, allow_unresolved=self.allow_unresolved)
        workspace.raise_errors()
        shown = [one for one in workspace.diagnostics if one.code != "conformance"]
        if counts_warnings_of is not None:
            rest = [one for one in shown if not (one.span and one.span.source.name.endswith(_DEFINITION_SUFFIXES))]
            if count := len(shown) - len(rest):
                command = escape_unprintable(" ".join(map(quote, (*self.metamodels, counts_warnings_of))))
                shows = f"`envgraph check {command}` shows {'it' if count == 1 else 'them'}"
                sys.stderr.write(f"{count_with_noun(count, 'warning')}: {shows}\n")
            shown = rest
        print_diagnostics(shown)
        return workspace

    def check_metamodels(self) -> None:
        """Raise InvalidArgument if a file in `metamodels` is not a metamodel."""
        for one in self.metamodels:
            check_file_format(one, METAMODELS, METAMODEL_PHRASE)
