"""Read source texts by name, from the disk or from texts in memory, such as the texts stored with a run."""

from __future__ import annotations

import os
import posixpath
from codecs import BOM_UTF8
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NoReturn, Protocol

from envgraph.code import dataclass
from envgraph.errors import (
    LIMITS,
    RAISE_LIMIT_HINT,
    LoadError,
    Source,
    did_you_mean,
    list_names,
    scaled_limit,
)
from envgraph.files import open_input
from envgraph.lang.syntax._file_formats import AMBIGUOUS_SUFFIXES, HEAD_BYTES, format_of
from envgraph.lang.syntax._xml_parser import decode_text, decode_xml_source

_XML = ("ecore", "xmi")
_WRITTEN = ("xmi", "json", "family", "trace")
_DIVIDED = ("query", "vql", "rules", "environment")
_BYTES = dict.fromkeys(_WRITTEN, "model bytes") | dict.fromkeys(_DIVIDED, "query bytes")


class Files(Protocol):
    """Access to files by name; diagnostics show these names, and equal names refer to the same file."""

    def name(self, path: str, beside: str | None = None) -> str:
        """Return the name for a path; a relative path starts at the directory of the file named `beside`, if given."""

    def read(self, name: str, max_bytes: int = LIMITS["file bytes"]) -> bytes:
        """Return the contents of a file; of a file with more than `max_bytes` bytes at least `most + 1` bytes.

        Raises:
            OSError: the file does not exist or cannot be read.
            ValueError: the name is not a valid file name.
        """

    def is_directory(self, name: str) -> bool:
        """Return True if this is the name of a directory."""

    def exists(self, name: str) -> bool:
        """Return True if a file of this name exists."""

    def entries(self, name: str) -> list[str]:
        """Return the sorted names of the entries of a directory; [] if the directory does not exist."""


class DiskFiles:
    """The files of the file system; files below the working directory have names relative to it."""

    def name(self, path: str, beside: str | None = None) -> str:
        """Return the resolved path: relative to the working directory if the file is below it, else absolute."""
        if "\0" in path:
            return path
        full = os.path.realpath(os.path.join(os.path.dirname(beside), path) if beside else path)
        here = os.path.realpath(os.curdir)
        inside = full == here or full.startswith(here.rstrip(os.sep) + os.sep)
        return Path(os.path.relpath(full, here) if inside else full).as_posix()

    def read(self, name: str, max_bytes: int = LIMITS["file bytes"]) -> bytes:
        """Return the contents of a file, or at least `most + 1` bytes of a larger file."""
        with open_input(name) as file:
            # Allocate no more memory than the file needs: the limit may be raised beyond all memory.
            return file.read() if os.fstat(file.fileno()).st_size <= max_bytes else file.read(max_bytes + 1)

    def is_directory(self, name: str) -> bool:
        """Return True if a directory of this name is on the disk."""
        return "\0" not in name and os.path.isdir(name)

    def exists(self, name: str) -> bool:
        """Return True if a regular file of this name is on the disk."""
        return "\0" not in name and os.path.isfile(name)

    def entries(self, name: str) -> list[str]:
        """Return the sorted paths of the entries of a directory; [] if it cannot be read."""
        try:
            return sorted((Path(name) / entry).as_posix() for entry in os.listdir(name))
        except OSError:
            return []


class TextFiles:
    """Files whose texts are in memory, by name; `/` separates directories.

    >>> files = TextFiles({"a/b.query": "", "a/c.metamodel": ""})
    >>> files.name("c.metamodel", beside="a/b.query")
    'a/c.metamodel'
    """

    def __init__(self, texts: Mapping[str, str]) -> None:
        self._texts = {posixpath.normpath(name): text for name, text in texts.items()}

    def name(self, path: str, beside: str | None = None) -> str:
        """Return the normalised path; it starts at the directory of the file named `beside`, if given."""
        return posixpath.normpath(posixpath.join(posixpath.dirname(beside or ""), path))

    def read(self, name: str, max_bytes: int = LIMITS["file bytes"]) -> bytes:
        """Return the text with this name in UTF-8, whatever its size; raise FileNotFoundError if there is none."""
        if name not in self._texts:
            raise FileNotFoundError(2, "No such file", name)
        return self._texts[name].encode()

    def is_directory(self, name: str) -> bool:
        """Return True if any text is in a directory of this name."""
        return bool(self.entries(name))

    def exists(self, name: str) -> bool:
        """Return True if there is a text with this name."""
        return name in self._texts

    def entries(self, name: str) -> list[str]:
        """Return the sorted names of the texts and directories directly in a directory; [] if it does not exist."""
        start = "" if name == "." else name + "/"
        inside = {one[len(start) :].split("/")[0] for one in self._texts if one.startswith(start)}
        return sorted(start + one for one in inside)


