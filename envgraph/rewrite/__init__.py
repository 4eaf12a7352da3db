"""Rules, control units, derived rules, events and exploration; `Engine`, the facade over all.

How a rule is applied, once a match of its left side is chosen:

1. `forall` and `optional` blocks are matched, and all values are computed, on the state before the rule. The blocks of
   an `optional` take the least match, by ids.
2. For the rule and all matches of its blocks together: links and objects are deleted, what gets another container
   leaves the old one, objects are retyped, objects created, merges, moves and links made, values and references set.
3. An existing link that is created again changes nothing; `Engine.notices` tells it once. Neither does a missing one
   that is deleted. `set x.n += ..` of several matches adds up.

It is refused, and the model left as it was, with a `RuleError` whose `reason` is

- "stale-match": the match is none any more;
- "identification": a deleted object or link is matched as something else, too (homomorphic rules);
- "ambiguous": two matches of blocks, or two variables for one object, want different things, or things of which the
  later would undo the earlier; `details` names both matches and what they want;
- "dangling": under DPO, a deleted object has links that the left side does not mention (except the one to its
  container, and those of the object and what it contains with each other or themselves);
- "lost-link": under DPO, a retyped or merged object has links that its class does not allow;
- "full": a new link finds no room at one of its ends, or the object is in a container already;
- "containment": a new link would close a cycle of containers, or what is kept would go with a container;
- "missing-link": a link that is redirected is not there.

What the steps of a unit mean is said in `_units`.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.rewrite._branches import Branches as Branches
    from envgraph.rewrite._match import (
        Application as Application,
        Firing as Firing,
        Match as Match,
        Matches as Matches,
        Row as Row,
        Shape as Shape,
    )
    from envgraph.rewrite._names import Signature as Signature
    from envgraph.rewrite.derive._derive import derived as derived, derived_rules as derived_rules
    from envgraph.rewrite.engine._described import Steps as Steps
    from envgraph.rewrite.engine._engine import Engine as Engine
    from envgraph.rewrite.engine._losses import Loss as Loss
    from envgraph.rewrite.engine._register import Registration as Registration
    from envgraph.rewrite.engine._trace import (
        TRACE_FORMAT as TRACE_FORMAT,
        Trace as Trace,
        trace_schema as trace_schema,
        trace_to_text as trace_to_text,
    )
    from envgraph.rewrite.events._agenda import Agenda as Agenda
    from envgraph.rewrite.events._event_rules import EventRule as EventRule
    from envgraph.rewrite.explore._exploration import (
        Exploration as Exploration,
        State as State,
        Statistics as Statistics,
        Transition as Transition,
    )
    from envgraph.rewrite.explore._walks import (
        SavepointWalk as SavepointWalk,
        walk_of_savepoints as walk_of_savepoints,
    )
    from envgraph.rewrite.run._choice import Choice as Choice
    from envgraph.rewrite.run._runner import Randomness as Randomness
    from envgraph.rewrite.run._units import RunResult as RunResult

later(globals())
