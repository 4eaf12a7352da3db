"""Optimisation: search for the sequence of rule applications whose resulting model maximises or minimises objectives.

`optimise` searches from the model of an engine. Moves are rules and units; objectives are measures, such as a number
that a query computes; constraints are patterns. Every strategy works through `Walk`. A walk makes a move, reads the
costs of the new model from the views, and keeps or undoes the move.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.search.optimising._archive import Archive as Archive, Found as Found
    from envgraph.search.optimising._climbing import Annealing as Annealing, HillClimb as HillClimb
    from envgraph.search.optimising._goals import Goal as Goal, Sense as Sense
    from envgraph.search.optimising._optimise import (
        Optimum as Optimum,
        Solution as Solution,
        optimise as optimise,
        pursue as pursue,
    )
    from envgraph.search.optimising._populations import Beam as Beam
    from envgraph.search.optimising._tree_search import TreeSearch as TreeSearch
    from envgraph.search.optimising._walk import Strategy as Strategy, Walk as Walk

later(globals())
