"""Work in notebooks: cells in envgraph's languages after `%load_ext envgraph.notebook`, and a widget to play with.

Results need nothing of this package: their `_repr_html_` shows them.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.notebook._magics import load_ipython_extension as load_ipython_extension
    from envgraph.notebook._play import play as play
    from envgraph.notebook._player import Player as Player

export_lazily(globals())
