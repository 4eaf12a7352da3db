"""Locks: of two processes that want to write the same thing the second is refused."""

from __future__ import annotations

import logging
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from envgraph.errors import InvalidArgument, visible
from envgraph.files._replace import lock_file


@contextmanager
def write_lock(path: Path) -> Iterator[None]:
    """Lock a file, or a group of files with one name, for writing while the block runs; readers need no lock.

    The file `.NAME.lock` beside it is locked, and removed at the end of the block. It names the process and the host.
    The kernel unlocks it when the process dies; the next process that locks it logs a warning. Nothing is locked on
    Windows, and where no such file can be created, as on a read-only disk.

    Raises:
        InvalidArgument: another process, or another block of this one, has the lock.
    """
    lock = path.resolve().with_name(f".{path.resolve().name}.lock")
    descriptor = None if sys.platform == "win32" else _open_locked(lock, path)
    try:
        yield
    finally:
        if descriptor is not None:
            lock.unlink(missing_ok=True)
            os.close(descriptor)


def _open_locked(lock: Path, path: Path) -> int | None:
    """Return a descriptor of a lock file that this process has locked; None if there can be none."""
    if os.path.lexists(lock) and (lock.is_symlink() or not lock.is_file()):
        raise InvalidArgument(f"{lock} is not a file, and {path} cannot be locked", "remove it")
    try:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
    except OSError:
        return None
    known = visible(os.pread(descriptor, 300, 0).decode(errors="backslashreplace"))
    try:
        lock_file(descriptor)
    except OSError as error:
        os.close(descriptor)
        if not isinstance(error, BlockingIOError):  # a file system without locks
            return None
        hint = "wait for that process, or stop it; commands that only read work meanwhile"
        raise InvalidArgument(f"{known or 'another process'} is writing {path}", hint) from None
    if not os.fstat(descriptor).st_nlink:  # a process that ended just now has removed the file
        os.close(descriptor)
        return _open_locked(lock, path)
    if known:
        message = "%s died while it wrote %s; its lock is taken over"
        logging.getLogger("envgraph").warning(message, known, path)
    with suppress(OSError):  # on a full disk the lock names nobody
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"process {os.getpid()} on host {socket.gethostname()}".encode(), 0)
    return descriptor
