"""Plans of rules and checked units, for packages that execute rules in another way than the engine."""

from envgraph.rewrite._plan import (
    BlockPlan as BlockPlan,
    ChangeClass as ChangeClass,
    ChangeTargets as ChangeTargets,
    Compute as Compute,
    Delete as Delete,
    Increase as Increase,
    Link as Link,
    New as New,
    Rehome as Rehome,
    RulePlan as RulePlan,
    SetTargets as SetTargets,
    SetValue as SetValue,
    SetValues as SetValues,
    Unlink as Unlink,
)
from envgraph.rewrite.check._unit_check import CheckedUnit as CheckedUnit, all_steps as all_steps
