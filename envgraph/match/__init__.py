"""Matchers: classes that find the matches of patterns in a model."""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.match._matcher import FREE as FREE, Free as Free, Matcher as Matcher, Row as Row
    from envgraph.match.demand._compiled_matcher import CompiledMatcher as CompiledMatcher
    from envgraph.match.demand._repeated_queries import RepeatedQueries as RepeatedQueries
    from envgraph.match.explain._plan_text import Explanation as Explanation
    from envgraph.match.explain._why_not import BodyFailure as BodyFailure, WhyNot as WhyNot
    from envgraph.match.views import Subscription as Subscription, ViewMatcher as ViewMatcher

export_lazily(globals())
