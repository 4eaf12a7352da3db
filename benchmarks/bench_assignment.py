"""Assign features to classes (CRA): moves a second and the index, beside an annealer written by hand.

    python -m benchmarks assignment

Both anneal a random program of the size of each input of the contest, with the same moves and temperatures. What is
published for the contest's own inputs is not about the same programs: it says what that size gave. With
`ENVGRAPH_CRA=DIRECTORY` the inputs are read from there (`TTC_InputRDG_A.xmi` ...), and the indices compare.
Processor time; one run each.
"""

from __future__ import annotations

import os
from pathlib import Path
from time import process_time
from typing import NamedTuple

from benchmarks._assignment import SIZES, ByHand, Program, fill, problem
from envgraph.graph import Model
from envgraph.lang import bundled_domain, open_workspace
from envgraph.rewrite import Engine
from envgraph.search import Annealing, Optimum, optimise

MOVES = ("introduce", "assign", "move", "extract", "join")
SHARE = 1 / 3
"""Of the moves a second by hand."""


class Sizes(NamedTuple):
    """The inputs of the contest, by name, and the moves for each."""

    inputs: tuple[str, ...]
    moves: int


FULL = Sizes(tuple(SIZES), 10_000)
QUICK = Sizes(("A", "B"), 50)


def main(sizes: Sizes) -> None:
    """Print the figures."""
    folder = os.environ.get("ENVGRAPH_CRA")
    programs = "the contest's inputs" if folder else "random programs; MOMoT's indices are of others"
    print(f"{sizes.moves} moves; {programs}")
    print("input  features  dependencies  moves/s  by hand  share   index  by hand  MOMoT")
    shares = []
    anneal(drawn(problem(SIZES["A"])), 1)  # imports what it needs
    for name in sizes.inputs:
        size = SIZES[name]
        if folder:
            engine, program = contest(Path(folder), name)
        else:
            program = problem(size)
            engine = drawn(program)
        started = process_time()
        found = anneal(engine, sizes.moves)
        middle = process_time()
        best = by_hand(program, sizes.moves)
        ours, hand = (sizes.moves / seconds for seconds in (middle - started, process_time() - middle))
        shares.append(ours / hand)
        features, links = program.methods + program.attributes, len(program.data) + len(program.functional)
        print(
            f"{name:5}  {features:8}  {links:12}  {ours:7.0f}  {hand:7.0f}  {ours / hand:5.2f}  "
            f"{found.best.values['craIndex']:6.2f}  {best:7.2f}  {size.published:5.2f}"
        )
    print("met" if min(shares) >= SHARE else f"missed: the least share is {min(shares):.2f}, not {SHARE:.2f}")


def anneal(engine: Engine, moves: int) -> Optimum:
    """Anneal the index of the engine's model from its present state."""
    return optimise(
        engine, MOVES, maximise="craIndex", forbid=["unassigned"], strategy=Annealing(), steps=moves, seed=1
    )


def by_hand(program: Program, moves: int) -> float:
    """The best index of an annealing by hand."""
    search = ByHand(program, 1)
    best = search.index
    for number in range(moves):
        if search.step(0.01 ** (number / moves)):
            best = max(best, search.index)
    assert abs(search.index - search.computed()) < 1e-6, "the index by hand follows"
    return best


def drawn(program: Program) -> Engine:
    """An engine of the bundled domain on a program."""
    workspace = open_workspace(str(bundled_domain("assignment") / "assignment.rules"))
    workspace.raise_errors()
    assert workspace.metamodel is not None
    model = Model(workspace.metamodel)
    fill(model, program)
    return workspace.engine_on(model)


def contest(folder: Path, name: str) -> tuple[Engine, Program]:
    """An input of the contest, and what it says."""
    rules = str(bundled_domain("assignment") / "assignment.rules")
    workspace = open_workspace(rules, str(folder / f"TTC_InputRDG_{name}.xmi"))
    engine = workspace.engine()
    methods, attributes = engine.model.nodes("Method"), engine.model.nodes("Attribute")
    number = {feature.id: place for place, feature in enumerate([*methods, *attributes])}
    data = frozenset((number[m.id], number[a.id]) for m in methods for a in m.dataDependency)
    functional = frozenset((number[m.id], number[n.id]) for m in methods for n in m.functionalDependency)
    return engine, Program(len(methods), len(attributes), data, functional)
