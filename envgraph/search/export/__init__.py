"""Families as code and data of others: packages from templates, tables as arrays of NumPy.

`write_package` writes what a directory of Jinja2 templates says; `copy_templates` gives those that come with envgraph,
whose package needs Gymnasium and NumPy alone.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.search.export._package import (
        MINIGRID as MINIGRID,
        copy_templates as copy_templates,
        write_package as write_package,
    )
    from envgraph.search.export._tables import (
        write_frozen_lake as write_frozen_lake,
        write_tables as write_tables,
    )
    from envgraph.search.export._templates import Templates as Templates

later(globals())
