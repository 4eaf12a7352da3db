"""Repeat the experiments of the paper with many seeds and with controls.

X. Liu and I. David, "A Model-Driven Approach for Developing Families of Reinforcement Learning Environments", MODELS
2026, section 6: tables 3 (agents on the target), 4 (time of generation) and 5 (against random families), and the curves
beside them. The published numbers come from one training seed; here each number is a mean over seeds with its interval.

`reproduce` trains, `claims` tests the claims of the paper, `reproduction_report` returns the report, `write_tables`
writes CSV files, and `figures` returns the charts.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.report.reproduction._claims import Claim as Claim, claims as claims
    from envgraph.report.reproduction._page import (
        claims_table as claims_table,
        figures as figures,
        reproduction_report as reproduction_report,
        write_tables as write_tables,
    )
    from envgraph.report.reproduction._runs import Budget as Budget, reproduce as reproduce

later(globals())
