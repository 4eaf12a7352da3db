"""Execute the notebooks of `docs/notebooks` while the site is built, show what their cells show, and offer the files.

A notebook is a page in Markdown; each of its cells is a block with the fence ```{code-cell}. A cell that fails stops
the build. The page begins with a link to the notebook as an `.ipynb` file without outputs.
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterator
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError
from traitlets.config import Config

if TYPE_CHECKING:
    from sphinx.application import Sphinx

FOLDER: Final = "notebooks/"
SECONDS: Final = 120
"""Time after which a cell has failed."""

_CELL = re.compile(r"^```\{code-cell\}\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
_LINK_IN_SITE = re.compile(r"\[([^]]+)\]\((?!https?:)[^)]*\)")
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")


class NotebookError(Exception):
    """An error raised if a cell of a notebook fails or writes to standard error."""


def parse_notebook(text: str) -> Any:
    """Return a page as a notebook without outputs. Links to pages of the site become plain text."""
    cells = []
    for place, part in enumerate(_CELL.split(text)):
        if place % 2:
            cells.append(nbformat.v4.new_code_cell(part.rstrip("\n"), id=f"cell-{place}"))
        elif part.strip():
            cells.append(nbformat.v4.new_markdown_cell(_LINK_IN_SITE.sub(r"\1", part.strip()), id=f"text-{place}"))
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return nbformat.v4.new_notebook(cells=cells, metadata={"kernelspec": kernel})


def execute_notebook(notebook: Any) -> None:
    """Execute a notebook in an empty folder, and add the outputs to its cells.

    Raises:
        NotebookError: a cell fails or writes to standard error.
    """
    with TemporaryDirectory() as folder:
        # Sockets in the folder: other users of the machine could read those of TCP.
        config = Config(KernelManager={"transport": "ipc", "ip": f"{folder}/.kernel"})
        place = {"metadata": {"path": folder}}
        client = NotebookClient(notebook, kernel_name="python3", timeout=SECONDS, resources=place, config=config)
        client.log.setLevel(logging.WARNING)  # no line for each notebook
        try:
            client.execute(
                env={**os.environ, "IPYTHONDIR": f"{folder}/.ipython", "PYDEVD_DISABLE_FILE_VALIDATION": "1"}
            )
        except CellExecutionError as error:
            raise NotebookError(_COLOUR.sub("", str(error))) from None
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            if output.get("name") == "stderr":
                raise NotebookError(f"{cell.source}\nwrites to standard error:\n{output.text}")


def page_text(text: str, notebook: Any, name: str) -> str:
    """Return the Markdown of a page, with the outputs of an executed notebook below its cells."""
    executed = iter([cell for cell in notebook.cells if cell.cell_type == "code"])

    def shown(found: re.Match[str]) -> str:
        outputs = "\n".join(_output_html(next(executed)))
        block = f"```ipython3\n{found[1]}```\n"
        return f'{block}\n``````{{raw}} html\n<div class="cell-output">{outputs}</div>\n``````\n' if outputs else block

    title, _, rest = _CELL.sub(shown, text).partition("\n")
    link = f'<p><a href="{name}.ipynb" download>Download this page as a notebook</a></p>'
    return f"{title}\n\n```{{raw}} html\n{link}\n```\n{rest}"


def _output_html(cell: Any) -> Iterator[str]:
    """Yield the outputs of a cell as HTML."""
    for output in cell.outputs:
        data = {"text/plain": output.text} if output.output_type == "stream" else output.data
        html = data.get("text/html") or data.get("image/svg+xml") or f"<pre>{escape(data['text/plain'])}</pre>"
        yield f'<div role="region" aria-label="Output" tabindex="0">{html}</div>'


def _execute_page(app: Sphinx, page: str, source: list[str]) -> None:
    if page.startswith(FOLDER) and (notebook := parse_notebook(source[0])) and "{code-cell}" in source[0]:
        try:
            execute_notebook(notebook)
        except NotebookError as error:
            from sphinx.errors import SphinxError

            raise SphinxError(f"{page}.md: {error}") from None
        source[0] = page_text(source[0], notebook, page.removeprefix(FOLDER))


def _write_downloads(app: Sphinx, exception: Exception | None) -> None:
    if exception is None and app.builder.name == "html":
        for path in sorted((Path(app.srcdir) / FOLDER).glob("*.md")):
            text = path.read_text("utf-8")
            if "{code-cell}" in text:
                nbformat.write(parse_notebook(text), Path(app.outdir) / FOLDER / f"{path.stem}.ipynb")


def setup(app: Sphinx) -> dict[str, bool]:
    """Execute notebooks when they are read, and write the files to download before links are checked."""
    app.connect("source-read", _execute_page)
    app.connect("build-finished", _write_downloads, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
