"""Compile behaviours into programs over flat arrays, which step many environments at once.

A program is about a hundred times as fast as the live engine. It needs rules and queries with known bounds, and uses
the engine's search plans, with numbers in place of objects. A member of a family is a row of data, a state another row.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.env.compiled._batch import Batch as Batch
    from envgraph.env.compiled._changes import unaffected as unaffected
    from envgraph.env.compiled._enumeration import (
        Tables as Tables,
        enumerated as enumerated,
        explored as explored,
    )
    from envgraph.env.compiled._environments import (
        CompiledEnv as CompiledEnv,
        CompiledVectorEnv as CompiledVectorEnv,
        Streams as Streams,
    )
    from envgraph.env.compiled._explanation import explanation as explanation
    from envgraph.env.compiled._export import (
        check_package as check_package,
        export as export,
        program_files as program_files,
    )
    from envgraph.env.compiled._learner import Learner as Learner, Rates as Rates
    from envgraph.env.compiled._member import Borrowed as Borrowed
    from envgraph.env.compiled._native import functions as functions, has_numba as has_numba
    from envgraph.env.compiled._planning import (
        Plan as Plan,
        Plans as Plans,
        PlanSearch as PlanSearch,
        guided as guided,
    )
    from envgraph.env.compiled._player import Player as Player
    from envgraph.env.compiled._program import (
        Program as Program,
        program_of as program_of,
        program_over as program_over,
        set_stream as set_stream,
    )
    from envgraph.env.compiled._refused import NotCompiled as NotCompiled
    from envgraph.env.compiled._world import streams as streams

later(globals())
