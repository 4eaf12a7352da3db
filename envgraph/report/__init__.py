"""Pictures, charts and the HTML report.

>>> from envgraph.report import Series, line_chart
>>> line_chart([Series("a", (0, 1), (2, 3))], x_label="x", y_label="y", title="t").startswith("<svg")
True
"""

from envgraph.errors import shorten
from envgraph.report._audit_charts import Interval, Panel, interval_chart, scatter_chart
from envgraph.report._audit_report import audit_figures, audit_report
from envgraph.report._charts import Series, line_chart, png, standalone, ticks
from envgraph.report._family_report import family_report, stage_rows, stage_table
from envgraph.report._page import Card, Report, Section, Table, render_html
from envgraph.report._training_report import Trained

__all__ = [
    "Card",
    "Interval",
    "Panel",
    "Report",
    "Section",
    "Series",
    "Table",
    "Trained",
    "audit_figures",
    "audit_report",
    "family_report",
    "interval_chart",
    "line_chart",
    "png",
    "render_html",
    "scatter_chart",
    "stage_rows",
    "stage_table",
    "standalone",
    "ticks",
]

shorten(globals(), __all__)
