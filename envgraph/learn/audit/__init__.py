"""Scores of levels, audited: what they rank, teach and cost, beside exact regret and exact learnability.

`audit` runs students on levels that mutation rules make, one for each method and seed; `findings_of` says which claims
stand. Methods, their parts and the claims are named in `METHODS` and `CONTRASTS`, before anything is run. The method is
described in `docs/evidence.md`.
"""

from envgraph.errors import shorten
from envgraph.learn.audit._claims import POOLED, Finding, findings_of, rank_values, two_way_test
from envgraph.learn.audit._editing import Editor
from envgraph.learn.audit._levels import AuditLevels, make_levels
from envgraph.learn.audit._methods import CONTRASTS, EDITING, METHODS, PROBED, Contrast, Method
from envgraph.learn.audit._ranks import Ranking, rank_correlation, ranking
from envgraph.learn.audit._run import ROLLOUTS, SHOWN_ROLLOUTS, Run, run_method, schedule_of
from envgraph.learn.audit._scores import Student, score_levels
from envgraph.learn.audit._settings import AuditSettings, audit_problems, audit_settings
from envgraph.learn.audit._study import Study, audit
from envgraph.learn.audit._tables import Summary, summaries, write_audit

__all__ = [
    "CONTRASTS",
    "EDITING",
    "METHODS",
    "POOLED",
    "PROBED",
    "ROLLOUTS",
    "SHOWN_ROLLOUTS",
    "AuditLevels",
    "AuditSettings",
    "Contrast",
    "Editor",
    "Finding",
    "Method",
    "Ranking",
    "Run",
    "Student",
    "Study",
    "Summary",
    "audit",
    "audit_problems",
    "audit_settings",
    "findings_of",
    "make_levels",
    "rank_correlation",
    "rank_values",
    "ranking",
    "run_method",
    "schedule_of",
    "score_levels",
    "summaries",
    "two_way_test",
    "write_audit",
]

shorten(globals(), __all__)
