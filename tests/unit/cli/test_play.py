"""`envgraph play`: by lines of standard input, by keys of a terminal, and by policies."""

from __future__ import annotations

import io
import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest

from envgraph.cli import main
from envgraph.env import TooManyStates
from envgraph.lang import data_path
from envgraph.search import Family, generate

SHORTEST = ["ArrowRight", "ArrowDown", "take", "ArrowDown", "open(east)", *["ArrowRight"] * 3, "ArrowUp"]
"""The shortest plan of the bundled KeyDoor, by keys and by names of actions."""


def play(monkeypatch: pytest.MonkeyPatch, *arguments: str, lines: str = "") -> int:
    monkeypatch.setattr(sys, "argv", ["envgraph", "play", *arguments])
    monkeypatch.setattr(sys, "stdin", io.StringIO(lines))
    return main()


def test_lines_are_keys_actions_and_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = ["ArrowDown", "undo", "u", *SHORTEST[:3], "r", *SHORTEST]
    film = tmp_path / "film.svg"
    assert play(monkeypatch, "keydoor", "--record", str(film), lines="\n".join(lines)) == 0
    first, *states = capsys.readouterr().out.split("\n\n")
    assert first.startswith("keys: ArrowLeft go(west), ") and first.endswith("; u undo, r restart, q quit")
    assert len(states) == len(lines) + 1
    begin = "\n0 steps, total 0\nE1 of KeyDoorTeaching\nallowed: ArrowDown go(south), ArrowRight go(east)"
    assert states[0].endswith(begin) and states[2].endswith(begin.replace("\nE1 of KeyDoorTeaching", ""))
    assert "this is the first state" in states[3] and "3 steps, take" in states[6] and "0 steps" in states[7]
    reason = (
        "9 steps, go(north), reward 0.99, total 1.01, success by `on find atExit(hero) reward 1.0 terminate success`"
    )
    assert states[-1].splitlines()[-3:] == [reason, f"E1 of KeyDoorTeaching: {reason}", f"wrote {film}"]
    root = ElementTree.fromstring(film.read_text("utf-8"))
    assert root.get("aria-label", "").endswith(": 9 steps, success, total 1.01")


def test_recording_is_kept_when_the_terminal_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class ClosedLater(io.StringIO):
        def readline(self, size: int = -1) -> str:
            line = super().readline(size)
            if not line:
                os.kill(os.getpid(), signal.SIGHUP)
            return line

    film = tmp_path / "film.json"
    monkeypatch.setattr(sys, "argv", ["envgraph", "play", "keydoor", "--record", str(film)])
    monkeypatch.setattr(sys, "stdin", ClosedLater("ArrowRight\n"))
    assert main() == 128 + signal.SIGHUP
    assert capsys.readouterr().err == "terminated\n" and len(json.loads(film.read_text("utf-8"))["steps"]) == 1


