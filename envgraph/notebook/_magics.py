"""The magics of `%load_ext envgraph.notebook`: cells in envgraph's languages, checked together."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from IPython.core.error import UsageError

from envgraph.draw import html_text
from envgraph.errors import EnvgraphError, LoadError, has_errors
from envgraph.lang import LANGUAGES, Workspace
from envgraph.notebook._cell_texts import CellTexts

if TYPE_CHECKING:
    from IPython.core.interactiveshell import InteractiveShell

ENDINGS: Final = {**{language: language for language in LANGUAGES}, "family": "toml"}
"""The ending of the file that a cell defines, by the name of its magic."""

USAGE: Final = "write `%envgraph`, `%envgraph save FOLDER` or `%envgraph forget NAME`"


class CellMagics:
    """The cell magics, and the line magic `%envgraph`, of one notebook."""

    def __init__(self, shell: InteractiveShell) -> None:
        """Register the magics in a shell."""
        self.texts = CellTexts()
        self._shell = shell
        for magic in ENDINGS:
            shell.magics_manager.register_function(self._cell_function(magic), "cell", magic)
        shell.magics_manager.register_function(self.envgraph, "line", "envgraph")

    def _cell_function(self, magic: str) -> Any:
        def define(line: str, cell: str) -> None:
            self.define(magic, line.strip(), cell)

        define.__doc__ = f"Check the text of a cell as a file of the language `{magic}`: `%%{magic} [NAME]`."
        return define

    def define(self, magic: str, name: str, text: str) -> None:
        """Check the text of a cell together with those of the other cells, and show what is wrong.

        Raises:
            UsageError: the name has other characters than letters, digits, `_` and `-`.
            LoadError: the text has errors.
        """
        if not re.fullmatch(r"[\w-]*", name):
            raise UsageError(f"`{name}` cannot name a text: write letters, digits, `_` and `-`, or no name")
        file = f"{name or ('family' if magic == 'family' else 'notebook')}.{ENDINGS[magic]}"
        own, others = self.texts.put(file, text)
        if has_errors(own):
            raise LoadError(own)
        title = f"{file} has no errors" if own else f"{file} has no problems"
        later = ["these cells have errors now; correct them, and run them again:", *map(str, others)] if others else []
        self._show("\n\n".join([title, *map(str, own), *later]))

    def _show(self, text: str) -> None:
        self._shell.display_pub.publish({"text/plain": text, "text/html": html_text(text)})

    def envgraph(self, line: str) -> Workspace | None:
        """Return the content of all cells; `save FOLDER` writes them as files, `forget NAME` removes one.

        Raises:
            UsageError: there is no such command, or it failed.
        """
        try:
            match shlex.split(line):
                case []:
                    return self.texts.workspace()
                case ["save", folder]:
                    paths = self.texts.save(Path(folder).expanduser())
                    self._show("\n".join(f"wrote {path}" for path in paths) or "there is no cell to write")
                case ["forget", name]:
                    self.texts.forget(name)
                case _:
                    raise UsageError(f"`%envgraph {line}` does not exist: {USAGE}")
        except (EnvgraphError, OSError, ValueError) as error:
            raise UsageError(str(error)) from None
        return None


def load_ipython_extension(shell: InteractiveShell) -> None:
    """Register the magics, and show environments of `envgraph.make`, for `%load_ext envgraph.notebook`."""
    CellMagics(shell)
    if shell.display_formatter is not None:
        html = shell.display_formatter.formatters["text/html"]
        html.for_type_by_name("gymnasium.core", "Wrapper", _wrapper_html)


def _wrapper_html(environment: Any) -> str | None:
    """Return the HTML of the environment inside a wrapper of Gymnasium, such as a time limit; None if it has none."""
    show = getattr(environment.unwrapped, "_repr_html_", None)
    return None if show is None else str(show())
