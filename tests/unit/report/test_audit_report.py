"""The page of an audit."""

import pytest

from envgraph.errors import InvalidArgument
from envgraph.learn.audit import PROBED, findings_of
from envgraph.report import (
    audit_figures,
    audit_report,
    render_html,
)
from envgraph.report._audit_charts import (
    IntervalRow,
    ScatterPanel,
    interval_chart,
    scatter_chart,
)
from tests.unit.learn.audit.test_study import replace_name, study


def test_the_page_has_every_claim_with_its_verdict_in_each_domain() -> None:
    studies = [study(0.1, 0.02), replace_name(study(-0.1, 0.02), "Others <i>")]
    findings = findings_of(studies)
    page = render_html(audit_report(studies, findings, {"versions": "1"}))
    assert "Others &lt;i&gt;" in page
    assert "Others <i>" not in page
    for one in findings:
        assert one.claim in page
        assert f"{one.verdict} {one.value:+.3f}" in page
    assert "stands 1, fails 2, undecided 0" in page
    figures = audit_figures(studies, findings)
    assert [name for name in figures if name.startswith("Corridors")] == [f"Corridors_figure{n}" for n in (1, 2, 3)]
    assert all(name.replace("_", "").isalnum() for name in figures)


def test_points_and_intervals_are_drawn_at_their_values() -> None:
    chart = scatter_chart(
        [ScatterPanel(score, (((0.0, 0.0),), ((1.0, 2.0),))) for score in PROBED],
        ("one", "other"),
        x_label="x",
        y_label="y",
        title="t",
    )
    assert chart.count("<circle") == 2 * len(PROBED) + 2
    rows = [
        IntervalRow("a < b", 0.5, 0.0, 1.0, "text"),
        IntervalRow("c", -0.5, -1.0, 0.0, "text", is_highlighted=False),
    ]
    drawn = interval_chart(rows, x_label="x", title="t")
    assert "a &lt; b" in drawn
    assert drawn.count('class="line"') == 2
    for empty in (
        lambda: interval_chart([], x_label="x", title="t"),
        lambda: scatter_chart([], (), x_label="", y_label="", title=""),
    ):
        with pytest.raises(InvalidArgument):
            empty()
