"""The files that the editor sees: texts that are open in it replace those on the disk."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import unquote, urlsplit

from envgraph.errors import LIMITS, InvalidArgument
from envgraph.lang import DiskFiles, Files, TextFiles

_MEMORY = "memory:///"
"""Begins the URIs of files that are not on the disk."""
_ENCODING = re.compile(r"""^(<\?xml[^>]*?)(\sencoding\s*=\s*(?:"[^"]*"|'[^']*'))""")


class EditedFiles(DiskFiles):
    """The files of the disk, but for those whose edited texts are given.

    Args:
        texts: the edited texts by file name; a file that is not on the disk exists, too.
    """

    def __init__(self, texts: Mapping[str, str]) -> None:
        self._texts = dict(texts)

    def read(self, name: str, max_bytes: int = LIMITS["file bytes"]) -> bytes:
        """Return the edited text of a file in UTF-8, whatever its size, or else what is on the disk."""
        if name in self._texts:
            # The declared encoding is that of the disk. A half of a surrogate pair cannot be encoded.
            text = _ENCODING.sub(lambda found: found[1] + " " * len(found[2]), self._texts[name])
            return text.encode("utf-8", "replace")
        return super().read(name, max_bytes)

    def exists(self, name: str) -> bool:
        """Return True if this file has an edited text or is on the disk."""
        return name in self._texts or super().exists(name)

    def entries(self, name: str) -> list[str]:
        """Return the sorted names of the entries of a directory, with edited files that are not on the disk."""
        edited = [one for one in self._texts if (one.rpartition("/")[0] or ".") == name]
        return sorted({*super().entries(name), *edited})


def with_texts(files: Files, texts: Mapping[str, str]) -> Files:
    """Return the files, in which the given texts replace those of the same names."""
    if isinstance(files, DiskFiles):
        return EditedFiles(texts)
    return MemoryFiles(files, texts)


class MemoryFiles(TextFiles):
    """Files in memory, in which the given texts replace those of the same names."""

    def __init__(self, below: Files, texts: Mapping[str, str]) -> None:
        super().__init__(texts)
        self._below = below

    def read(self, name: str, max_bytes: int = LIMITS["file bytes"]) -> bytes:
        """Return the text of a file in UTF-8; raise FileNotFoundError if there is none."""
        return super().read(name) if super().exists(name) else self._below.read(name, max_bytes)

    def exists(self, name: str) -> bool:
        """Return True if there is a text with this name."""
        return super().exists(name) or self._below.exists(name)

    def is_directory(self, name: str) -> bool:
        """Return True if any text is in a directory of this name."""
        return super().is_directory(name) or self._below.is_directory(name)

    def entries(self, name: str) -> list[str]:
        """Return the sorted names of the texts and directories directly in a directory."""
        return sorted({*super().entries(name), *self._below.entries(name)})


def name_of_uri(files: Files, uri: str, suffix: str = "") -> str:
    """Return the file name of a URI; that of a text that was never saved is in the working directory.

    Args:
        files: the files that the name is for.
        uri: a URI such as `file:///home/me/a.query` or `untitled:Untitled-1`.
        suffix: the suffix that is added to a name without one, such as ".query".

    Raises:
        InvalidArgument: this is not a URI, or no file can have this name.
    """
    try:
        parts = urlsplit(uri)
        path = unquote(parts.path)
        if parts.scheme == "file" and isinstance(files, DiskFiles):
            path = re.sub(r"^/(?=[A-Za-z]:)", "", path)  # file:///C:/a on Windows
            return files.name(f"//{parts.netloc}{path}" if parts.netloc not in ("", "localhost") else path)
        path = path.lstrip("/") or "untitled"
        return files.name(path if "." in path.rpartition("/")[2] else path + suffix)
    except ValueError as error:
        raise InvalidArgument(f"`{uri}` is not the address of a file") from error


def uri_of_name(files: Files, name: str) -> str:
    """Return the URI of a file."""
    return Path(os.path.abspath(name)).as_uri() if isinstance(files, DiskFiles) else _MEMORY + name
