"""The command `envgraph reproduce`: repeat the experiments of the paper (X. Liu and I. David, 2026)."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

from envgraph import __version__
from envgraph.cli._output import print_json, print_line, print_table, progress_bar
from envgraph.cli._training_commands import parse_budgets
from envgraph.errors import InvalidArgument, did_you_mean
from envgraph.files import replace_file
from envgraph.report import chart_png, render_html, standalone_chart
from envgraph.report.reproduction import (
    check_paper_claims,
    claims_table,
    reproduce,
    reproduction_report,
    reward_charts,
    write_tables,
)


def reproduce_paper(
    what: str,
    output: Path,
    *,
    seeds: int,
    steps: str,
    times: bool,
    workers: int,
    force: bool,
) -> None:
    """Repeat the paper's experiments, write the page, tables and charts, and print which claims hold.

    Raises:
        InvalidArgument: the experiment is unknown, or the directory is not empty.
    """
    if what != "paper":
        raise InvalidArgument(f"unknown experiment `{what}`", did_you_mean(what, ["paper"]) or "write `paper`")
    if output.exists() and (not output.is_dir() or any(output.iterdir())) and not force:
        raise InvalidArgument(f"{output} exists already: replace its files with --force, or choose another --output")
    with _ProgressBars() as bars:
        found = reproduce(
            seeds=seeds, budgets=parse_budgets(steps), times=times, workers=workers, progress=bars.advance
        )
    facts = {
        "made by": f"envgraph {__version__}: envgraph reproduce paper --seeds {seeds}",
        "data": "https://zenodo.org/records/21347611 (MIT licence)",
    }
    write_tables(found, output)
    for name, chart in reward_charts(found).items():
        picture = standalone_chart(chart)
        replace_file(output / f"{name}.svg", picture)
        if pixels := chart_png(picture):
            replace_file(output / f"{name}.png", pixels)
    page = output / "paper.html"
    replace_file(page, render_html(reproduction_report(found, facts)))
    if print_json(
        lambda: {
            "page": str(page),
            "seeds": seeds,
            "claims": [_claim_data(one) for one in check_paper_claims(found)],
        }
    ):
        return
    table = claims_table(found)
    print_table(f"the paper, with {seeds} seeds", table.columns, table.rows)
    print_line(f"page: {page}")


def _claim_data(claim: Any) -> dict[str, Any]:
    tested = {"over": claim.over, "p_value": claim.p_value}
    return {"claim": claim.text, "paper": claim.paper, "here": claim.here, **tested, "verdict": claim.verdict}


class _ProgressBars(ExitStack):
    """A sequence of progress bars, one for each part of the work."""

    _what = ""

    def advance(self, what: str, done: int, total: int) -> None:
        """Show how much of a part is done; begin a new bar if the part changes."""
        if what != self._what:
            self.close()
            self._what, self._bar = what, self.enter_context(progress_bar(what, total))
        self._bar(done)
