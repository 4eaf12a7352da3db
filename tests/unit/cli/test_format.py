"""`envgraph format`."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from envgraph.cli import main

BEFORE = "pattern p(x:T){T( x );}\n"
AFTER = "pattern p(x : T) { T(x); }\n"

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Run:
    """Runs `envgraph format` in an empty directory: exit code, output, messages."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["envgraph", "format", *arguments])
        try:
            code = main()
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 0
        out, err = capfd.readouterr()
        assert "Traceback" not in out + err
        return code, out, err

    return run


def test_files_that_are_not_formatted_are_rewritten(run: Run) -> None:
    Path("a.query").write_text(BEFORE)
    Path("b.vql").write_text(AFTER)
    assert run("a.query", "b.vql") == (0, "formatted a.query\n", "")
    assert Path("a.query").read_text() == AFTER
    assert run("a.query", "b.vql") == (0, "nothing to format in 2 files\n", "")


def test_check_fails_for_unformatted_files_and_writes_nothing(run: Run) -> None:
    Path("a.query").write_text(BEFORE)
    assert run("--check", "a.query") == (1, "would format a.query\n", "")
    assert Path("a.query").read_text() == BEFORE
    Path("a.query").write_text(AFTER)
    assert run("--check", "a.query")[0] == 0


def test_files_with_errors_are_skipped_and_other_files_are_formatted(run: Run) -> None:
    Path("bad.query").write_text("pattern p(x:T{T( x );}\n")
    Path("good.query").write_text(BEFORE)
    code, out, err = run("bad.query", "good.query", "none.query", "notes.txt")
    assert code == 1
    assert out == "formatted good.query\n"
    assert "bad.query:1:14: " in err
    assert "none.query:1:1: there is no such file" in err
    assert Path("bad.query").read_text() == "pattern p(x:T{T( x );}\n"


def test_a_file_in_an_unknown_language_is_refused(run: Run) -> None:
    Path("notes.txt").write_text("hello")
    code, _, err = run("notes.txt")
    assert code == 1
    assert "`notes.txt` is not a file in a language of envgraph" in err


@pytest.mark.parametrize("option", [(), ("--check",)])
def test_family_files_are_skipped_with_a_warning(run: Run, option: tuple[str, ...]) -> None:
    Path("family.toml").write_text("a   =  1")
    Path("a.query").write_text(AFTER)
    code, out, err = run(*option, "a.query", "family.toml")
    assert (code, out) == (0, "")
    assert err.startswith("family.toml:1:1: warning: skipped: family files (TOML) are not formatted [not-formatted]")
    Path("a.query").write_text(BEFORE)
    assert run(*option, "family.toml", "a.query")[0] == len(option)
    assert Path("family.toml").read_text() == "a   =  1"


def test_files_of_a_directory_are_formatted(run: Run) -> None:
    Path("domain").mkdir()
    Path("domain/a.query").write_text(BEFORE)
    Path("domain/family.toml").write_text("a   =  1")
    assert run("domain") == (0, "formatted domain/a.query\n", "")
    Path("empty").mkdir()
    assert run("empty")[0] == 1


def test_stdout_option_does_not_change_the_file(run: Run) -> None:
    Path("a.query").write_text(BEFORE)
    assert run("--stdout", "a.query") == (0, AFTER, "")
    assert Path("a.query").read_text() == BEFORE


def test_standard_input_is_formatted(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def give(data: bytes) -> None:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))

    give(BEFORE.encode())
    assert run("-", "--language", "query") == (0, AFTER, "")
    give(BEFORE.encode())
    assert run("-", "--check", "--language", "query")[:2] == (1, "")
    give(b"pattern \xff")
    code, out, err = run("-", "--language", "query")
    assert (code, out) == (1, "") and "<stdin>:1:9: the byte 0xff is not UTF-8" in err
    assert "`-` needs `--language`" in run("-")[2]
    assert "unknown language `java`" in run("-", "--language", "java")[2]
    assert "cannot be combined with files" in run("-", "a.query", "--language", "query")[2]


def test_line_ends_are_kept(run: Run) -> None:
    Path("a.query").write_bytes(BEFORE.replace("\n", "\r\n").encode())
    assert run("a.query")[0] == 0
    assert Path("a.query").read_bytes() == AFTER.replace("\n", "\r\n").encode()


def test_derived_rules_are_printed(run: Run) -> None:
    Path("a.metamodel").write_text("metamodel a\nclass A { contains B[0..2] bs }\nclass B { bool on }\n")
    Path("a.query").write_text('import "a.metamodel"\n')
    Path("a.rules").write_text('import "a.query"\nderive all = operators for B;\n')
    code, out, err = run("--derived", "a.rules")
    assert (code, err) == (0, "")
    assert out.startswith("// --- rules of `all` ---\n\n")
    assert "rule all_set_B_on {\n    lhs { object : B; B.on(object, value); }\n" in out
    assert run("--derived", "a.query")[0] == 1


def test_a_new_domain_is_in_the_style(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["envgraph", "new", "maze"])
    with pytest.raises(SystemExit) as stop:
        raise SystemExit(main())
    assert stop.value.code == 0
    assert run("--check", "maze")[0] == 0
