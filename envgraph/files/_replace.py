"""Replacing a file as a whole: a draft beside it is written, flushed to the disk, and renamed."""

from __future__ import annotations

import errno
import os
import re
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from envgraph.errors import InvalidArgument


def replace_file(path: Path, content: str | bytes) -> None:
    """Write a file: text as UTF-8, its line ends as they are.

    Readers see what was there before or the whole new content, and so does everybody after a full disk, Ctrl-C, a
    kill or a power cut. A link stays a link, permissions stay, missing directories are made. What is no regular file,
    such as `/dev/stdout` or a pipe, is written to.

    Raises:
        OSError: the file cannot be written; its `filename` is the path.
    """
    data = content.encode() if isinstance(content, str) else content
    with replacing(path) as draft:
        draft.write_bytes(data)


def check_free(folder: Path) -> None:
    """Raise InvalidArgument where something is in a folder that is to be written as a whole."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InvalidArgument(f"{folder} exists already", "choose another folder, or remove that one")


@contextmanager
def replacing(path: Path, *, overwrite: bool = True) -> Iterator[Path]:
    """A draft, an empty file to be written in the block, that becomes the file at its end; an exception removes it.

    The draft is locked while the block runs. Whoever replaces this file next removes drafts that nobody holds: a kill
    left them.

    Raises:
        FileExistsError: there is such a file, and it is not to be overwritten.
        OSError: the file cannot be written; its `filename` is the path.
    """
    target = Path(os.path.realpath(path))  # of links in a circle the path itself: opening that is an error
    drafts = _prefix(target)
    try:
        if _is_special(path):
            yield path
            return
        if path.exists() and not overwrite:
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
        target.parent.mkdir(parents=True, exist_ok=True)
        with _draft(target) as (draft, descriptor):
            yield draft
            os.fsync(descriptor)
            if overwrite:
                os.replace(draft, target)
            else:
                os.link(draft, target)  # unlike a renaming, this fails where somebody else was faster
        with suppress(OSError):  # Windows, and some file systems, cannot do that
            directory = os.open(target.parent, os.O_RDONLY)
            with suppress(OSError):
                os.fsync(directory)
            os.close(directory)
    except OSError as error:
        if error.filename is None or Path(os.fspath(error.filename)).name.startswith(drafts):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def _is_special(path: Path) -> bool:
    """Whether something is written to and not replaced: a device, a pipe; also what a link of `/dev/fd` leads to."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return False
    if stat.S_ISREG(mode) and not os.access(path, os.W_OK):  # renaming would not ask
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    return not stat.S_ISREG(mode)


def _prefix(target: Path) -> str:
    """Return how the names of drafts of a file begin."""
    return f".{target.name}.draft-"


@contextmanager
def _draft(target: Path) -> Iterator[tuple[Path, int]]:
    """A new locked file beside the target, and its descriptor; removed at the end if it is still there."""
    prefix = _prefix(target)
    _remove_stale(target.parent, re.compile(re.escape(prefix) + "[0-9a-f]{8}"))
    draft = target.with_name(prefix + os.urandom(4).hex())
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        with suppress(OSError):
            lock_file(descriptor)
        with suppress(FileNotFoundError):
            os.chmod(draft, stat.S_IMODE(target.stat().st_mode))
        yield draft, descriptor
    finally:
        os.close(descriptor)
        draft.unlink(missing_ok=True)


def _remove_stale(directory: Path, drafts: re.Pattern[str]) -> None:
    for name in os.listdir(directory):
        if drafts.fullmatch(name):
            with suppress(OSError), open(directory / name, "rb") as file:
                lock_file(file.fileno())
                os.unlink(directory / name)


def lock_file(descriptor: int) -> None:
    """Lock a file; BlockingIOError if somebody else holds it, and on Windows, where the drafts of a crash stay."""
    if sys.platform == "win32":
        raise BlockingIOError
    import fcntl

    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
