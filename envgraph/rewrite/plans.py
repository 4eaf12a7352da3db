"""Plans of rules and checked units, for packages that execute rules in another way than the engine."""

from envgraph.rewrite._rule_plan import (
    AddLink as AddLink,
    AdjustAttribute as AdjustAttribute,
    BlockPlan as BlockPlan,
    ChangeTargets as ChangeTargets,
    ComputeValue as ComputeValue,
    CreateObject as CreateObject,
    DeleteObject as DeleteObject,
    MergeObjects as MergeObjects,
    MoveToContainer as MoveToContainer,
    RemoveLink as RemoveLink,
    RetypeObject as RetypeObject,
    RulePlan as RulePlan,
    SetAttribute as SetAttribute,
    SetAttributeValues as SetAttributeValues,
    SetTargets as SetTargets,
)
from envgraph.rewrite.check._claims import (
    Claim as Claim,
    claims_of as claims_of,
    endangered_classes as endangered_classes,
    kept_objects as kept_objects,
    may_be_refused as may_be_refused,
)
from envgraph.rewrite.check._containment import (
    contained_end as contained_end,
    container_entries as container_entries,
    containments_of as containments_of,
    leaving_changes as leaving_changes,
)
from envgraph.rewrite.check._unit_check import CheckedUnit as CheckedUnit, all_steps as all_steps
from envgraph.rewrite.run._unit_code import (
    bound_outputs as bound_outputs,
    choice_tiers as choice_tiers,
    fails_without_changes as fails_without_changes,
)