@dataclass(frozen=True, slots=True)
class Bundle:
    """A set of files that can be loaded on any machine.

    `load_workspace(bundle.roots, files=TextFiles(bundle.texts))` reads the same data as from the disk.

    Attributes:
        roots: the names of the files that were asked for; the other files are imported by them.
        texts: the text of each file by its name, relative to the common directory of all files.
    """

    roots: tuple[str, ...]
    texts: Mapping[str, str]


def make_bundle(roots: Iterable[str], texts: Mapping[str, str]) -> Bundle:
    """Return a bundle of the given texts; all names are made relative to their common directory."""
    names = {name: os.path.abspath(name) for name in (*texts, *roots)}
    base = os.path.commonpath([os.path.dirname(full) for full in names.values()]) if names else ""

    def short(name: str) -> str:
        return Path(os.path.relpath(names[name], base)).as_posix()

    return Bundle(tuple(short(root) for root in roots), {short(name): text for name, text in sorted(texts.items())})


def file_format(files: Files, name: str) -> str | None:
    """Return the format of a file (see `format_of`); None if it is unknown, or the file cannot be read."""
    known = format_of(name, b"")
    if known is not None and known not in AMBIGUOUS_SUFFIXES:
        return known
    try:
        return format_of(name, files.read(name, HEAD_BYTES))
    except (OSError, ValueError):
        return known


def read_source(files: Files, name: str) -> Source:
    """Return the text of a file.

    Raises:
        LoadError: the file is missing, a directory or another special file, unreadable, too large, or wrongly encoded.
            At most 16 MB are read; 256 MB of traces and of models as XMI or JSON; 1 MB of queries, rules and
            environments. The encoding is UTF-8; XML files may declare another. The diagnostic points to the wrong byte,
            or else to the start of the file.
    """
    format = file_format(files, name)
    most = scaled_limit(_BYTES.get(format or "", "file bytes"))
    try:
        if files.is_directory(name):
            raise IsADirectoryError
        data = files.read(name, most)
    except FileNotFoundError:
        _raise_load_error(name, "missing-file", "there is no such file", _similar_file_hint(files, name))
    except NotADirectoryError:
        _raise_load_error(
            name, "not-a-file", "a part of the path is a file, not a directory", "check each `/` in the path"
        )
    except IsADirectoryError:
        _raise_load_error(name, "not-a-file", "this is a directory, not a file", _directory_hint(files, name))
    except (OSError, ValueError) as error:
        _raise_load_error(name, "unreadable-file", f"the file cannot be read: {_error_reason(error)}", None)
    if len(data) > most:
        divide = "divide it: files can import each other; " if format in _DIVIDED else ""
        _raise_load_error(
            name, "file-too-large", f"the file has more than {most / 2**20:g} MB", divide + RAISE_LIMIT_HINT
        )
    if format in _XML:
        return decode_xml_source(name, data)
    return Source(name, decode_text(name, data.removeprefix(BOM_UTF8), "utf-8"))


def _raise_load_error(name: str, code: str, message: str, hint: str | None) -> NoReturn:
    raise LoadError.from_problem(code, message, Source(name, "").span_between(0, 0), hint) from None


def _directory_hint(files: Files, name: str) -> str | None:
    """Return a hint for a directory that was given in place of a file: the names of the files in it."""
    known = [one.rpartition("/")[2] for one in files.entries(name) if "." in one]
    return f"name a file in it: {list_names(known)}" if known else "it contains no files"


def _error_reason(error: Exception) -> str:
    return (error.strerror or "") if isinstance(error, OSError) else str(error)


def file_in_directory(directory: str, entry: str) -> str:
    """Return the name of a file in a directory; the working directory `.` is omitted from the name.

    >>> file_in_directory(".", "family.toml"), file_in_directory("a", "family.toml")
    ('family.toml', 'a/family.toml')
    """
    return posixpath.normpath(posixpath.join(directory, entry))


def _similar_file_hint(files: Files, name: str) -> str | None:
    """Return a hint that names the most similar file in the same directory; None if no file is similar."""
    directory, _, last = name.rpartition("/")
    beside = [entry.rpartition("/")[2] for entry in files.entries(directory or ".")]
    return did_you_mean(last, beside)
