"""Rewriting passes over bodies, before planning. Each pass is one function; a pipeline is a tuple of passes.

>>> [each.__name__ for each in ON_DEMAND]
['closures_as_calls', 'inline_calls', 'drop_repeated', 'drop_implied', 'drop_implied_inside']
>>> [each.__name__ for each in FOR_VIEWS]
['links_as_facts', 'closures_as_calls', 'inline_few_locals', 'drop_repeated', 'drop_implied', 'split_negations']
"""

from envgraph.match.passes._closure_calls import closures_as_calls
from envgraph.match.passes._implied_class_tests import drop_implied, drop_implied_inside
from envgraph.match.passes._inlining import (
    expanded_bodies as expanded_bodies,
    inline_calls,
    inline_few_locals,
)
from envgraph.match.passes._normal_relations import links_as_facts, split_negations
from envgraph.match.passes._repeated_relations import drop_repeated
from envgraph.match.passes._rewritten_bodies import Pass, RewrittenBodies as RewrittenBodies

ON_DEMAND: tuple[Pass, ...] = (
    closures_as_calls,
    inline_calls,
    drop_repeated,
    drop_implied,
    drop_implied_inside,
)
"""The pipeline for the compiled matcher, which searches for matches on demand."""

FOR_VIEWS: tuple[Pass, ...] = (
    links_as_facts,
    closures_as_calls,
    inline_few_locals,
    drop_repeated,
    drop_implied,
    split_negations,
)
"""The pipeline for views. Its bodies give few derivations of each match, and each negation negates a single relation.

Class tests inside a negation are kept, because each of them may be the only relation that is negated."""
