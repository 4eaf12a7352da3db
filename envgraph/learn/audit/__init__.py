"""Audit scores of levels: how well they rank levels, teach students, and what they cost, compared with exact scores.

`audit` runs students on levels that mutation rules make, one for each method and seed; `findings_of` decides which
claims hold. Methods and claims are named in `METHODS` and `CONTRASTS`, before anything is run. The method is described
in `docs/evidence.md`.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.learn.audit._claims import (
        POOLED as POOLED,
        Finding as Finding,
        findings_of as findings_of,
        rank_values as rank_values,
        two_way_test as two_way_test,
    )
    from envgraph.learn.audit._methods import (
        CONTRASTS as CONTRASTS,
        EDITING as EDITING,
        METHODS as METHODS,
        PROBED as PROBED,
        Method as Method,
    )
    from envgraph.learn.audit._ranks import ranking as ranking
    from envgraph.learn.audit._run import ROLLOUTS as ROLLOUTS, Run as Run
    from envgraph.learn.audit._scores import Student as Student
    from envgraph.learn.audit._settings import (
        PROTOCOL as PROTOCOL,
        AuditSettings as AuditSettings,
        audit_problems as audit_problems,
        audit_settings as audit_settings,
    )
    from envgraph.learn.audit._study import Study as Study, audit as audit
    from envgraph.learn.audit._tables import (
        Summary as Summary,
        summaries as summaries,
        write_audit as write_audit,
    )

later(globals())
