"""Pipes, devices and directories in place of files: refused at once by every command, whatever they are called."""

from __future__ import annotations

import os
import shutil
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import pytest

from envgraph.cli import main
from envgraph.lang import bundled_domain

COMMANDS = {
    "check FILE": ("query", "xmi", "toml"),
    "format FILE": ("query",),
    "format --derived FILE": ("rules",),
    "match FILE forest/burning_forest.query burningTile": ("model", "xmi", "json"),
    "match forest/running_4x4.model FILE burningTile": ("query", "vql"),
    "match forest/running_4x4.model forest/burning_forest.query p -m FILE": ("ecore", "metamodel"),
    "apply FILE forest/burning_forest.rules spread": ("model",),
    "apply forest/running_4x4.model FILE spread": ("rules",),
    "replay forest/running_4x4.model forest/burning_forest.rules FILE": ("trace",),
    "convert FILE out.json -m forest/burning_forest.metamodel": ("json", "xmi", "model"),
    "convert FILE out.ecore": ("ecore",),
    "generate FILE": ("toml",),
    "show FILE": ("json", "model", "sqlite"),
    "export FILE": ("json", "sqlite"),
    "report FILE": ("json",),
    "train FILE": ("json",),
    "import FILE": ("txt",),
}


@pytest.fixture
def forest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The bundled domain; whoever waits for a pipe is stopped."""
    shutil.copytree(bundled_domain("burning_forest"), tmp_path / "forest")
    monkeypatch.chdir(tmp_path)

    def stop(number: int, frame: FrameType | None) -> None:
        raise AssertionError("somebody waits for the file")

    signal.signal(signal.SIGALRM, stop)
    signal.alarm(20)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)


def printed_output(command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    monkeypatch.setattr(sys, "argv", ["envgraph", *command.split()])
    try:
        code: object = main()
    except SystemExit as stop:
        code = stop.code
    assert code == 1
    return "".join(capsys.readouterr())


@pytest.mark.parametrize(
    ("command", "kind"), [(command, kind) for command, kinds in COMMANDS.items() for kind in kinds]
)
@pytest.mark.usefixtures("forest")
def test_a_pipe_is_refused(
    command: str, kind: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(f"pipe.{kind}")
    output = printed_output(command.replace("FILE", f"pipe.{kind}"), monkeypatch, capsys)
    wanted = f"there is no run `pipe.{kind}`" if kind == "sqlite" else "this is a pipe, not a file"
    assert wanted in output


@pytest.mark.usefixtures("forest")
def test_devices_are_refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    os.symlink("/dev/zero", "zero.query")
    for command in ("check zero.query", "match forest/running_4x4.model zero.query p", "import /dev/zero"):
        assert "this is a device, not a file" in printed_output(command, monkeypatch, capsys)


@pytest.mark.usefixtures("forest")
def test_directories_are_refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    for kind, command in (
        ("query", "match forest/running_4x4.model FILE p"),
        ("trace", "replay forest/running_4x4.model forest/burning_forest.rules FILE"),
    ):
        os.makedirs(f"one.{kind}", exist_ok=True)
        output = printed_output(command.replace("FILE", f"one.{kind}"), monkeypatch, capsys)
        assert "is a directory, not a" in output
