"""Sierpinski triangles: each triangle becomes three, level by level; (3^(k+1) + 3) / 2 objects after level k.

The rules mean what those of the samples of GrGen.NET do.
"""

from __future__ import annotations

from benchmarks._clips import Clips
from benchmarks._data import workspace
from envgraph.graph import Model
from envgraph.rewrite import Engine

DOMAIN = workspace("sierpinski")


def triangle(watched: bool = False) -> Engine:
    """An engine on one triangle."""
    assert DOMAIN.metamodel is not None
    model = Model(DOMAIN.metamodel, "sierpinski")
    engine = Engine(model)
    engine.add(*DOMAIN.definitions)
    corners = [model.create(cls) for cls in "ABC"]
    for corner, other in zip(corners, (*corners[1:], corners[0]), strict=True):
        corner.e0.append(other)
    if watched:
        engine.watch("split0", "split1")
    return engine


def split_all(engine: Engine, level: int) -> int:
    """Split every triangle, from the prepared rule; levels count from 1. Returns how many there were."""
    rule = engine.prepare(f"split{(level - 1) % 2}")
    rows = rule.all_rows()
    for row in rows:
        rule.fire(row)
    return len(rows)


def objects(level: int) -> int:
    """How many objects there are after a level."""
    return int((3 ** (level + 1) + 3) // 2)


# --- the same in CLIPS: a fact for each class of an object, and for each link

CONSTRUCTS = """
(deftemplate level (slot kind)) (deftemplate link (slot kind) (slot from) (slot to))
(deftemplate a (slot of)) (deftemplate b (slot of)) (deftemplate c (slot of))
(defglobal ?*last* = 2)
(deffacts triangle (a (of 0)) (b (of 1)) (c (of 2))
    (link (kind 0) (from 0) (to 1)) (link (kind 0) (from 1) (to 2)) (link (kind 0) (from 2) (to 0)))
(defrule split (level (kind ?k))
    ?ab <- (link (kind ?k) (from ?a) (to ?b)) (a (of ?a)) (b (of ?b))
    ?bc <- (link (kind ?k) (from ?b) (to ?c)) (c (of ?c))
    ?ca <- (link (kind ?k) (from ?c) (to ?a)) =>
    (retract ?ab ?bc ?ca)
    (bind ?x (+ ?*last* 1)) (bind ?y (+ ?*last* 2)) (bind ?z (+ ?*last* 3)) (bind ?*last* ?z) (bind ?o (- 1 ?k))
    (assert (a (of ?x)) (b (of ?x)) (b (of ?y)) (c (of ?y)) (c (of ?z)) (a (of ?z)))
    (assert (link (kind ?o) (from ?a) (to ?x)) (link (kind ?o) (from ?x) (to ?b)) (link (kind ?o) (from ?b) (to ?y))
        (link (kind ?o) (from ?y) (to ?c)) (link (kind ?o) (from ?c) (to ?z)) (link (kind ?o) (from ?z) (to ?a))
        (link (kind ?o) (from ?x) (to ?z)) (link (kind ?o) (from ?z) (to ?y)) (link (kind ?o) (from ?y) (to ?x))))
"""


def clips_levels(levels: int) -> tuple[int, Clips]:
    """All levels in CLIPS: how many triangles were split."""
    environment, done = Clips(CONSTRUCTS), 0
    for level in range(levels):
        fact = environment.add("level", kind=level % 2)
        done += environment.run()
        fact.retract()
    return done, environment
