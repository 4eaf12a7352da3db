"""Matchers: what finds the matches of patterns in a model."""

from envgraph.errors import shorten
from envgraph.match._matcher import FREE, Free, Matcher, Row
from envgraph.match.demand._compiled import CompiledMatcher
from envgraph.match.demand._sharing import Questions
from envgraph.match.explain._explain import Explanation
from envgraph.match.explain._why import Failure, WhyNot, Witness
from envgraph.match.views import Subscription, ViewMatcher

__all__ = [
    "FREE",
    "CompiledMatcher",
    "Explanation",
    "Failure",
    "Free",
    "Matcher",
    "Questions",
    "Row",
    "Subscription",
    "ViewMatcher",
    "WhyNot",
    "Witness",
]

shorten(globals(), __all__)
