"""Optimisation: search for the sequence of rule applications whose resulting model maximises or minimises objectives.

`optimise` searches from the model of an engine. Moves are rules and units; objectives are measures, such as a number
that a query computes; constraints are patterns. Every strategy works through `Walk`. A walk makes a move, reads the
costs of the new model from the views, and keeps or undoes the move.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.search.optimising._annealing import Annealing as Annealing, HillClimb as HillClimb
    from envgraph.search.optimising._beam_search import Beam as Beam
    from envgraph.search.optimising._goals import Goal as Goal, Sense as Sense
    from envgraph.search.optimising._optimisation import (
        Optimum as Optimum,
        Solution as Solution,
        optimise as optimise,
        search_goals as search_goals,
    )
    from envgraph.search.optimising._pareto_archive import (
        FoundState as FoundState,
        ParetoArchive as ParetoArchive,
    )
    from envgraph.search.optimising._search_walk import Strategy as Strategy, Walk as Walk
    from envgraph.search.optimising._tree_search import TreeSearch as TreeSearch

export_lazily(globals())
