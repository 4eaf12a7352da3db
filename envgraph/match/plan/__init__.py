"""Search plans: the goals of a body in the order that promises the least work."""

from envgraph.match.passes._calls import CallGraph
from envgraph.match.plan._live import LiveSizes
from envgraph.match.plan._options import Unplannable, call_key
from envgraph.match.plan._plan import BodyPlan, Kind, Plan, Step, ViewKey, ViewPlan
from envgraph.match.plan._planner import Planner

__all__ = [
    "BodyPlan",
    "CallGraph",
    "Kind",
    "LiveSizes",
    "Plan",
    "Planner",
    "Step",
    "Unplannable",
    "ViewKey",
    "ViewPlan",
    "call_key",
]
