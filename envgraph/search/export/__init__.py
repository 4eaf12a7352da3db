"""Export of families: packages written from templates, and transition tables as NumPy arrays.

`write_package` renders a directory of Jinja2 templates. `copy_templates` copies the built-in templates, whose package
needs only Gymnasium and NumPy.
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
