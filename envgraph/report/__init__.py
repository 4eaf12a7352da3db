"""Pictures, charts and the HTML report.

>>> from envgraph.report import Series, line_chart
>>> line_chart([Series("a", (0, 1), (2, 3))], x_label="x", y_label="y", title="t").startswith("<svg")
True
"""

from envgraph.errors import shorten
from envgraph.report._charts import COLOURS, Series, line_chart, standalone, ticks
from envgraph.report._family_report import family_report, stage_rows, stage_table
from envgraph.report._page import Card, Report, Section, Table, render_html
from envgraph.report._training_report import Trained

__all__ = [
    "COLOURS",
    "Card",
    "Report",
    "Section",
    "Series",
    "Table",
    "Trained",
    "family_report",
    "line_chart",
    "render_html",
    "stage_rows",
    "stage_table",
    "standalone",
    "ticks",
]

shorten(globals(), __all__)
