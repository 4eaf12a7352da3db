"""Replace a file as a whole: write a draft beside it, flush it to the disk, and rename it."""

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
    """Write a file as a whole: text as UTF-8, with unchanged line ends.

    Readers see either the old or the whole new content, even after a full disk, Ctrl-C, a kill or a power cut. Links
    and permissions are preserved, and missing directories are created. A pipe or a device, such as `/dev/stdout`, is
    written directly.

    Raises:
        OSError: the file cannot be written; its `filename` is the path.
    """
    data = content.encode() if isinstance(content, str) else content
    with replacement_draft(path) as draft:
        draft.write_bytes(data)


def check_replaceable(path: Path) -> None:
    """Raise OSError if `replace_file` could not write a file. Only missing directories are created."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))

    class Unchanged(Exception):
        pass

    with suppress(Unchanged), replacement_draft(path):
        raise Unchanged


def check_empty_folder(folder: Path) -> None:
    """Raise InvalidArgument unless the folder is empty or missing."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InvalidArgument(
            f"{folder} exists already and is not an empty folder", "choose another folder, or remove this one"
        )


@contextmanager
def replacement_draft(path: Path, *, overwrite: bool = True) -> Iterator[Path]:
    """Yield an empty draft file to write. It replaces the file after the block, but is deleted after an exception.

    For a pipe or a device the path itself is yielded. The draft is locked during the block. The next replacement of the
    same file deletes unlocked drafts, which killed processes have left.

    Raises:
        FileExistsError: the file exists, and `overwrite` is False.
        OSError: the file cannot be written; its `filename` is the path.
    """
    target = Path(os.path.realpath(path))  # for a circle of links the path itself, which cannot be opened
    drafts = _draft_prefix(target)
    try:
        if _is_special(path):
            yield path
            return
        if path.exists() and not overwrite:
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
        target.parent.mkdir(parents=True, exist_ok=True)
        with _locked_draft(target) as (draft, descriptor):
            yield draft
            os.fsync(descriptor)
            if overwrite:
                os.replace(draft, target)
            else:
                os.link(draft, target)  # unlike renaming, linking fails if the file exists meanwhile
        with suppress(OSError):  # Windows and some file systems cannot do this
            directory = os.open(target.parent, os.O_RDONLY)
            with suppress(OSError):
                os.fsync(directory)
            os.close(directory)
    except OSError as error:
        if error.filename is None or Path(os.fspath(error.filename)).name.startswith(drafts):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def _is_special(path: Path) -> bool:
    """Return True for an existing path that is not a regular file (a device or a pipe), which is written directly.

    Raises:
        PermissionError: the path is a regular file without write permission.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return False
    if stat.S_ISREG(mode) and not os.access(path, os.W_OK):  # renaming would ignore the missing permission
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    return not stat.S_ISREG(mode)


def _draft_prefix(target: Path) -> str:
    """Return the prefix of the names of all drafts of a file."""
    return f".{target.name}.draft-"


@contextmanager
def _locked_draft(target: Path) -> Iterator[tuple[Path, int]]:
    """Create a locked draft with the target's permissions beside it, and yield its path and descriptor.

    First delete unlocked drafts of the target. At the end delete the draft if it still exists.
    """
    prefix = _draft_prefix(target)
    _remove_stale_drafts(target.parent, re.compile(re.escape(prefix) + "[0-9a-f]{8}"))
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


def _remove_stale_drafts(directory: Path, drafts: re.Pattern[str]) -> None:
    for name in os.listdir(directory):
        if drafts.fullmatch(name):
            with suppress(OSError), open(directory / name, "rb") as file:
                lock_file(file.fileno())
                os.unlink(directory / name)


def lock_file(descriptor: int) -> None:
    """Lock an open file without waiting.

    Raises:
        BlockingIOError: another process holds the lock, or the system is Windows, where stale drafts therefore remain.
    """
    if sys.platform == "win32":
        raise BlockingIOError
    import fcntl

    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
