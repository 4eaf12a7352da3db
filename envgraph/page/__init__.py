"""Show a domain or a run on a page in the browser: edit its texts, see its models, apply its rules, play its levels."""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.page._answers import error_object as error_object
    from envgraph.page._connection import Connection as Connection
    from envgraph.page._page_session import PageSession as PageSession
    from envgraph.page._play_session import PlaySession as PlaySession
    from envgraph.page._serve import serve as serve
    from envgraph.page._targets import Target as Target, find_target as find_target
    from envgraph.page._work import Work as Work

export_lazily(globals())
