"""Where texts come from: the disk, or texts at hand, such as those that a run keeps."""

from __future__ import annotations

import os
import posixpath
from codecs import BOM_UTF8
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NoReturn, Protocol

from envgraph.code import dataclass
from envgraph.errors import RAISE_LIMIT, LoadError, Source, did_you_mean, limit, listed
from envgraph.files import open_input
from envgraph.lang.syntax._formats import HEAD, UNCLEAR, format_of
from envgraph.lang.syntax._xml import decoded, xml_source

LARGEST_FILE = 16 * 1024 * 1024
LARGEST_MODEL = 256 * 1024 * 1024
"""Of files that programs write: models as XMI or JSON, traces."""
LARGEST_QUERIES = 1024 * 1024
"""Of files with definitions that are checked together, which takes about 10 seconds for each MB."""

_XML = ("ecore", "xmi")
_WRITTEN = ("xmi", "json", "family", "trace")
_DIVIDED = ("query", "vql", "rules", "environment")
_LARGEST = dict.fromkeys(_WRITTEN, LARGEST_MODEL) | dict.fromkeys(_DIVIDED, LARGEST_QUERIES)


class Files(Protocol):
    """Access to files by name; names are what diagnostics show, and equal names are the same file."""

    def name(self, path: str, beside: str | None = None) -> str:
        """The name of a path, which may be relative to the directory of the file named `beside`."""

    def read(self, name: str, most: int = LARGEST_FILE) -> bytes:
        """The contents, or of a file above `most` bytes at least one byte more than that.

        Raises:
            OSError: there is no such file, or it cannot be read.
            ValueError: this cannot be the name of a file.
        """

    def is_directory(self, name: str) -> bool:
        """Return whether the name is that of a directory."""

    def exists(self, name: str) -> bool:
        """Return whether there is a file of this name."""

    def entries(self, name: str) -> list[str]:
        """The names of what a directory holds, sorted; () when there is no such directory."""


class DiskFiles:
    """The file system; names are relative to the working directory where that is shorter."""

    def name(self, path: str, beside: str | None = None) -> str:
        """See `Files`."""
        if "\0" in path:
            return path
        full = os.path.realpath(os.path.join(os.path.dirname(beside), path) if beside else path)
        here = os.path.realpath(os.curdir)
        inside = full == here or full.startswith(here.rstrip(os.sep) + os.sep)
        return Path(os.path.relpath(full, here) if inside else full).as_posix()

    def read(self, name: str, most: int = LARGEST_FILE) -> bytes:
        """See `Files`."""
        with open_input(name) as file:
            # Only as much memory as the file has bytes: a limit may be raised beyond all memory.
            return file.read() if os.fstat(file.fileno()).st_size <= most else file.read(most + 1)

    def is_directory(self, name: str) -> bool:
        """See `Files`."""
        return "\0" not in name and os.path.isdir(name)

    def exists(self, name: str) -> bool:
        """See `Files`."""
        return "\0" not in name and os.path.isfile(name)

    def entries(self, name: str) -> list[str]:
        """See `Files`."""
        try:
            return sorted((Path(name) / entry).as_posix() for entry in os.listdir(name))
        except OSError:
            return []


class TextFiles:
    """Texts at hand, by name; `/` separates directories.

    >>> files = TextFiles({"a/b.query": "", "a/c.metamodel": ""})
    >>> files.name("c.metamodel", beside="a/b.query")
    'a/c.metamodel'
    """

    def __init__(self, texts: Mapping[str, str]) -> None:
        self._texts = {posixpath.normpath(name): text for name, text in texts.items()}

    def name(self, path: str, beside: str | None = None) -> str:
        """See `Files`."""
        return posixpath.normpath(posixpath.join(posixpath.dirname(beside or ""), path))

    def read(self, name: str, most: int = LARGEST_FILE) -> bytes:
        """See `Files`."""
        if name not in self._texts:
            raise FileNotFoundError(2, "No such file", name)
        return self._texts[name].encode()

    def is_directory(self, name: str) -> bool:
        """See `Files`."""
        return bool(self.entries(name))

    def exists(self, name: str) -> bool:
        """See `Files`."""
        return name in self._texts

    def entries(self, name: str) -> list[str]:
        """See `Files`."""
        start = "" if name == "." else name + "/"
        inside = {one[len(start) :].split("/")[0] for one in self._texts if one.startswith(start)}
        return sorted(start + one for one in inside)


