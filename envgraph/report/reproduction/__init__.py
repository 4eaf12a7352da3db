"""Repeat the experiments of the paper with many seeds and with controls.

X. Liu and I. David, "A Model-Driven Approach for Developing Families of Reinforcement Learning Environments", MODELS
2026, section 6: tables 3 (agents on the target), 4 (time of generation) and 5 (against random families), and the curves
beside them. The published numbers come from one training seed; here each number is a mean over seeds with its interval.

`reproduce` trains, `check_paper_claims` tests the claims of the paper, `reproduction_report` returns the report,
`write_tables` writes CSV files, and `reward_charts` returns the charts.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.report.reproduction._paper_claims import (
        PaperClaim as PaperClaim,
        check_paper_claims as check_paper_claims,
    )
    from envgraph.report.reproduction._reproduction_page import (
        claims_table as claims_table,
        reproduction_report as reproduction_report,
        reward_charts as reward_charts,
        write_tables as write_tables,
    )
    from envgraph.report.reproduction._training_runs import (
        BudgetResults as BudgetResults,
        reproduce as reproduce,
    )

export_lazily(globals())
