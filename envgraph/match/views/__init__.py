"""Incremental views: the match sets of watched patterns, updated after every change of the model."""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.match.views.watch._listeners import Subscription as Subscription
    from envgraph.match.views.watch._matcher import ViewMatcher as ViewMatcher

later(globals())
