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

from envgraph.errors import later, shorten
from envgraph.rewrite._branches import Branches
from envgraph.rewrite._match import Application, Firing, Match, Matches, Row, Shape
from envgraph.rewrite._names import Signature, Taken
from envgraph.rewrite.engine._described import Steps
from envgraph.rewrite.engine._engine import Engine
from envgraph.rewrite.engine._losses import Loss
from envgraph.rewrite.engine._register import Registration
from envgraph.rewrite.engine._trace import TRACE_FORMAT, Trace, trace_schema, trace_to_text
from envgraph.rewrite.events._agenda import Agenda
from envgraph.rewrite.events._event_rules import Activation, EventRule
from envgraph.rewrite.explore._exploration import Exploration, State, Statistics, Transition
from envgraph.rewrite.explore._walks import SavepointWalk, walk_of_savepoints
from envgraph.rewrite.run._choice import Choice
from envgraph.rewrite.run._runner import Randomness, RuleRunner
from envgraph.rewrite.run._units import RunResult

if TYPE_CHECKING:
    from envgraph.rewrite.derive._check import check_derivation
    from envgraph.rewrite.derive._derive import derived, derived_rules

__all__ = [
    "TRACE_FORMAT",
    "Activation",
    "Agenda",
    "Application",
    "Branches",
    "Choice",
    "Engine",
    "EventRule",
    "Exploration",
    "Firing",
    "Loss",
    "Match",
    "Matches",
    "Randomness",
    "Registration",
    "Row",
    "RuleRunner",
    "RunResult",
    "SavepointWalk",
    "Shape",
    "Signature",
    "State",
    "Statistics",
    "Steps",
    "Taken",
    "Trace",
    "Transition",
    "check_derivation",
    "derived",
    "derived_rules",
    "trace_schema",
    "trace_to_text",
    "walk_of_savepoints",
]

later(
    globals(),
    {
        "envgraph.rewrite.derive._check": "check_derivation",
        "envgraph.rewrite.derive._derive": "derived derived_rules",
    },
)
shorten(globals(), __all__)
