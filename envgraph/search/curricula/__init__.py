"""Families that are searched for as a whole: ordered, ending in a target, and judged together.

The genetic algorithm values each model by itself; here an objective sees all members in their order, with their models,
measures and tables, such as how often a learner that is trained on one after the other comes to solve the target.
"""

from envgraph.search.curricula._climb import CurriculumProgress, CurriculumSearch, CurriculumSettings
from envgraph.search.curricula._levels import MOST_STATES, Level, Levels
from envgraph.search.curricula._moves import Moves
from envgraph.search.curricula._objectives import Judged, Learning, Measured, value_of
from envgraph.search.curricula._starts import Begin, Starts

__all__ = [
    "MOST_STATES",
    "Begin",
    "CurriculumProgress",
    "CurriculumSearch",
    "CurriculumSettings",
    "Judged",
    "Learning",
    "Level",
    "Levels",
    "Measured",
    "Moves",
    "Starts",
    "value_of",
]
