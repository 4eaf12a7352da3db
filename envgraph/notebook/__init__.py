"""Work in notebooks: write cells in the languages of envgraph, and play levels in a widget.

`%load_ext envgraph.notebook` adds the magics. Results need nothing of this package: their `_repr_html_` shows them.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.notebook._magics import load_ipython_extension as load_ipython_extension
    from envgraph.notebook._play import play as play
    from envgraph.notebook._player import Player as Player

export_lazily(globals())
