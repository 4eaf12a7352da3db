"""A file of the cache is believed only if this user wrote it and nothing changed since."""

from __future__ import annotations

import os
import resource
import shutil
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from envgraph.files import cache_directory, read_cached, write_cached

KEY, CONTENT = "key", b"content" * 100


def edit(change: Callable[[bytes], bytes]) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(change(path.read_bytes()))


def replace_by_link(path: Path) -> None:
    shutil.copy(path, path.with_name("other"))
    path.unlink()
    path.symlink_to(path.with_name("other"))


def replace_by(make: Callable[[Path], object]) -> Callable[[Path], object]:
    return lambda path: (path.unlink(), make(path))


DAMAGE: dict[str, Callable[[Path], object]] = {
    "removed": Path.unlink,
    "emptied": edit(lambda content: b""),
    "checksum cut": edit(lambda content: content[:20]),
    "content cut": edit(lambda content: content[:-1]),
    "longer": edit(lambda content: content + b"\0"),
    "one bit": edit(lambda content: content[:-1] + bytes([content[-1] ^ 1])),
    "no checksum": edit(lambda content: CONTENT),
    "directory": replace_by(Path.mkdir),
    "pipe": replace_by(os.mkfifo),
    "device": replace_by(lambda path: path.symlink_to("/dev/zero")),
    "link": replace_by_link,
    "group may write": lambda path: path.chmod(0o620),
    "all may write": lambda path: path.chmod(0o602),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=[*DAMAGE])
def test_damaged_file_is_not_read(tmp_path: Path, damage: Callable[[Path], object]) -> None:
    path = tmp_path / "cache" / "file"
    write_cached(path, KEY, CONTENT)
    assert read_cached(path, KEY) == CONTENT
    damage(path)
    assert read_cached(path, KEY) is None


def test_file_of_another_key_is_not_read(tmp_path: Path) -> None:
    write_cached(tmp_path / "a", KEY, CONTENT)
    assert read_cached(tmp_path / "a", "other") is None


def test_file_of_another_user_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_cached(tmp_path / "a", KEY, CONTENT)
    me = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: me + 1)
    assert read_cached(tmp_path / "a", KEY) is None


def test_cache_files_are_readable_only_by_their_user(tmp_path: Path) -> None:
    path = tmp_path / "cache" / "programs" / "file"
    write_cached(path, KEY, CONTENT)
    found = [stat.S_IMODE(one.stat().st_mode) for one in (path, path.parent, path.parent.parent)]
    assert found == [0o600, 0o700, 0o700]


@pytest.mark.parametrize("name", ["file/cache/a", "full/a"])
def test_file_that_cannot_be_written_leaves_nothing(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(CONTENT) // 2, hard))  # as a full disk, which ends a write early
    try:
        write_cached(tmp_path / name, KEY, CONTENT)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [tmp_path / "file"]


def test_user_without_home_has_no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ENVGRAPH_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.delenv("HOME")
    monkeypatch.setattr(os, "getuid", lambda: 4_000_000_000)
    assert cache_directory() is None
