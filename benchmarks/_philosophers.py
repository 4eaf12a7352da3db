"""The dining philosophers, as the examples of Henshin have them: 3^n states, 7n/9 of them times 3^n transitions.

A philosopher takes the left or the right fork, if it is free, and lays both down when holding both. A fork is free or
held by one of its two neighbours, independently of all others.
"""

from __future__ import annotations

from benchmarks._clips import Clips
from benchmarks._data import workspace
from envgraph.graph import Model
from envgraph.rewrite import Engine

DOMAIN = workspace("philosophers")
RULES = ("takeLeft", "takeRight", "layDown")


def table(size: int) -> Engine:
    """An engine on a table of so many philosophers, at least two, none of whom holds a fork."""
    assert DOMAIN.metamodel is not None
    model = Model(DOMAIN.metamodel, "philosophers")
    engine = Engine(model)
    engine.add(*DOMAIN.definitions)
    forks = [model.create("Fork") for _ in range(size)]
    for place in range(size):
        model.create("Philosopher", left=forks[place], right=forks[(place + 1) % size])
    return engine


# --- the same in CLIPS: a fact a state, a symbol a fork; a fact that is there already is not asserted again

CONSTRUCTS = """
(deftemplate state (multislot forks))
(defrule takeLeft (state (forks $?before free $?after)) => (assert (state (forks $?before left $?after))))
(defrule takeRight (state (forks $?before free $?after)) => (assert (state (forks $?before right $?after))))
(defrule layDown (state (forks $?before left right $?after)) =>
    (assert (state (forks $?before free free $?after))))
(defrule layDownLast (state (forks right $?between left)) => (assert (state (forks free $?between free))))
"""


def clips_table(size: int) -> Clips:
    """An environment in which all forks are free."""
    environment = Clips(CONSTRUCTS)
    environment.add("state", forks=[environment.symbol("free")] * size)
    return environment
