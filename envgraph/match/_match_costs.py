"""The numbers that decide how patterns are matched. None changes a result; most change plans, time or memory."""

from __future__ import annotations

from typing import Final

from envgraph.code import dataclass


@dataclass(frozen=True, slots=True)
class PlanCosts:
    """The estimates of the planner, in accesses to the store and numbers of rows.

    `python -m benchmarks match` and `ttc18` measure the plans, and `planning` the time for making them; no benchmark
    decides on a number alone. `tests/golden` shows the plans that a change of one gives.
    """

    access: float = 1.0  # the unit: one access to the store
    expression: float = 2.0  # evaluating an expression
    call: float = 4.0  # a function call, without the work of the function
    many: float = 10.0  # assumed links of a many-valued reference
    parts: float = 50.0  # assumed objects in a many-valued containment reference
    unknown: float = 100.0  # assumed objects of a class that is neither contained nor contains other objects
    most_contained: float = 10_000.0  # the largest estimate for a class whose objects are contained
    most: float = 1e100  # the largest estimate: a product of hundreds of fanouts would exceed the range of floats
    sample: int = 256  # objects whose links are counted for an estimate
    reached: float = 30.0  # the smallest estimate of the number of objects that a closure reaches
    reached_share: float = 3.0  # a closure is estimated to reach one in this many objects
    meeting_share: float = 8.0  # questions "does one end reach the other" that cost one search: they share work
    opaque_rows: float = 10.0  # assumed matches of a recursive pattern, for each unbound parameter that is needed
    opaque_cost: float = 500.0  # the assumed cost of one call of a recursive pattern
    opaque_whole: float = 100.0  # the factor on rows and cost of a recursive pattern if no parameter is bound
    deepest: int = 12  # the longest chain of calls that is followed for an estimate
    most_branches: int = 4  # alternative loops tried at one place; the cheapest complete plan is chosen
    most_plans: int = 48  # complete plans that are compared; after that the best ranked loop is taken
    most_explored: int = 24  # goals above which only the best ranked loop is tried
    most_joined: int = 24  # goals of an existence test that is planned in two ways
    widest: int = 2  # key variables of a duplicate filter before a loop: with more, duplicates are rare
    few_rows: float = 50.0  # partial matches from which removing duplicates costs less than it saves


@dataclass(frozen=True, slots=True)
class Inlining:
    """Largest sizes of inlined bodies, as `python -m benchmarks match` and `planning` need them; not measured alone.

    With more, conjunctions are too long to be planned well, and views derive the same match more than once.
    """

    goals: int = 8  # of a body that is inlined, goals inside negations included
    calling: int = 64  # goals of the calling body from which no more calls are inlined
    alternatives: int = 4  # bodies of a negated pattern
    expanded: int = 8  # bodies of a pattern after `expanded` has multiplied out the bodies of its calls
    local: int = 2  # local variables of a body inlined into a view: each one can multiply derivations of a match


@dataclass(frozen=True, slots=True)
class DemandCosts:
    """Thresholds at which searches on demand keep their results, or do the work for all nodes at once.

    `python -m benchmarks questions` decides on the last two. The others are not measured alone; `growth` has closures
    and recursive patterns, which grow faster than the model where a number is far too large.
    """

    few_visited: int = 1_000  # visited nodes up to which no work is done for all nodes
    times: int = 2  # searches must visit this many times the number of nodes before work is done for all
    few_reached: int = 16  # reached nodes below which a new search is cheaper than counting bits
    most_reached: int = 100_000  # reached nodes kept for one state of the model, condensations excluded
    most_bytes: int = 64_000_000  # of the integers of condensations, about those of a chain of 30,000 nodes
    most_classes: int = 256  # whose members are stored as bits of an integer
    class_cost: int = 2  # reached nodes that a search visits in the time needed for one class
    slow_bits: int = 1_024  # bits of an integer that add the time of one visited node to the work for each class
    dense: int = 8  # all nodes are scanned if at least one in this many nodes is reached
    most_paths: int = 64  # call paths from a pattern above which its results are kept until the model changes
    most_calls: int = 10_000  # kept calls of one pattern
    most_worse: int = 8  # a direction of a closure is used if it is at most this many times as expensive
    few_times: int = 3  # fully bound calls with the same value after which all rows with this value are computed
    few_rows: int = 1_000  # kept rows and calls up to which fully bound calls are evaluated one by one
    most_rows: int = 200_000  # rows and calls of recursive patterns kept for one state of the model
    few_lookups: int = 2  # lookups by value that scan all objects; the next lookup builds the index
    followed: int = 8  # an index is updated if at most one in this many objects has changed, else rebuilt


@dataclass(frozen=True, slots=True)
class ViewCosts:
    """When views have indexes, share their work, or are made at all, in accesses to the store and numbers of rows.

    `python -m benchmarks closure` decides on `few_starts` and `part`, `growth` on `most_ordered` and `sorted`, and
    `questions` on `long_loop`. The others are not measured alone; `train` and `ttc18` measure views as a whole.
    """

    min_indexed_cost: float = 60.0  # a search above which a view has an index of its own rows
    many: float = 100.0  # tested objects from which a view of their values pays off
    sample: int = 512  # objects of a class whose values are sampled
    different: int = 8  # different values from which a lookup by value is selective
    tried: int = 64  # tuples tried for an explanation, evenly spaced among all tuples of the relation
    most_ordered: int = 100_000  # rows for which a negated or counted pattern with `x < y` has a view
    most_goals: int = 40  # of a body with delta functions: each goal has its own function and plan
    few_starts: int = 12  # of a closure, each searched separately; more share strongly connected components
    part: int = 8  # the search for affected starts visits at most the number of starts divided by this
    large: int = 32  # tuples in a group above which its aggregate is updated by each change
    long_log: int = 256  # items from which shortening a log is worthwhile
    long_loop: int = 100_000  # rows listed in the time needed to make a view: 10 ms
    spread: int = 4  # matches per object for which a view is made; other patterns are searched every round
    sorted: int = 16  # accesses in the time needed to sort one row into the order of a search
    expensive: float = 400.0  # a search below which it is as fast as a lookup
    read: float = 2.0  # accesses of a search that take as long as reading one row of a view


PLAN: Final = PlanCosts()
INLINING: Final = Inlining()
DEMAND: Final = DemandCosts()
VIEWS: Final = ViewCosts()
