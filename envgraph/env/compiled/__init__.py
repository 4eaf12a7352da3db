"""Compile behaviours into programs over flat arrays, which step many environments at once.

A program is about a hundred times as fast as the live engine. It needs rules and queries with known bounds, and uses
the engine's search plans, with numbers in place of objects. A member of a family is a row of data, a state another row.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.env.compiled.batches._batch import CompiledBatch as CompiledBatch
    from envgraph.env.compiled.batches._environments import (
        CompiledEnv as CompiledEnv,
        CompiledVectorEnv as CompiledVectorEnv,
        StreamMode as StreamMode,
    )
    from envgraph.env.compiled.batches._program_player import ProgramPlayer as ProgramPlayer
    from envgraph.env.compiled.export._export_package import (
        check_package_name as check_package_name,
        export_package as export_package,
        program_files as program_files,
    )
    from envgraph.env.compiled.kernels._loading import has_numba as has_numba, load_functions as load_functions
    from envgraph.env.compiled.layout._batch_arrays import generator_states as generator_states
    from envgraph.env.compiled.layout._member_data import MemberEngines as MemberEngines
    from envgraph.env.compiled.layout._model_changes import unaffected_patterns as unaffected_patterns
    from envgraph.env.compiled.layout._not_compiled import NotCompiled as NotCompiled
    from envgraph.env.compiled.learning._learner import Learner as Learner, LearningRates as LearningRates
    from envgraph.env.compiled.programs._compiled_program import (
        CompiledProgram as CompiledProgram,
        compile_for_model as compile_for_model,
        program_of as program_of,
        set_generator_state as set_generator_state,
    )
    from envgraph.env.compiled.programs._explanation import explain_compilation as explain_compilation
    from envgraph.env.compiled.visiting._enumeration import (
        TableBuilder as TableBuilder,
        enumerate_states as enumerate_states,
        explore_fast as explore_fast,
    )
    from envgraph.env.compiled.visiting._exploration import explore_compiled as explore_compiled
    from envgraph.env.compiled.visiting._plan_search import (
        ActionPlan as ActionPlan,
        Plans as Plans,
        PlanSearch as PlanSearch,
        guide_calls as guide_calls,
        with_guide_counts as with_guide_counts,
    )

export_lazily(globals())
