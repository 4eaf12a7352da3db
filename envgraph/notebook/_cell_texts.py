"""The texts that the cells of a notebook define, as files in memory that import each other and files on the disk."""

from __future__ import annotations

from pathlib import Path

from envgraph.errors import LIMITS, Diagnostic, check_known
from envgraph.files import replace_file
from envgraph.lang import DiskFiles, Workspace, load_workspace


class CellFiles(DiskFiles):
    """The files of the file system, and texts that stand for files in the working directory or take their place."""

    def __init__(self) -> None:
        """Start without texts."""
        self.texts: dict[str, str] = {}

    def read(self, name: str, max_bytes: int = LIMITS["file bytes"]) -> bytes:
        """Return a text in UTF-8, or what a file on the disk contains."""
        return self.texts[name].encode() if name in self.texts else super().read(name, max_bytes)

    def exists(self, name: str) -> bool:
        """Return True if a text or a regular file on the disk has this name."""
        return name in self.texts or super().exists(name)


class CellTexts:
    """The texts of the cells so far, by file name. They are checked together, in the order of their first cells."""

    def __init__(self) -> None:
        """Start without texts."""
        self._files = CellFiles()

    @property
    def names(self) -> tuple[str, ...]:
        """Return the file names of the texts, in the order of their first cells."""
        return tuple(self._files.texts)

    def put(self, name: str, text: str) -> tuple[list[Diagnostic], list[Diagnostic]]:
        """Add or replace a text; return the diagnostics of this text, and the errors of all others."""
        self._files.texts[name] = text
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
        del self._files.texts[name]

    def workspace(self) -> Workspace:
        """Return the content of all texts and of the files that they import."""
        return load_workspace(self.names, files=self._files)

    def save(self, folder: Path) -> list[Path]:
        """Write every text to a file in a folder, which is created if it is missing, and return the paths.

        Raises:
            OSError: a file cannot be written.
        """
        paths = [folder / name for name in self.names]
        for path, text in zip(paths, self._files.texts.values(), strict=True):
            replace_file(path, text)
        return paths
