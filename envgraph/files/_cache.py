"""Cache files that can be computed again, shared by several processes.

This module imports nothing of envgraph, because exported packages contain a copy of it.
"""

from __future__ import annotations

import json
import os
import stat
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

CACHE_VARIABLE = "ENVGRAPH_CACHE"
"""Environment variable that names another cache directory, or "off" to cache nothing."""


def cache_directory() -> Path | None:
    """Return the cache directory, which may not exist yet; None if caching is off or the user has no home.

    The directory is `$ENVGRAPH_CACHE`, else `envgraph` in `$XDG_CACHE_HOME`, else `envgraph` in `.cache` of the user's
    home. Caching is off if `$ENVGRAPH_CACHE` is "off".
    """
    named = os.environ.get(CACHE_VARIABLE, "")
    if named:
        return None if named == "off" else Path(named)
    base = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    return base / "envgraph" if base.is_absolute() else None


def read_cached(path: Path, key: str) -> bytes | None:
    """Return the content that `write_cached` wrote to the file with the same key, or None.

    None is returned if the file is missing, is a pipe or a link, belongs to another user, or was changed since. This
    function never blocks and never raises OSError.

    Args:
        path: the file.
        key: everything that the content depends on.
    """
    flags = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0)
    try:
        with open(path, "rb", opener=lambda name, mode: os.open(name, mode | flags)) as file:
            if not is_private_file(os.fstat(file.fileno())):
                return None
            checksum, content = file.read(32), file.read()
    except (OSError, ValueError):
        return None
    return content if checksum == _checksum(key, content) else None


def write_cached(path: Path, key: str, content: bytes) -> None:
    """Write content to a cache file that only this user can read; do nothing if the file cannot be written.

    A missing directory is created, for this user only.

    Args:
        path: the file.
        key: everything that the content depends on.
        content: the bytes that `read_cached` will return for the same key.
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


def read_facts(key: str, kind: str) -> Any:
    """Return the JSON data that `write_facts` wrote to the user's cache; None without them or without a key."""
    folder = cache_directory()
    known = read_cached(folder / f"{key}.{kind}", key) if key and folder else None
    return None if known is None else json.loads(known)


def write_facts(key: str, kind: str, facts: object) -> None:
    """Write JSON data to the user's cache, with a checksum. Without a key, do nothing."""
    if key and (folder := cache_directory()):
        write_cached(folder / f"{key}.{kind}", key, json.dumps(facts).encode())


def is_private_file(found: os.stat_result) -> bool:
    """Return True for a regular file of this user that no other user can write.

    On Windows only the kind of file is checked.
    """
    if os.name == "posix" and (found.st_uid != os.geteuid() or found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)):
        return False
    return stat.S_ISREG(found.st_mode)


def _checksum(key: str, content: bytes) -> bytes:
    return sha256(sha256(key.encode()).digest() + content).digest()
