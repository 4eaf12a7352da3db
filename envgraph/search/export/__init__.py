"""Families as code and data of others: packages from templates, tables as arrays of NumPy.

`write_package` writes what a directory of Jinja2 templates says; `copy_templates` gives those that come with envgraph,
whose package needs Gymnasium and NumPy alone.
"""

from envgraph.search.export._package import MINIGRID, copy_templates, write_package
from envgraph.search.export._tables import write_frozen_lake, write_tables
from envgraph.search.export._templates import Templates

__all__ = ["MINIGRID", "Templates", "copy_templates", "write_frozen_lake", "write_package", "write_tables"]
