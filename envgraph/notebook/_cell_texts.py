"""The texts that the cells of a notebook define, as files in memory that import each other and files on the disk."""

from __future__ import annotations

from pathlib import Path

from envgraph.editor import EditedFiles
from envgraph.errors import Diagnostic, check_known
from envgraph.files import replace_file
from envgraph.lang import Workspace, load_workspace


class CellTexts:
    """The texts of the cells so far, by file name. They are checked together, in the order of their first cells."""

    def __init__(self) -> None:
        """Start without texts."""
        self._texts: dict[str, str] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Return the file names of the texts, in the order of their first cells."""
        return tuple(self._texts)

    def put(self, name: str, text: str) -> tuple[list[Diagnostic], list[Diagnostic]]:
        """Add or replace a text; return the diagnostics of this text, and the errors of all others."""
        self._texts[name] = text
        own, others = [], []
        workspace = self.workspace()
        for one in workspace.diagnostics:
            if one.span is None or one.span.source.name == name:
                own.append(one)
            elif one in workspace.errors:
                others.append(one)
        return own, others

    def forget(self, name: str) -> None:
        """Remove a text.

        Raises:
            InvalidArgument: there is no such text.
        """
        check_known(name, self.names, f"no cell has defined `{name}`")
        del self._texts[name]

    def workspace(self) -> Workspace:
        """Return the content of all texts and of the files that they import."""
        return load_workspace(self.names, files=EditedFiles(self._texts))

    def save(self, folder: Path) -> list[Path]:
        """Write every text to a file in a folder, which is created if it is missing, and return the paths.

        Raises:
            OSError: a file cannot be written.
        """
        paths = [folder / name for name in self.names]
        for path, text in zip(paths, self._texts.values(), strict=True):
            replace_file(path, text)
        return paths