@pytest.mark.parametrize(
    ("arguments", "lines", "message"),
    [
        (
            ("keydoor",),
            "ArrowRight\nArrowRihgt\n",
            "line 2 of standard input: `ArrowRihgt` is not the key or the name of",
        ),
        (
            ("keydoor",),
            "\n".join([*SHORTEST, "a"]),
            "line 10 of standard input: the episode is over; undo the last step",
        ),
        (("kedoor",), "", "there is no run and no domain `kedoor`; did you mean `keydoor`?"),
        (("keydoor", "E2"), "", "there is no run `keydoor` in runs"),
        (("keydoor", "no.model"), "", "no.model"),
        (("railway",), "", "railway"),
        (("keydoor", "--delay", "1"), "", "`--delay` needs `--policy`"),
        (("keydoor", "--delay", "-1", "--policy", "best"), "", "a number of seconds from 0 to 3600"),
        (("keydoor", "--record", "/dev/null/film.svg"), "ArrowRihgt", "error: /dev/null/film.svg: not a directory"),
        (("keydoor", "--record", "film.png"), "", "`film.png` is no recording: choose a file name that ends in .svg"),
    ],
)
def test_mistakes_are_told(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    arguments: tuple[str, ...],
    lines: str,
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert play(monkeypatch, *arguments, lines=lines) == 1
    assert message in capsys.readouterr().err.replace("\n", " ")


def test_best_policy_needs_as_many_steps_as_a_shortest_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "episode.json"
    assert play(monkeypatch, "keydoor", "--policy", "best", "--delay", "0", "--record", str(file)) == 0
    data = json.loads(file.read_text("utf-8"))
    assert (data["end"], len(data["steps"])) == ("success", len(SHORTEST))
    assert play(monkeypatch, "keydoor", "--policy", "best", "--record", str(file), lines="\n\npolicy\nu\n") == 0
    assert json.loads(file.read_text("utf-8"))["steps"] == data["steps"][:2]
    capsys.readouterr()
    assert play(monkeypatch, "triage", "--policy", "best", "--delay", "0") == 0
    printed = capsys.readouterr().out
    assert (
        "\nE1 of TriageTeaching; shortest plan: 7, random walk in the family, 60 steps: 0.521, optimal return: "
        in printed
    )
    assert ", success by `on neg find inHouse(_)" in printed.splitlines()[-1]


def test_a_level_with_too_many_states_has_no_best_policy(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(family: Family, _: object) -> None:
        raise TooManyStates(family.behaviour, 9)

    monkeypatch.setattr("envgraph.search.Family.explored", refuse)
    assert play(monkeypatch, "keydoor", "--policy", "best") == 1
    assert "has more than 9 states; use `--policy random`, or" in capsys.readouterr().err.replace("\n", " ")


def test_random_policy_and_agents_repeat_with_the_seed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = []
    for seed in ("1", "1", "2"):
        assert play(monkeypatch, "triage", "--policy", "random", "--delay", "0", "--seed", seed) == 0
        found.append(capsys.readouterr().out)
    assert found[0] == found[1] != found[2]
    assert play(monkeypatch, "warehouse", lines="ArrowDown\nArrowLeft\n") == 0
    states = [line for line in capsys.readouterr().out.splitlines() if line.endswith(" acts")]
    assert [line.rpartition(", ")[2] for line in states[:3]] == ["left acts", "right acts", "left acts"]


def test_members_of_a_run_are_played_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    generate(
        "burning_forest/paper.toml", tmp_path / "runs" / "forest" / "run.sqlite", overrides=["search.generations=1"]
    )
    assert play(monkeypatch, "forest", "E2", lines="n\n") == 0
    out = capsys.readouterr().out
    assert "\nE2 of " in out and out.splitlines()[-1].startswith("E3 of ")
    assert play(monkeypatch, "forest", "E99") == 1
    files = data_path("rules") / "burning_forest"
    environment, model = str(files / "burning_forest.environment"), str(files / "running_4x4.model")
    for given in (("burning_forest", "running_4x4.model"), (environment, model)):
        assert play(monkeypatch, *given) == 0
        assert "0 steps, total 0" in capsys.readouterr().out
    assert play(monkeypatch, environment) == 1
    assert "needs a model to play" in capsys.readouterr().err


class Terminal:
    """A program that runs in a pseudo-terminal."""

    def __init__(self, *arguments: str) -> None:
        self.master, self.slave = pty.openpty()
        self.modes = termios.tcgetattr(self.slave)
        environment = {
            **os.environ,
            "TERM": "xterm-256color",
            "COLORTERM": "truecolor",
            "COLUMNS": "100",
            "LINES": "40",
        }
        command = [sys.executable, "-m", "envgraph", "play", *arguments]
        self.process = subprocess.Popen(
            command, stdin=self.slave, stdout=self.slave, stderr=self.slave, env=environment, start_new_session=True
        )
        self.seen = ""

    def wait_for(self, text: str) -> str:
        """Read until a text is printed; return what was printed before it since the last call, and the text."""
        end = time.monotonic() + 60
        while text not in self.seen:
            assert time.monotonic() < end and select.select([self.master], [], [], 60)[0], self.seen
            self.seen += os.read(self.master, 65536).decode()
        found, _, self.seen = self.seen.partition(text)
        return found + text

    def press(self, keys: str) -> None:
        os.write(self.master, keys.encode())


@pytest.fixture
def terminals() -> Iterator[list[Terminal]]:
    opened: list[Terminal] = []
    yield opened
    for one in opened:
        one.process.kill()
        one.process.wait()
        os.close(one.master)
        os.close(one.slave)


@pytest.mark.parametrize("leave", ["q", signal.SIGINT])
def test_terminal_gives_single_keys_and_is_restored(terminals: list[Terminal], leave: str | signal.Signals) -> None:
    terminal = Terminal("keydoor")
    terminals.append(terminal)
    shown = terminal.wait_for("E1 of KeyDoorTeaching")
    assert "\x1b[?1049h" in shown and "48;2;47;158;68m" in shown, "the picture has the colour of the exit"
    assert termios.tcgetattr(terminal.slave)[3] & (termios.ICANON | termios.ECHO) == 0
    if leave == "q":
        terminal.press("\x1b[C")
        shown = terminal.wait_for("E1 of KeyDoorTeaching")
        assert "1 step, go(east), reward -0.01, total -0.01" in shown
        plain = re.sub(r"\x1b\[[0-9;]*m", "", shown)
        assert "ArrowLeft go(west)   ArrowDown go(south)   ArrowRight go(east)" in plain
        terminal.press("z")
        assert "`z` is not the key or the name of an action or command" in terminal.wait_for("restart, quit")
        terminal.press("\x1bOB\r")
        terminal.wait_for("3 steps, take")
        terminal.press("\x7fu")
        terminal.wait_for("1 step, go(east)")
        terminal.wait_for("q quit")
    if isinstance(leave, str):
        terminal.press(leave)
    else:
        terminal.process.send_signal(leave)
    terminal.wait_for("\x1b[?25h\x1b[?1049l")
    assert terminal.process.wait(30) == (0 if isinstance(leave, str) else 128 + leave)
    assert termios.tcgetattr(terminal.slave) == terminal.modes
