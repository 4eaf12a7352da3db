"""Plans of rules, and steps of units, for those who carry them out elsewhere."""

from envgraph.rewrite._plan import (
    BlockPlan,
    ChangeClass,
    ChangeTargets,
    Compute,
    Delete,
    Increase,
    Link,
    New,
    Rehome,
    RulePlan,
    SetTargets,
    SetValue,
    SetValues,
    Unlink,
)
from envgraph.rewrite.check._unit_check import CheckedUnit, all_steps

__all__ = [
    "BlockPlan",
    "ChangeClass",
    "ChangeTargets",
    "CheckedUnit",
    "Compute",
    "Delete",
    "Increase",
    "Link",
    "New",
    "Rehome",
    "RulePlan",
    "SetTargets",
    "SetValue",
    "SetValues",
    "Unlink",
    "all_steps",
]
