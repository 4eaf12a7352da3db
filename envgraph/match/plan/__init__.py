"""Search plans: the goals of a body in the order with the lowest estimated cost."""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.match.passes._calls import CallGraph as CallGraph
    from envgraph.match.plan._live import LiveSizes as LiveSizes
    from envgraph.match.plan._options import Unplannable as Unplannable, call_key as call_key
    from envgraph.match.plan._plan import (
        BodyPlan as BodyPlan,
        Kind as Kind,
        Plan as Plan,
        Step as Step,
        ViewKey as ViewKey,
        ViewPlan as ViewPlan,
    )
    from envgraph.match.plan._planner import Planner as Planner

later(globals())
