"""Search plans: the goals of a body in the order with the lowest estimated cost."""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.match.passes._call_graph import CallGraph as CallGraph
    from envgraph.match.plan._measured_sizes import LiveSizes as LiveSizes
    from envgraph.match.plan._planner import Planner as Planner
    from envgraph.match.plan._search_plan import (
        PatternPlan as PatternPlan,
        PatternQuery as PatternQuery,
        PlanStep as PlanStep,
        SearchPlan as SearchPlan,
        StepKind as StepKind,
    )
    from envgraph.match.plan._step_candidates import (
        query_of_call as query_of_call,
    )

export_lazily(globals())
