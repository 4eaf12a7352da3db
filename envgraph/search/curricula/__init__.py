"""Search for a whole family: an ordered curriculum that ends in a target and is judged as one.

The genetic algorithm measures each model on its own. Here an objective sees all members in their order, with their
models, measures and transition tables. An example is the success rate on the target of learners trained on the members.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.search.curricula._curriculum_search import (
        CurriculumProgress as CurriculumProgress,
        CurriculumSearch as CurriculumSearch,
    )
    from envgraph.search.curricula._curriculum_settings import (
        BeginKind as BeginKind,
        CurriculumSettings as CurriculumSettings,
    )
    from envgraph.search.curricula._family_moves import FamilyMoves as FamilyMoves
    from envgraph.search.curricula._first_families import FirstFamilySampler as FirstFamilySampler
    from envgraph.search.curricula._model_levels import LevelFactory as LevelFactory, ModelLevel as ModelLevel
    from envgraph.search.curricula._objectives import (
        CurriculumObjective as CurriculumObjective,
        LearningObjective as LearningObjective,
        MeasureObjective as MeasureObjective,
        value_of_scores as value_of_scores,
    )

export_lazily(globals())
