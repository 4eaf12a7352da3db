"""Audit scores of levels: how well they rank levels, teach students, and what they cost, compared with exact scores.

`audit` runs students on levels that mutation rules make, one for each method and seed; `findings_of` decides which
claims hold. Methods and claims are named in `METHODS` and `CONTRASTS`, before anything is run. The method is described
in `docs/evidence/levels.md`.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.learn.audit._audit_settings import (
        PROTOCOL as PROTOCOL,
        AuditSettings as AuditSettings,
        check_audit as check_audit,
        parse_audit_settings as parse_audit_settings,
    )
    from envgraph.learn.audit._findings import (
        ALL_DOMAINS as ALL_DOMAINS,
        Finding as Finding,
        findings_of as findings_of,
        rank_values as rank_values,
        seed_and_level_test as seed_and_level_test,
    )
    from envgraph.learn.audit._methods import (
        CONTRASTS as CONTRASTS,
        EDITING as EDITING,
        METHODS as METHODS,
        PROBED as PROBED,
        AuditMethod as AuditMethod,
    )
    from envgraph.learn.audit._ranks import rank_levels as rank_levels
    from envgraph.learn.audit._scores import Student as Student
    from envgraph.learn.audit._student_run import ROLLOUTS as ROLLOUTS, AuditRun as AuditRun
    from envgraph.learn.audit._study import Study as Study, audit as audit
    from envgraph.learn.audit._summaries import (
        MethodSummary as MethodSummary,
        summarise_methods as summarise_methods,
        write_audit as write_audit,
    )

export_lazily(globals())
