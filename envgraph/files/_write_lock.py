"""Lock files for writing. A second process that wants to write the same file gets an error."""

from __future__ import annotations

import logging
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from envgraph.errors import InvalidArgument, escape_unprintable
from envgraph.files._atomic_replace import lock_file


@contextmanager
def write_lock(path: Path) -> Iterator[None]:
    """Hold an exclusive write lock on a path during the block. The path may be the common name of several files.

    Readers need no lock.

    The lock is on the file `.NAME.lock` beside it, which names the process and the host and is removed after the block.
    If the process dies, the kernel releases the lock, and the next process that locks it logs a warning. Nothing is
    locked on Windows, or if no lock file can be created, as on a read-only disk.

    Raises:
        InvalidArgument: another process, or another block of this process, holds the lock.
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
    """Create or open a lock file, lock it, write this process into it, and return its descriptor; None if impossible.

    Log a warning if the file names a process that died. Raise `InvalidArgument` if the lock is held or `lock` is no
    file.
    """
    if os.path.lexists(lock) and (lock.is_symlink() or not lock.is_file()):
        raise InvalidArgument(f"{path} cannot be locked, because {lock} is not a file", f"remove {lock}")
    try:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
    except OSError:
        return None
    known = escape_unprintable(os.pread(descriptor, 300, 0).decode(errors="backslashreplace"))
    try:
        lock_file(descriptor)
    except OSError as error:
        os.close(descriptor)
        if not isinstance(error, BlockingIOError):  # a file system without locks
            return None
        hint = "wait for that process, or stop it; commands that only read still work"
        raise InvalidArgument(f"{known or 'another process'} is writing {path}", hint) from None
    if not os.fstat(descriptor).st_nlink:  # the process that held the lock has just removed the file
        os.close(descriptor)
        return _open_locked(lock, path)
    if known:
        message = "%s died while it wrote %s; this process locks the file now"
        logging.getLogger("envgraph").warning(message, known, path)
    with suppress(OSError):  # on a full disk the lock file stays empty
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"process {os.getpid()} on host {socket.gethostname()}".encode(), 0)
    return descriptor
