"""Search over models."""

from envgraph.search._diversity import BinnedEntropy, FamilyMeasure, Gini, Swaps, Variance
from envgraph.search._selection import (
    ElitistParents,
    ExhaustiveSelection,
    HillClimbing,
    ParentSelection,
    RandomParents,
    SimulatedAnnealing,
    SurvivorSelection,
    TournamentParents,
    acceptance,
)
from envgraph.search._store import Generation, Individual, RunStore, Trace

__all__ = [
    "BinnedEntropy",
    "ElitistParents",
    "ExhaustiveSelection",
    "FamilyMeasure",
    "Generation",
    "Gini",
    "HillClimbing",
    "Individual",
    "ParentSelection",
    "RandomParents",
    "RunStore",
    "SimulatedAnnealing",
    "SurvivorSelection",
    "Swaps",
    "TournamentParents",
    "Trace",
    "Variance",
    "acceptance",
]
