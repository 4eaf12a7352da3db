"""Varro's mutual exclusion, the short transformation sequence: 5N - 1 rewrites of a ring of N processes.

Published by G. Varro, A. Schurr, D. Varro ("Benchmarking for Graph Transformation", VL/HCC 2005); the rules mean what
those of the samples of GrGen.NET do.
"""

from __future__ import annotations

from collections.abc import Callable

from benchmarks._clips import Clips
from benchmarks._data import workspace
from envgraph.graph import Model
from envgraph.rewrite import Engine

WATCHED = ("newProcess", "request", "take", "release", "give")
PHASES = ("grow", "mount", "request", "pass")
DOMAIN = workspace("mutex")

Rewrite = Callable[[str], object]
"""Applies a rule once, at a match that is drawn."""


def ring(watched: bool = True) -> Engine:
    """An engine on two processes in a ring; the rules that fire more than once are watched."""
    assert DOMAIN.metamodel is not None
    model = Model(DOMAIN.metamodel, "mutex")
    engine = Engine(model)
    engine.add(*DOMAIN.definitions)
    first, second = model.create("Process"), model.create("Process")
    first.next.append(second)
    second.next.append(first)
    if watched:
        engine.watch(*WATCHED)
    return engine


def rules(phase: str, size: int) -> list[str]:
    """The rules that a phase applies, in order."""
    match phase:
        case "grow":
            return ["newProcess"] * (size - 2)
        case "mount":
            return ["mount"]
        case "request":
            return ["request"] * size
        case _:
            return ["take", "release", "give"] * size


def prepared(engine: Engine) -> Rewrite:
    """The unchecked functions of rules."""
    once = {name: engine.prepare(name).once for name in (*WATCHED, "mount")}
    rng = engine.rng
    return lambda rule: once[rule](rng)


def facade(engine: Engine) -> Rewrite:
    """The facade, with everything that people get from it."""
    return engine.apply


# --- the same in CLIPS: a fact a link, and a fact for the phase

CONSTRUCTS = """
(deftemplate phase (slot is)) (deftemplate process (slot p)) (deftemplate resource (slot r))
(deftemplate next (slot from) (slot to)) (deftemplate request (slot p) (slot r))
(deftemplate token (slot r) (slot p)) (deftemplate heldBy (slot r) (slot p)) (deftemplate release (slot r) (slot p))
(defglobal ?*last* = 1)
(deffacts ring (process (p 0)) (process (p 1)) (next (from 0) (to 1)) (next (from 1) (to 0)))
(defrule newProcess (phase (is grow)) ?link <- (next (from ?left) (to ?right)) =>
    (bind ?*last* (+ ?*last* 1)) (retract ?link) (assert (process (p ?*last*)))
    (assert (next (from ?left) (to ?*last*))) (assert (next (from ?*last*) (to ?right))))
(defrule mount (phase (is mount)) (process (p ?p)) => (assert (resource (r -1))) (assert (token (r -1) (p ?p))))
(defrule request (phase (is request)) (process (p ?p)) (resource (r ?r))
    (not (heldBy (r ?r) (p ?p))) (not (request (p ?p))) => (assert (request (p ?p) (r ?r))))
(defrule take (phase (is pass)) ?token <- (token (r ?r) (p ?p)) ?request <- (request (p ?p) (r ?r)) =>
    (retract ?token ?request) (assert (heldBy (r ?r) (p ?p))))
(defrule release (phase (is pass)) ?held <- (heldBy (r ?r) (p ?p)) (not (request (p ?p))) =>
    (retract ?held) (assert (release (r ?r) (p ?p))))
(defrule give (phase (is pass)) ?release <- (release (r ?r) (p ?left)) (next (from ?left) (to ?right)) =>
    (retract ?release) (assert (token (r ?r) (p ?right))))
"""


def clips_sequence(size: int) -> tuple[Callable[[], int], Clips]:
    """A function that does the whole sequence in CLIPS and tells the number of rewrites."""
    environment = Clips(CONSTRUCTS)

    def run() -> int:
        done = 0
        for phase in PHASES:
            fact = environment.add("phase", **{"is": environment.symbol(phase)})
            done += environment.run(len(rules(phase, size)))
            fact.retract()
        return done

    return run, environment
