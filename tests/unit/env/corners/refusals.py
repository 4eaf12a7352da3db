"""Corners of `on refused`: rules that the model refuses in actions, clauses, resets and units."""

from __future__ import annotations

from tests.unit.env.corners.yard import MODEL, Yard

RULES = """
rule drop(i : Item) { lhs { i : Item; } modify { delete i; } }
rule dropAny { lhs { i : Item; j : Item; check i.id < j.id; }
    modify { set j.at = none; delete i; set j.weight += 1.0; } }
rule loosen { lhs { i : Item -at-> s : Spot; } modify { delete i -at-> s; } }
rule join(m : Man, s : Spot) { lhs { m : Man; s : Spot; } modify { create m -at-> s; set s.n += 1; } }
rule leave(m : Man) { lhs { m -at-> s : Spot; } modify { delete m -at-> s; } }
rule like(m : Man) { lhs { i : Item; } modify { create m -likes-> i; set m.hunger += 1; } }
rule dislike(m : Man) { lhs { m -likes-> i : Item; } modify { delete m -likes-> i; } }
rule make { lhs { y : Yard; m : Man; } modify { create y -items-> i : Item { id = 9 }; create m -likes-> i;
    set m.power += 0.25; } }
rule pack { lhs { b : Box; c : Box; } modify { move b to c.inner; set c.size += 1; } }
rule stand(m : Man) { lhs { m : Man; neg Man.at(m, _); s : Spot; } modify { set m.at = s; } }
"""

QUERIES = """
pattern lying(i : Item) { Item.at(i, _); }
pattern item(i : Item) { Item(i); }
pattern crowded(s : Spot) { n == count Spot.men(s, _); check(n > 1); Spot(s); }
pattern hungry(m : Man) { Man.hunger(m, n); check(n > 5); }
"""

OBSERVED = """
observe m.at among Spot or none for m : Man
observe count find item(_) up to 9
observe count find lying(_) up to 5
observe m.hunger in 0..9 for m : Man
"""

CORNERS = {
    "actions that are refused": Yard(
        RULES,
        f"""
        action drop(i : Item) = drop(i) reward 1 else reward -0.5
        action any = 0.5: dropAny() | 0.3: loosen() reward 0.25 else reward -0.125
        action join(m : Man, s : Spot) = join(m, s)
        action leave(m : Man) = leave(m)
        action pack = 0.4: pack() | 0.2: nothing() | 0.4: make() reward 0.1
        on refused reward -1
        on find crowded(_) reward 0.3
        on refused reward adam.power * -0.1
        {OBSERVED}
        """,
        QUERIES,
    ),
    "clauses that are refused, and how the episode ends": Yard(
        RULES,
        f"""
        action join(m : Man, s : Spot) = join(m, s) reward 2
        action drop = dropAny()
        action rest = nothing()
        on refused reward adam.hunger terminate failure
        each step apply 0.2: like(adam) | 0.1: dropAny()
        each step reward 0.01 apply 0.3: make()
        on find lying(i) reward 0.1 apply 0.1: drop(i) | 0.2: loosen()
        on find crowded(s) apply join(adam, s) weight s.f
        on neg find crowded(_) terminate success
        {OBSERVED}
        """,
        QUERIES,
    ),
    "a refusal that succeeds or cuts off": Yard(
        RULES,
        f"""
        action join(m : Man, s : Spot) = join(m, s)
        action leave(m : Man) = leave(m)
        action like(m : Man) = like(m)
        on refused truncate
        on find crowded(s) apply drop(i0)
        on find crowded(_) truncate
        on find hungry(_) terminate failure
        on refused terminate success reward 0.5
        {OBSERVED}
        """,
        QUERIES,
        head="i0 : Item",
    ),
    "few states with refusals": Yard(
        """
        rule enter(m : Man, s : Spot) { lhs { m : Man; s : Spot; } modify { create m -at-> s; } }
        rule leave(m : Man) { lhs { m -at-> s : Spot; } modify { delete m -at-> s; } }
        unit swap(m : Man, s : Spot) { leave(m); enter(m, s); enter(m, s.east); }
        """,
        """
        action enter = 0.5: enter(adam, s1) | 0.3: enter(adam, s3) reward 2 else reward -1
        action swap = swap(adam, s1)
        action leave = leave(adam)
        on reset apply 0.5: enter(adam, s3)
        each step apply 0.2: enter(eve, s3)
        on find at(adam, s3) terminate success
        on find at(adam, s1) apply 0.5: enter(adam, s3)
        on refused reward -0.25
        on find at(m, s1) reward 0.5
        observe m.at among Spot or none for m : Man
        """,
        "pattern at(m : Man, s : Spot) { Man.at(m, s); }",
        head="adam : Man, eve : Man, s1 : Spot, s3 : Spot",
        members=1,
    ),
    "starts that are refused": Yard(
        RULES,
        f"""
        action loosen = loosen()
        action drop = dropAny() else reward -1
        on reset apply 0.6: dropAny() | 0.2: make()
        on reset find lying(i) apply 0.5: drop(i) | 0.5: loosen()
        on reset find item(i) apply drop(i) weight i.weight
        on reset apply pack()
        on refused nothing()
        {OBSERVED}
        """,
        QUERIES,
    ),
    "units that are refused": Yard(
        RULES
        + """
        unit all(m : Man) { leave(m); dropAny(); like(m); }
        unit some(m : Man) { try { leave(m); } make() | loosen(); like(m); }
        unit one(i : Item) { loosen(); drop(i); }
        """,
        f"""
        action all(m : Man) = all(m) reward 1 else reward -1
        action some(m : Man) = 0.7: some(m) | 0.3: like(m) reward 0.5
        action one(i : Item) = one(i)
        action stand(m : Man) = stand(m)
        each step apply 0.1: some(adam)
        on find lying(i) apply 0.05: one(i)
        on refused reward -0.25
        {OBSERVED}
        """,
        QUERIES,
    ),
} | {
    f"agents that are refused, {how}": Yard(
        RULES + "@semantics(spo) rule kill(i : Item) { lhs { i : Item; } modify { delete i; } }",
        f"""
        {together}
        agent m : Man {{
            action join(s : Spot) = join(m, s) reward 1 else reward -1
            action leave = leave(m)
            action like = like(m) reward 0.5
            each step apply 0.1: like(m)
            on find crowded(s) apply 0.1: join(m, s)
            on refused reward m.hunger * -0.5
            observe m.hunger in 0..9
        }}
        agent i : Heavy {{
            action join(s : Spot) = 0.5: drop(i) reward i.weight else reward -0.1
            action leave = loosen()
            action kill = 0.1: kill(i)
            {own}
            observe find lying(i)
        }}
        each step apply 0.1: make()
        on find lying(j) reward 0.01 apply 0.02: drop(j)
        {shared}
        observe count find item(_) up to 9
        """,
        QUERIES,
        head="",
        members=members,
        model=MODEL.replace('seth : Man { name = "seth" },', ""),
    )
    for how, together, own, shared, members in (
        ("which take turns", "", "on refused truncate", "on refused reward -0.125", 2),
        ("which act together", "agents together", "on refused terminate failure", "on refused reward -0.125", 1),
        ("one block of which says nothing", "", "", "", 1),
        ("all of whose blocks say something", "agents together", "on refused nothing()", "", 1),
    )
}
