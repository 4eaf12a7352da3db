"""The numbers that decide when environments are compiled, and how large searches are by default."""

from __future__ import annotations

from typing import Final

from envgraph.code import dataclass


@dataclass(frozen=True, slots=True)
class CompiledCosts:
    """When the live engine, Python and compiled programs take turns; `python -m benchmarks compiled` measures it.

    No number changes a table. `breadth`, `width` and `horizon` change which plans are found.
    """

    few_states: int = 2_000  # that the live engine visits in less time than it takes to load a compiled program
    few_outcomes: int = 20_000  # of actions, as for `few_states`
    cached_outcomes: int = 5_000  # as `few_outcomes`, if machine code of the program is cached: loading it takes 0.3 s
    picture_outcomes: int = 5  # that the live engine computes in the time that it takes to draw a state
    states_of_program: int = 5  # that a program visits in the time in which the live engine computes an outcome
    live_outcomes: int = 50_000  # that the live engine computes in the time that it takes to compile a program
    searches_of_python: int = 20  # small searches before `Plans` compiles: together at most about 20 s
    programs: int = 16  # kept; generating one takes as long as a hundred small searches
    first: int = 1_024  # states and outcomes for which there is space at first
    first_keys: int = 4_096  # keys of a learner for which there is space at first
    spare: int = 64  # created objects for which states have space by default
    progress_interval: int = 100_000  # outcomes between two reports of progress
    breadth: int = 20_000  # states visited breadth-first by default
    width: int = 500  # states that a beam keeps of a layer by default
    horizon: int = 1_000  # steps of a beam in an environment without a time limit
    most_matches: int = 255  # of a guide; more are observed as this number
    text_results: int = 1_000_000  # of an operation on strings for all operands, which are computed in two seconds


COSTS: Final = CompiledCosts()
