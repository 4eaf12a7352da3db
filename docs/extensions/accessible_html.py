"""Change HTML that Sphinx and the theme write and that screen readers cannot use."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_SIGNATURE_LINES = re.compile(r"<dl>\n((?:<dd>.*</dd>\n)+)</dl>")


def accessible(html: str) -> str:
    """Return HTML in which captions have a level, and lines of signatures are no list of descriptions."""
    html = html.replace('role="heading">', 'role="heading" aria-level="2">')
    return _SIGNATURE_LINES.sub(lambda found: f'<div class="sig-lines">\n{_lines(found[1])}</div>', html)


def _lines(html: str) -> str:
    return html.replace("<dd>", "<div>").replace("</dd>", "</div>")


def _change_page(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    for part in ("body", "furo_navigation_tree"):
        if part in context:
            context[part] = accessible(context[part])


def setup(app: Sphinx) -> dict[str, bool]:
    """Change each page after the theme has made its parts."""
    app.connect("html-page-context", _change_page, priority=900)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
