"""Export of families: packages written from templates, and transition tables as NumPy arrays.

`write_package` renders a directory of Jinja2 templates. `copy_templates` copies the built-in templates, whose package
needs only Gymnasium and NumPy.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.search.export._array_export import (
        write_frozen_lake as write_frozen_lake,
        write_tables as write_tables,
    )
    from envgraph.search.export._package import (
        MINIGRID_TEMPLATES as MINIGRID_TEMPLATES,
        copy_templates as copy_templates,
        write_package as write_package,
    )
    from envgraph.search.export._templates import TemplateDirectory as TemplateDirectory

export_lazily(globals())
