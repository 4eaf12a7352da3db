"""Check the built pages: each link inside the site has a target, and no page loads files from other sites."""

from __future__ import annotations

from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_LOADED = {
    ("link", "href"),
    ("script", "src"),
    ("img", "src"),
    ("iframe", "src"),
    ("source", "src"),
    ("object", "data"),
}
_LINKS_TO_NOWHERE = {"#", ""}
_ADDED_LATER = "playground"
"""The folder that `.github/workflows/docs.yml` adds to the site; links into it are not checked."""


class _Page(HTMLParser):
    """Collects the anchors of a page, its links, and the addresses of what it loads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: set[str] = set()
        self.loaded: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Record the attributes of a tag."""
        values = {name: value for name, value in attrs if value is not None}
        self.anchors.update(values[name] for name in ("id", "name") if name in values)
        if tag == "a" and "href" in values:
            self.links.add(values["href"])
        # Addresses such as that of the canonical page are not loaded.
        if values.get("rel") not in ("canonical", "prev", "next", "author", "search", "index"):
            self.loaded.update(values[name] for loaded, name in _LOADED if loaded == tag and name in values)


def problems_of_site(folder: Path) -> Iterator[str]:
    """Yield the broken links inside a built site, and what its pages load from other sites."""
    pages = {path: _Page(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.html"))}
    for path, page in pages.items():
        name = path.relative_to(folder).as_posix()
        for address in sorted(page.loaded):
            if urlsplit(address).netloc:
                yield f"{name} loads {address} from another site"
        for address in sorted(page.links | page.loaded):
            parts = urlsplit(address)
            if parts.scheme or parts.netloc or address in _LINKS_TO_NOWHERE:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if target.is_relative_to(folder / _ADDED_LATER):
                continue
            if not target.exists():
                yield f"{name} links to {address}, which does not exist"
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
                yield f"{name} links to {address}, but the page has no such anchor"


def _check(app: Sphinx, exception: Exception | None) -> None:
    from sphinx.errors import SphinxError

    if exception is None and app.builder.name == "html":
        found = list(problems_of_site(Path(app.outdir).resolve()))
        if found:
            raise SphinxError("\n".join(found))


def setup(app: Sphinx) -> dict[str, bool]:
    """Check the site when it is built."""
    app.connect("build-finished", _check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
