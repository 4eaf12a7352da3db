"""Charts and HTML reports about families, training and audits.

>>> from envgraph.report import Series, line_chart
>>> line_chart([Series("a", (0, 1), (2, 3))], x_label="x", y_label="y", title="t").startswith("<svg")
True
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.report._audit_report import audit_figures as audit_figures, audit_report as audit_report
    from envgraph.report._charts import (
        Series as Series,
        line_chart as line_chart,
        png as png,
        standalone as standalone,
    )
    from envgraph.report._family_report import (
        family_report as family_report,
        stage_rows as stage_rows,
        stage_table as stage_table,
    )
    from envgraph.report._page import (
        Report as Report,
        Section as Section,
        Table as Table,
        render_html as render_html,
    )
    from envgraph.report._training_report import Trained as Trained

later(globals())
