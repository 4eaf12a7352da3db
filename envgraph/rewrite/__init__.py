"""Rules applied to a model, control units, derived rules; `Engine`, the facade over them and over queries."""

from envgraph.rewrite._check import check_rule
from envgraph.rewrite._derive import check_derivation, derived_rules
from envgraph.rewrite._engine import Engine
from envgraph.rewrite._match import Application, Firing, Match, Row, Shape
from envgraph.rewrite._names import Signature, Taken
from envgraph.rewrite._run import STEP_LIMIT
from envgraph.rewrite._runner import Randomness, RuleRunner

__all__ = [
    "STEP_LIMIT",
    "Application",
    "Engine",
    "Firing",
    "Match",
    "Randomness",
    "Row",
    "RuleRunner",
    "Shape",
    "Signature",
    "Taken",
    "check_derivation",
    "check_rule",
    "derived_rules",
]
