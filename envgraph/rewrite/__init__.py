"""Rules, units, derived rules, event rules, exploration, and the `Engine` that has them all.

An application of a rule at a match of its left-hand side (LHS) has three steps:

1. `forall` and `optional` blocks are matched, and all values are computed, on the state before the rule. An `optional`
   block takes its least match, compared by ids.
2. Changes are made for the rule and all matches of its blocks together, in this order: links and objects are deleted,
   objects that get another container leave the old one, objects are retyped, objects are created, objects are merged,
   objects are moved, links are created, attributes and references are set.
3. Creating a link that exists and deleting a link that is missing change nothing; `Engine.notices` reports a created
   link that existed, once. If several matches execute `set x.n += ..`, their amounts are added up.

A refused application leaves the model unchanged and raises a `RuleError`. Its `reason` is one of

- "stale-match": the match does not hold any more;
- "identification": a deleted object or link is also matched by another variable or edge (homomorphic rules);
- "ambiguous": two matches of blocks, or two variables for one object, ask for changes that contradict each other, or a
  later change would undo an earlier one; `details` names both matches and their changes;
- "dangling": under DPO, a deleted object has links that the LHS does not mention. Links to its container, and links
  among the object and the objects that it contains, are allowed;
- "lost-link": under DPO, a retyped or merged object has links that its class does not allow;
- "full": a new link exceeds the multiplicity at one of its ends, or the object already has a container;
- "containment": a new link would close a cycle of containers, or a preserved object would be deleted with a container;
- "missing-link": a link to redirect does not exist.

The module `_units` explains the steps of units.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.rewrite._choice_enumeration import Branches as Branches
    from envgraph.rewrite._matches import (
        Application as Application,
        Firing as Firing,
        Match as Match,
        Matches as Matches,
        Row as Row,
        Shape as Shape,
    )
    from envgraph.rewrite._signatures import Signature as Signature
    from envgraph.rewrite.derive._derive import derived as derived, derived_rules as derived_rules
    from envgraph.rewrite.engine._application_trace import (
        TRACE_FORMAT as TRACE_FORMAT,
        Trace as Trace,
        trace_schema as trace_schema,
        trace_to_text as trace_to_text,
    )
    from envgraph.rewrite.engine._described_units import Steps as Steps
    from envgraph.rewrite.engine._dpo_dangling import Loss as Loss
    from envgraph.rewrite.engine._engine import Engine as Engine
    from envgraph.rewrite.engine._registration import Registration as Registration
    from envgraph.rewrite.events._agenda import Agenda as Agenda
    from envgraph.rewrite.events._event_rules import EventRule as EventRule
    from envgraph.rewrite.explore._exploration import (
        Ending as Ending,
        Exploration as Exploration,
        ExplorationRecord as ExplorationRecord,
        State as State,
        Statistics as Statistics,
        Transition as Transition,
    )
    from envgraph.rewrite.explore._state_walks import (
        SavepointWalk as SavepointWalk,
        walk_of_savepoints as walk_of_savepoints,
    )
    from envgraph.rewrite.run._rule_choice import RuleChoice as RuleChoice
    from envgraph.rewrite.run._rule_runner import REFUSALS as REFUSALS, Randomness as Randomness
    from envgraph.rewrite.run._unit_programs import RunResult as RunResult

export_lazily(globals())
