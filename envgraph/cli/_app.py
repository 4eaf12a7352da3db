"""The command line program: its group of commands, its error handling and its exit code."""

from __future__ import annotations

import io
import os
import signal
import sys
from types import FrameType
from typing import Any, Final, NoReturn

import click

from envgraph import __version__
from envgraph.cli._output import error_to_dict, print_error, write_json
from envgraph.errors import EnvgraphError

_INTERRUPTED: Final = 128 + signal.SIGINT


class _CommandGroup(click.Group):
    """The group of all commands, listed in the order of definition; the return value of a command is the exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands in the order of definition."""
        return list(self.commands)

    def add_command(self, cmd: click.Command, name: str | None = None) -> None:
        """Add a command; its first paragraph of help becomes its line in the list of commands."""
        cmd.short_help = (cmd.help or "").partition("\n\n")[0]
        super().add_command(cmd, name)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command and return its exit code; after Ctrl-C, return 130 (128 plus the number of the signal)."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            return _INTERRUPTED


@click.group(
    name="envgraph",
    cls=_CommandGroup,
    help="Graph rewriting in Python, and families of reinforcement-learning environments made with it.",
    epilog="Begin with `envgraph new my_domain`, or with `envgraph generate burning_forest`.",
    context_settings={"help_option_names": ["-h", "--help"], "show_default": True},
)
@click.version_option(__version__, message="envgraph %(version)s", help="Print the version and stop.")
def app() -> None:
    """Do nothing: the group only holds the commands."""


def main() -> int:
    """Run the program; return 0 for success, 1 or 2 for an error in the input or command line, 128 + n for signal n."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # Characters that the terminal cannot show are printed as escapes.
            stream.reconfigure(errors="backslashreplace")
    if sys.stdout is None or sys.stderr is None:  # The caller closed the stream: `envgraph show a >&-`.
        sys.stdout = sys.stdout or open(os.devnull, encoding="utf-8")  # noqa: SIM115, so that writing fails
        sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    try:
        code = _run_command()
        sys.stdout.flush()
        return code
    except OSError as error:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, Python flushes it at exit
        if not isinstance(error, BrokenPipeError):  # `envgraph .. | head` ended
            print_error(error)
        return 1


def _run_command() -> int:
    """Run the command and return its exit code; print errors of the input. Raise OSError if printing fails."""
    ended: list[int] = []
    formats: list[str] = []

    def end(number: int, frame: FrameType | None) -> NoReturn:
        ended.append(number)
        raise KeyboardInterrupt  # Save and print the same as for Ctrl-C.

    # SIGHUP: the terminal was closed. After `nohup` it is ignored.
    ends = [one for name in ("SIGTERM", "SIGHUP") if (one := getattr(signal, name, None)) is not None]
    usual = {one: signal.signal(one, end) for one in ends if signal.getsignal(one) is not signal.SIG_IGN}
    try:
        code = app.main(prog_name="envgraph", obj=formats, standalone_mode=False) or 0
    except (EnvgraphError, OSError) as error:
        if isinstance(error, OSError) and error.filename is None:
            raise
        if formats[-1:] == ["json"]:
            write_json(error_to_dict(error))
        else:
            print_error(error)
        return 1
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except click.Abort as abort:  # It was interrupted before the command began.
        if isinstance(abort.__cause__, EOFError):  # Click treats an EOFError as Ctrl-D at a prompt.
            raise abort.__cause__ from None
        code = _INTERRUPTED
    finally:
        for one, handler in usual.items():
            signal.signal(one, handler)
    if code == _INTERRUPTED:
        sys.stderr.write("terminated\n" if ended else "interrupted\n")
        return 128 + ended[0] if ended else _INTERRUPTED
    assert isinstance(code, int)
    return code
