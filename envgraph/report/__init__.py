"""Charts and HTML reports about families, training and audits.

>>> from envgraph.report import Series, line_chart
>>> line_chart([Series("a", (0, 1), (2, 3))], x_label="x", y_label="y", title="t").startswith("<svg")
True
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.report._audit_report import audit_figures as audit_figures, audit_report as audit_report
    from envgraph.report._charts import (
        Series as Series,
        chart_png as chart_png,
        line_chart as line_chart,
        standalone_chart as standalone_chart,
    )
    from envgraph.report._family_report import (
        SearchRecord as SearchRecord,
        family_report as family_report,
        stage_rows as stage_rows,
        stage_table as stage_table,
    )
    from envgraph.report._html_page import (
        Report as Report,
        ReportSection as ReportSection,
        ReportTable as ReportTable,
        render_html as render_html,
    )
    from envgraph.report._training_report import TrainingResults as TrainingResults

export_lazily(globals())
