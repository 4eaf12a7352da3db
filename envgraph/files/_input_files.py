"""Open input files, but not pipes or devices."""

from __future__ import annotations

import errno
import os
import stat
from typing import BinaryIO

_SPECIAL_KINDS = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def open_input(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a file that a user named, for reading bytes. All such files must be opened with this function.

    Raises:
        OSError: the file does not exist, or is a directory, a pipe (which may never end) or a device.
        ValueError: the path is not a valid file name.
    """
    # Without O_NONBLOCK, opening a pipe would wait until another process opens its other end.
    file = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    kind = stat.S_IFMT(os.fstat(file).st_mode)
    if kind != stat.S_IFREG:
        os.close(file)
        if kind == stat.S_IFDIR:
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
        message = f"this is {_SPECIAL_KINDS.get(kind, 'a special file')}, not a file"
        raise OSError(errno.EINVAL, message, os.fspath(path))
    return os.fdopen(file, "rb")
