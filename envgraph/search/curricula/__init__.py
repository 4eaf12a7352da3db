"""Search for a whole family: an ordered curriculum that ends in a target and is judged as one.

The genetic algorithm measures each model on its own. Here an objective sees all members in their order, with their
models, measures and transition tables. An example is the success rate on the target of learners trained on the members.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.search.curricula._climb import (
        CurriculumProgress as CurriculumProgress,
        CurriculumSearch as CurriculumSearch,
    )
    from envgraph.search.curricula._levels import Level as Level, Levels as Levels
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