@dataclass(frozen=True, slots=True)
class Bundle:
    """A set of files that can be loaded anywhere: names relative to a common directory, and which were asked for.

    `load_workspace(bundle.roots, files=TextFiles(bundle.texts))` reads the same as from the disk.
    """

    roots: tuple[str, ...]
    texts: Mapping[str, str]


def bundle(roots: Iterable[str], texts: Mapping[str, str]) -> Bundle:
    """The bundle of texts by full or relative name."""
    names = {name: os.path.abspath(name) for name in (*texts, *roots)}
    base = os.path.commonpath([os.path.dirname(full) for full in names.values()]) if names else ""

    def short(name: str) -> str:
        return Path(os.path.relpath(names[name], base)).as_posix()

    return Bundle(
        tuple(short(root) for root in roots), {short(name): text for name, text in sorted(texts.items())}
    )


def file_format(files: Files, name: str) -> str | None:
    """Return what a file is (see `format_of`); None where nothing says it, or the file cannot be read."""
    known = format_of(name, b"")
    if known is not None and known not in UNCLEAR:
        return known
    try:
        return format_of(name, files.read(name, HEAD))
    except (OSError, ValueError):
        return known


def read_source(files: Files, name: str) -> Source:
    """The text of a file.

    Raises:
        LoadError: the file is missing, a directory or another thing that is no file, unreadable, larger than 16 MB (a
            model as XMI or JSON, a trace: 256 MB; queries, rules and environments: 1 MB), or not UTF-8 (XML: not what
            it declares). The diagnostic is at the start of the file.
    """
    format = file_format(files, name)
    most = limit(_LARGEST.get(format or "", LARGEST_FILE))
    try:
        if files.is_directory(name):
            raise IsADirectoryError
        data = files.read(name, most)
    except FileNotFoundError:
        _refuse(name, "missing-file", "there is no such file", _near(files, name))
    except NotADirectoryError:
        _refuse(
            name, "not-a-file", "a part of the path is a file, not a directory", "look at the `/` in the path"
        )
    except IsADirectoryError:
        _refuse(name, "not-a-file", "this is a directory, not a file", _inside(files, name))
    except (OSError, ValueError) as error:
        _refuse(name, "unreadable-file", f"the file cannot be read: {_reason(error)}", None)
    if len(data) > most:
        divide = "divide it: files can import each other; " if format in _DIVIDED else ""
        _refuse(name, "file-too-large", f"the file has more than {most / 2**20:g} MB", divide + RAISE_LIMIT)
    if format in _XML:
        return xml_source(name, data)
    return Source(name, decoded(name, data.removeprefix(BOM_UTF8), "utf-8"))


def _refuse(name: str, code: str, message: str, hint: str | None) -> NoReturn:
    raise LoadError.of(code, message, Source(name, "").span(0, 0), hint) from None


def _inside(files: Files, name: str) -> str | None:
    """Return what may have been meant by the name of a directory."""
    known = [one.rpartition("/")[2] for one in files.entries(name) if "." in one]
    return f"name a file of it: {listed(known)}" if known else "it has no files"


def _reason(error: Exception) -> str:
    return (error.strerror or "") if isinstance(error, OSError) else str(error)


def in_directory(directory: str, entry: str) -> str:
    """The name of a file in a directory of this name; the working directory is left out, as names of files do.

    >>> in_directory(".", "family.toml"), in_directory("a", "family.toml")
    ('family.toml', 'a/family.toml')
    """
    return posixpath.normpath(posixpath.join(directory, entry))


def _near(files: Files, name: str) -> str | None:
    """The nearest file name in the same directory."""
    directory, _, last = name.rpartition("/")
    beside = [entry.rpartition("/")[2] for entry in files.entries(directory or ".")]
    return did_you_mean(last, beside)
