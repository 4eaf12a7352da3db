"""Incremental views: the match sets of watched patterns, kept current with every change of the model."""

from envgraph.match.views._matcher import Subscription, ViewMatcher

__all__ = ["Subscription", "ViewMatcher"]
