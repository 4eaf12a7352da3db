"""Incremental views: the match sets of watched patterns, updated after every change of the model."""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.match.views.watch._notifications import Subscription as Subscription
    from envgraph.match.views.watch._view_matcher import ViewMatcher as ViewMatcher

export_lazily(globals())
