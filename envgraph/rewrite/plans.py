"""Plans of rules, for those who carry them out elsewhere."""

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

__all__ = [
    "BlockPlan",
    "ChangeClass",
    "ChangeTargets",
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
]
