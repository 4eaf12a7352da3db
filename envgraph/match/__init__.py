"""Matchers: classes that find the matches of patterns in a model."""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.match._matcher import FREE as FREE, Free as Free, Matcher as Matcher, Row as Row
    from envgraph.match.demand._compiled import CompiledMatcher as CompiledMatcher
    from envgraph.match.demand._sharing import Questions as Questions
    from envgraph.match.explain._explain import Explanation as Explanation
    from envgraph.match.explain._why import Failure as Failure, WhyNot as WhyNot
    from envgraph.match.views import Subscription as Subscription, ViewMatcher as ViewMatcher

later(globals())
