"""Full and read-only disks: an error that names the file, nothing lost, and going on where it is possible."""

from __future__ import annotations

import os
import shutil
import tempfile
from functools import cache
from pathlib import Path
from random import Random

from tests.campaigns.commands import good, run

_WRITING: tuple[tuple[object, ...], ...] = (
    ("generate", "burning_forest/paper.toml", "--generations", 30, "--name", "new"),
    ("export", "m", "-o", "family.json"),
    ("report", "m", "-o", "page.html"),
    ("train", "m", "--steps", "100", "--seeds", "1", "--curricula", "full"),
    ("new", "maze"),
    ("format", "street.query"),
)
_READING: tuple[tuple[object, ...], ...] = (
    ("show", "m"), ("export", "m"), ("report", "m", "-o", "/dev/null"), ("check", "burning_forest"),
)  # fmt: skip
_QUERY = "pattern lit(lamp:int){lamp==1;}\n" * 200


@cache
def _mounts() -> bool:
    return os.system("unshare -m mount -t tmpfs -o size=1m none /mnt 2>/dev/null") == 0


def prepare() -> None:
    """See whether disks can be mounted here."""
    if not _mounts():
        print("disks: nothing can be mounted here, so this campaign tries nothing")


def campaign(random: Random) -> str:
    """Fill a small disk, or make one read-only, and run a command on it."""
    if not _mounts():
        return "left out, since nothing can be mounted here"
    with tempfile.TemporaryDirectory() as name:
        disk = Path(name)
        (disk / "street.query").write_text(_QUERY)
        good(run(disk, "generate", "burning_forest/paper.toml", "--generations", 3, "--name", "m"))
        before = {path: path.read_bytes() for path in _files(disk)}
        full = random.random() < 0.6
        size = sum(map(len, before.values())) // 1024 + random.choice([4, 16, 64, 256])
        copy = Path(f"{name}.copy")
        shutil.copytree(disk, copy)
        try:
            inside = f"mount -t tmpfs -o size={size + 64}k none {disk} && cp -r {copy}/. {disk} && cd {disk} && "
            if full:
                left = random.choice([0, 4, 20])
                inside += f"(head -c {size + 64}k /dev/zero > filler; truncate -s -{left}k filler) 2>/dev/null; "
            else:
                inside += f"mount -o remount,ro {disk} && "
            command = random.choice(_WRITING if full else (*_READING, *_WRITING))
            saved = f"; code=$?; rm -rf {copy}/*; cp -r {disk}/. {copy}; exit $code"
            wrapper = ("unshare", "-m", "sh", "-c", inside + '"$0" "$@"' + saved)
            done = run(disk, *command, wrapper=wrapper)
            assert done.returncode in (0, 1), f"{command}: {done.returncode} {done.stderr[-500:]}"
            if not full and command in _READING:
                good(done)
            if not full and command in _WRITING:
                assert done.returncode == 1, f"{command} on a read-only disk"
            if done.returncode:
                after = {disk / path.relative_to(copy): path.read_bytes() for path in _files(copy)}
                lost = [str(path) for path, data in before.items() if after.get(path) != data]
                assert not lost, f"{command} changed {lost}"
        finally:
            shutil.rmtree(copy, ignore_errors=True)
    return "full" if full else "read-only"


def _files(directory: Path) -> list[Path]:
    """All files but the logs of a store."""
    files = (path for path in directory.rglob("*") if path.is_file())
    return sorted(path for path in files if not path.name.endswith(("-wal", "-shm")))
