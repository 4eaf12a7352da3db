"""Environments as programs over flat arrays: many at once, a hundred times as fast as the live engine.

A behaviour whose rules and queries have known bounds becomes one program: the plans of the engine, written in a second
dialect, with numbers in place of objects. A member of a family is a row of data, a state another row.
"""

from envgraph.env.compiled import _kernels as kernels
from envgraph.env.compiled import _values as values
from envgraph.env.compiled._batch import Batch
from envgraph.env.compiled._changes import unaffected
from envgraph.env.compiled._enumeration import Tables, enumerated, explored
from envgraph.env.compiled._environments import CompiledEnv, CompiledVectorEnv, Streams
from envgraph.env.compiled._explanation import explanation
from envgraph.env.compiled._export import check_package, export, program_files
from envgraph.env.compiled._learner import Learner, Rates
from envgraph.env.compiled._member import Borrowed
from envgraph.env.compiled._native import functions, has_numba
from envgraph.env.compiled._planning import MOST_STATES, Plan, Plans, PlanSearch, guided
from envgraph.env.compiled._player import Player
from envgraph.env.compiled._program import Program, program_of, program_over, set_stream
from envgraph.env.compiled._refused import NotCompiled
from envgraph.env.compiled._world import streams

__all__ = [
    "MOST_STATES",
    "Batch",
    "Borrowed",
    "CompiledEnv",
    "CompiledVectorEnv",
    "Learner",
    "NotCompiled",
    "Plan",
    "PlanSearch",
    "Plans",
    "Player",
    "Program",
    "Rates",
    "Streams",
    "Tables",
    "check_package",
    "enumerated",
    "explanation",
    "explored",
    "export",
    "functions",
    "guided",
    "has_numba",
    "kernels",
    "program_files",
    "program_of",
    "program_over",
    "set_stream",
    "streams",
    "unaffected",
    "values",
]
