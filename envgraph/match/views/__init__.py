"""Incremental views: the match sets of watched patterns, kept current with every change of the model."""

from envgraph.match.views._listeners import Subscription
from envgraph.match.views._matcher import ViewMatcher

__all__ = ["Subscription", "ViewMatcher"]
