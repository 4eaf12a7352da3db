"""An agent's behaviour over a model, as data: what it does, sees and gets, and whether that can be.

`check_behaviour` says what is wrong with a behaviour; `envgraph.env` runs it. The rest is what both need to know of it.
"""

from envgraph.behaviour._check import check_behaviour
from envgraph.behaviour._clauses import Question, condition_question, count_question
from envgraph.behaviour._data import (
    Action,
    Agent,
    Behaviour,
    Branch,
    Domain,
    DrawGraph,
    DrawGrid,
    DrawnLink,
    EachStep,
    Effect,
    End,
    Observation,
    ObserveAttribute,
    ObserveFind,
    ObserveObject,
    ObservePath,
    ObserveRange,
    OnFind,
    OnReset,
    RuleCall,
    Token,
)
from envgraph.behaviour._domains import MOST_VALUES, domain_type
from envgraph.behaviour._edges import edge_ends
from envgraph.behaviour._losing import Reading, is_gone, lost, readings, root_of, roots
from envgraph.behaviour._rewards import paying, reward_names
from envgraph.errors import shorten

__all__ = [
    "MOST_VALUES",
    "Action",
    "Agent",
    "Behaviour",
    "Branch",
    "Domain",
    "DrawGraph",
    "DrawGrid",
    "DrawnLink",
    "EachStep",
    "Effect",
    "End",
    "Observation",
    "ObserveAttribute",
    "ObserveFind",
    "ObserveObject",
    "ObservePath",
    "ObserveRange",
    "OnFind",
    "OnReset",
    "Question",
    "Reading",
    "RuleCall",
    "Token",
    "check_behaviour",
    "condition_question",
    "count_question",
    "domain_type",
    "edge_ends",
    "is_gone",
    "lost",
    "paying",
    "readings",
    "reward_names",
    "root_of",
    "roots",
]

shorten(globals(), __all__)
