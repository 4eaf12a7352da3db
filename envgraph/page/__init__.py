"""Show a domain or a run on a page in the browser: edit its texts, see its models, apply its rules, play its levels."""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.page._page_session import PageSession as PageSession

export_lazily(globals())
