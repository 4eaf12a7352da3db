"""Opening a file to read from it."""

from __future__ import annotations

import errno
import os
import stat
from typing import BinaryIO

_SPECIAL = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def open_input(path: str | os.PathLike[str]) -> BinaryIO:
    """Opens a file to read from it; everything that reads what a person has named goes this way.

    Raises:
        OSError: there is no such file, or it is none: a directory, a pipe (which may never end), a device.
        ValueError: this cannot be the name of a file.
    """
    # Without O_NONBLOCK a pipe would be waited for: somebody has to open its other end.
    file = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    kind = stat.S_IFMT(os.fstat(file).st_mode)
    if kind != stat.S_IFREG:
        os.close(file)
        if kind == stat.S_IFDIR:
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(path))
        message = f"this is {_SPECIAL.get(kind, 'something else')}, not a file"
        raise OSError(errno.EINVAL, message, os.fspath(path))
    return os.fdopen(file, "rb")
