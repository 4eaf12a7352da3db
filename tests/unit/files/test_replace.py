"""Files are replaced whole: whatever happens, the old content or the new one is there, and nothing beside it."""

import ast
import os
import re
import signal
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from envgraph.files import check_replaceable, replace_file, replacement_draft

PACKAGE = Path(__file__).parents[3] / "envgraph"


def entries(directory: Path) -> list[str]:
    return sorted(os.listdir(directory))


def test_text_is_written_as_utf_8_with_its_own_line_ends(tmp_path: Path) -> None:
    replace_file(tmp_path / "deep" / "a.txt", "ä\r\nb\n")
    assert (tmp_path / "deep" / "a.txt").read_bytes() == "ä\r\nb\n".encode()
    assert entries(tmp_path / "deep") == ["a.txt"]


def test_a_check_before_writing_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    check_replaceable(path)
    check_replaceable(tmp_path / "b.txt")
    check_replaceable(Path("/dev/null"))
    assert path.read_text() == "old" and entries(tmp_path) == ["a.txt"]
    for wrong in (tmp_path, path / "c.txt"):
        with pytest.raises(OSError, match=re.escape(str(wrong))):
            check_replaceable(wrong)


def test_an_exception_leaves_the_old_content(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), replacement_draft(path) as draft:
        draft.write_text("half")
        assert path.read_text() == "old"
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert entries(tmp_path) == ["a.txt"]


def test_a_full_disk_leaves_the_old_content_and_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    code = (
        "import resource, sys; from pathlib import Path; from envgraph.files import replace_file\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "try: replace_file(Path(sys.argv[1]), 'x' * 5000)\n"
        "except OSError as error: print(error.filename, error.strerror)"
    )
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=True)
    assert done.stdout == f"{path} File too large\n"
    assert path.read_text() == "old"
    assert entries(tmp_path) == ["a.txt"]


def test_a_draft_of_a_killed_process_is_removed_by_the_next_writer(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    code = (
        "import sys; from pathlib import Path; from envgraph.files import replacement_draft\n"
        "with replacement_draft(Path(sys.argv[1])) as draft:\n"
        "    draft.write_text('half'); print(flush=True); sys.stdin.read()"
    )
    writer = subprocess.Popen([sys.executable, "-c", code, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert writer.stdout is not None and writer.stdin is not None
    writer.stdout.readline()
    replace_file(path, "second")  # the first one is still at it: its draft stays
    assert len(entries(tmp_path)) == 2
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    writer.stdin.close()
    writer.stdout.close()
    assert path.read_text() == "second"
    replace_file(path, "third")
    assert entries(tmp_path) == ["a.txt"]
    assert path.read_text() == "third"


@pytest.mark.parametrize("overwrite", [True, False])
def test_the_file_and_its_directory_are_synced_to_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, overwrite: bool
) -> None:
    synced: list[int] = []
    monkeypatch.setattr(os, "fsync", lambda file: synced.append(os.fstat(file).st_ino))
    with replacement_draft(tmp_path / "a.txt", overwrite=overwrite) as draft:
        draft.write_text("x")
        number = draft.stat().st_ino
    assert synced == [number, tmp_path.stat().st_ino]


def test_permissions_are_kept_and_new_files_get_the_default_permissions(tmp_path: Path) -> None:
    usual, script = tmp_path / "usual", tmp_path / "script"
    usual.write_text("")
    script.write_text("")
    script.chmod(0o750)
    replace_file(script, "x")
    replace_file(tmp_path / "new", "x")
    assert stat.S_IMODE(script.stat().st_mode) == 0o750
    assert (tmp_path / "new").stat().st_mode == usual.stat().st_mode


def test_a_symbolic_link_is_kept_and_its_target_replaced(tmp_path: Path) -> None:
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("real.txt")
    replace_file(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "real.txt").read_text() == "new"


def test_a_pipe_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    found: list[str] = []
    reader = threading.Thread(target=lambda: found.append(pipe.read_text()))
    reader.start()
    replace_file(pipe, "new")
    reader.join()
    assert found == ["new"]
    assert entries(tmp_path) == ["pipe"]
    with pytest.raises(OSError, match="'/dev/full'"):
        replace_file(Path("/dev/full"), "x")
    with pytest.raises(IsADirectoryError) as info:
        replace_file(tmp_path, "x")
    assert info.value.filename == str(tmp_path)


def test_an_existing_file_is_not_overwritten_without_overwrite(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with replacement_draft(path, overwrite=False) as draft:
        draft.write_text("mine")
    with pytest.raises(FileExistsError), replacement_draft(path, overwrite=False):
        pass
    other = tmp_path / "b.txt"
    with pytest.raises(FileExistsError) as info, replacement_draft(other, overwrite=False):
        other.write_text("of somebody faster")
    assert info.value.filename == str(other)
    assert other.read_text() == "of somebody faster"
    assert entries(tmp_path) == ["a.txt", "b.txt"]


def test_a_draft_that_cannot_be_created_is_an_error_with_the_name_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, flags: int, mode: int = 0) -> int:
        raise PermissionError(13, "Permission denied", path)

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(PermissionError) as info:
        replace_file(tmp_path / "a.txt", "x")
    assert info.value.filename == str(tmp_path / "a.txt")


@pytest.mark.parametrize("name", ["a.txt", "[a]*.txt", "ä b"])
def test_drafts_of_other_files_are_not_removed(tmp_path: Path, name: str) -> None:
    for other in (".other.draft-00000000", f".{name}.draft-0000000", f".{name}.draft-00000000x"):
        (tmp_path / other).write_text("")
    (tmp_path / f".{name}.draft-0123abcd").write_text("")
    replace_file(tmp_path / name, "x")
    assert len(entries(tmp_path)) == 4


def test_modules_write_files_only_as_drafts() -> None:
    calls = [
        (module, node)
        for module in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
    ]
    writing = [(module, ast.unparse(call)) for module, call in calls if overwrites_file(call)]
    assert len(writing) > 3
    strangers = [(module, call) for module, call in writing if "devnull" not in call and not call.startswith("draft.")]
    assert not strangers


def overwrites_file(call: ast.Call) -> bool:
    """Return True for a call that may destroy what was there, such as `p.write_text(..)` or `open(p, "w")`."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    modes = [arg.value for arg in call.args if isinstance(arg, ast.Constant)]
    return name in ("write_text", "write_bytes") or (
        name == "open" and any(re.fullmatch("wb?[+]?|rb?[+]", str(mode)) for mode in modes)
    )


def test_links_in_a_circle_are_an_error_that_names_the_file(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(OSError, match="a'") as caught:
        replace_file(tmp_path / "a", "text")
    assert caught.value.filename == str(tmp_path / "a")
