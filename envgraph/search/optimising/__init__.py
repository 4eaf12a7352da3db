"""Optimisation: which sequence of rules leads to the model of which some numbers are as large or as small as can be.

`optimise` searches from the model of an engine. Moves are rules and units; objectives are measures, such as a number
that a query computes; constraints are patterns. Every strategy works through `Walk`, which makes a move, reads from the
views what it is worth, and keeps it or undoes it.
"""

from envgraph.search.optimising._archive import Archive, Found
from envgraph.search.optimising._climbing import Annealing, HillClimb
from envgraph.search.optimising._goals import Goal, Sense, Standing
from envgraph.search.optimising._optimise import Optimum, Solution, optimise, pursue
from envgraph.search.optimising._populations import Beam
from envgraph.search.optimising._tree_search import TreeSearch
from envgraph.search.optimising._walk import Strategy, Walk

__all__ = [
    "Annealing",
    "Archive",
    "Beam",
    "Found",
    "Goal",
    "HillClimb",
    "Optimum",
    "Sense",
    "Solution",
    "Standing",
    "Strategy",
    "TreeSearch",
    "Walk",
    "optimise",
    "pursue",
]
