"""Families that are searched for as a whole: ordered, ending in a target, and judged together.

The genetic algorithm values each model by itself; here an objective sees all members in their order, with their models,
measures and tables, such as how often a learner that is trained on one after the other comes to solve the target.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.search.curricula._climb import (
        CurriculumProgress as CurriculumProgress,
        CurriculumSearch as CurriculumSearch,
    )
    from envgraph.search.curricula._levels import MOST_STATES as MOST_STATES, Level as Level, Levels as Levels
    from envgraph.search.curricula._moves import Moves as Moves
    from envgraph.search.curricula._objectives import (
        Judged as Judged,
        Learning as Learning,
        Measured as Measured,
        value_of as value_of,
    )
    from envgraph.search.curricula._settings import Begin as Begin, CurriculumSettings as CurriculumSettings
    from envgraph.search.curricula._starts import Starts as Starts

later(globals())
