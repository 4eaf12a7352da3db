"""The cache: files that can be computed again, kept from one process to the next.

This module imports nothing of envgraph, since exported packages have a copy of it.
"""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

CACHE_VARIABLE = "ENVGRAPH_CACHE"
"""Environment variable: another directory than the one in the user's home, or "off" to keep nothing."""


def cache_directory() -> Path | None:
    """Return the directory of the cache, which need not exist; None if there is to be none.

    It is `$ENVGRAPH_CACHE`, else `envgraph` in `$XDG_CACHE_HOME`, else `envgraph` in `.cache` of the user's home. There
    is none if `$ENVGRAPH_CACHE` is "off", or if the user has no home.
    """
    named = os.environ.get(CACHE_VARIABLE, "")
    if named:
        return None if named == "off" else Path(named)
    base = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    return base / "envgraph" if base.is_absolute() else None


def read_cached(path: Path, key: str) -> bytes | None:
    """Return what `write_cached` wrote to a file for a key; None if another user wrote it, or it was changed since.

    Never waits and never raises OSError: a missing file, and a pipe or a link in its place, give None as well.

    Args:
        path: the file.
        key: everything that the content depends on.
    """
    flags = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0)
    try:
        with open(path, "rb", opener=lambda name, mode: os.open(name, mode | flags)) as file:
            if not is_own(os.fstat(file.fileno())):
                return None
            checksum, content = file.read(32), file.read()
    except (OSError, ValueError):
        return None
    return content if checksum == _checksum(key, content) else None


def write_cached(path: Path, key: str, content: bytes) -> None:
    """Write a file that this user alone can read; do nothing if it cannot be written.

    A missing directory is created for this user alone.

    Args:
        path: the file.
        key: everything that the content depends on.
        content: what `read_cached` is to return for the key.
    """
    draft = path.with_name(f".{path.name}.{os.urandom(4).hex()}")
    with suppress(OSError, ValueError):
        path.parent.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        path.parent.mkdir(mode=0o700, exist_ok=True)
        try:
            with open(draft, "xb", opener=lambda name, mode: os.open(name, mode, 0o600)) as file:
                file.write(_checksum(key, content) + content)
            os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)


def is_own(found: os.stat_result) -> bool:
    """Return True for a regular file of this user that no other user can write; Windows has no such bits."""
    if os.name == "posix" and (found.st_uid != os.geteuid() or found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)):
        return False
    return stat.S_ISREG(found.st_mode)


def _checksum(key: str, content: bytes) -> bytes:
    return sha256(sha256(key.encode()).digest() + content).digest()
