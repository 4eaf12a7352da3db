"""Conjunctions rewritten before they are planned: each pass is one function, and a pipeline is a tuple of them.

>>> [each.__name__ for each in ON_DEMAND]
['closures_as_calls', 'inline_calls', 'drop_repeated', 'drop_implied', 'drop_implied_inside']
>>> [each.__name__ for each in FOR_VIEWS]
['links_as_facts', 'closures_as_calls', 'inline_few_locals', 'drop_repeated', 'drop_implied', 'split_negations']
"""

from envgraph.match.passes._bodies import Bodies as Bodies, Pass
from envgraph.match.passes._closures import closures_as_calls
from envgraph.match.passes._implied import drop_implied, drop_implied_inside
from envgraph.match.passes._inline import expanded as expanded, inline_calls, inline_few_locals
from envgraph.match.passes._relations import links_as_facts, split_negations
from envgraph.match.passes._repeated import drop_repeated

ON_DEMAND: tuple[Pass, ...] = (
    closures_as_calls,
    inline_calls,
    drop_repeated,
    drop_implied,
    drop_implied_inside,
)
"""What the matcher does that looks for matches when it is asked."""

FOR_VIEWS: tuple[Pass, ...] = (
    links_as_facts,
    closures_as_calls,
    inline_few_locals,
    drop_repeated,
    drop_implied,
    split_negations,
)
"""What views are made of: few derivations of a match, and inside a negation only what is a single relation.

Class tests inside a negation stay: a relation whose meaning follows from elsewhere is still a relation.
"""
