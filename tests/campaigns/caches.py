"""Damaged, forged, foreign, read-only and full caches: a command prints the same, and nothing in the cache runs."""

from __future__ import annotations

import atexit
import os
import pickle
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random

from tests.campaigns.commands import good, run

_VERIFY = ("verify", "family.json")


@cache
def _kept() -> tuple[Path, str]:
    """A directory with a family, a cache that verifying it filled, and what that printed; tables are left out."""
    directory = Path(tempfile.mkdtemp(prefix="envgraph-caches-"))
    atexit.register(shutil.rmtree, directory, ignore_errors=True)
    good(run(directory, "generate", "burning_forest/paper.toml", "--generations", 1, "--name", "m"))
    good(run(directory, "export", "m", "-o", "family.json"))
    printed = good(run(directory, *_VERIFY, before=_use(directory)))
    for path in (directory / "cache").iterdir():
        if path.suffix:
            path.unlink()
    assert len(_files(directory)) >= 8, "no machine code is kept"
    return directory, printed


def _use(directory: Path) -> Callable[[], None]:
    """Name the cache below a directory to a process that begins."""
    return lambda: os.environ.__setitem__("ENVGRAPH_CACHE", str(directory / "cache"))


def _files(directory: Path) -> list[Path]:
    return sorted(path for path in (directory / "cache").rglob("*") if path.is_file())


@cache
def _mounts() -> bool:
    return os.system("unshare -m mount -t tmpfs -o size=1m none /mnt 2>/dev/null") == 0


def prepare() -> None:
    """Fill the cache that is damaged."""
    _kept()


def campaign(random: Random) -> str:
    """Damage a cache, or mount a small disk in its place, and run a command."""
    kept, printed = _kept()
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        shutil.copytree(kept, directory, dirs_exist_ok=True)
        kind = random.choice([*_DAMAGE, *(["full", "read-only"] if _mounts() else [])])
        wrapper: tuple[str, ...] = ()
        if kind in _DAMAGE:
            files = _files(directory)
            for path in random.sample(files, random.choice([1, 2, len(files)])):
                _DAMAGE[kind](random, path)
        else:
            size, place = random.choice([4, 40, 400, 1200]), directory / "cache"
            mount = f"mount -t tmpfs -o size={size}k none {place}"
            if kind == "read-only":
                mount = f"mount --bind {place} {place} && mount -o remount,ro,bind {place}"
            wrapper = ("unshare", "-m", "sh", "-c", f'{mount} && exec "$0" "$@"')
        done = run(directory, *_VERIFY, before=_use(directory), wrapper=wrapper)
        assert good(done) == printed, f"{kind}: {done.stdout}"
        assert not (directory / "cache" / "canary").exists(), f"{kind}: a file of the cache ran"
    return kind


class _Canary:
    """Creates a file beside the cache's when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> object:
        return Path.touch, (self.path,)


def _flip(random: Random, path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[random.randrange(len(content))] ^= 1 << random.randrange(8)
    path.write_bytes(content)


def _forge(random: Random, path: Path) -> None:
    cache = next(parent for parent in path.parents if parent.name == "cache")
    head = path.read_bytes()[: random.choice([0, 32])]
    path.write_bytes(head + pickle.dumps(_Canary(cache / "canary")))


def _replace(random: Random, path: Path) -> None:
    path.unlink()
    random.choice([Path.mkdir, os.mkfifo, lambda path: path.symlink_to("/dev/zero")])(path)


def _swap(random: Random, path: Path) -> None:
    shutil.copy(random.choice([one for one in sorted(path.parent.iterdir()) if one.is_file()]), f"{path}.copy")
    os.replace(f"{path}.copy", path)


_DAMAGE: dict[str, Callable[[Random, Path], object]] = {
    "flip": _flip,
    "cut": lambda random, path: os.truncate(path, random.randrange(path.stat().st_size)),
    "forged": _forge,
    "replaced": _replace,
    "swapped": _swap,
    "writable": lambda random, path: path.chmod(0o666),
    "foreign": lambda random, path: os.chown(path, 12345, 12345) if os.geteuid() == 0 else path.chmod(0o666),
}
