"""Other tools on the railways of the Train Benchmark: CLIPS, DuckDB, SQLite, and VF2 of networkx and rustworkx.

Each gets the same plain data, and for edits the same elementary changes. A tool that is not installed is `None` in its
module's place.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol

import networkx
import numpy

from benchmarks._peers import peer
from benchmarks._railway import OWNERS, POSITIONS, Railway, reference
from envgraph.graph import Model
from envgraph.metamodel import Metamodel
from tests.facts import ClassFact, Fact, LinkFact, Notified, ValueFact

clips, duckdb, rustworkx = map(peer, ("clips", "duckdb", "rustworkx"))


# --- elementary changes

Record = tuple[str, tuple[int, ...]]
"""A fact as a table or template and its columns: `("Segment", (7,))`, `("length", (7, 12))`, `("entry", (3, 1))`."""

Change = tuple[bool, Record]
"""A record and whether it is added, not removed."""

ATTRIBUTES = ("active", "length", "currentPosition", "position", "signal")
REFERENCES = tuple(
    name for name in OWNERS if name not in (*ATTRIBUTES, "id", "routes", "regions", "elements", "sensors")
)
CLASSES = ("Region", "Route", "Sensor", "Segment", "Switch", "SwitchPosition", "Semaphore")
SIGNALS = ("FAILURE", "STOP", "GO")


def as_number(name: str, value: object) -> int:
    """A value of an attribute as a number; literals count from 0."""
    if isinstance(value, str):
        return (SIGNALS if name == "signal" else POSITIONS).index(value)
    return int(value)  # type: ignore[call-overload, no-any-return]


def records(railway: Railway) -> Iterator[Record]:
    """All that the six queries may ask about; what contains what is left out."""
    for number, cls in enumerate(railway.classes, 1):
        yield cls, (number,)
    for name, values in railway.values.items():
        for number, value in values:
            yield name, (number, as_number(name, value))
    for name in REFERENCES:
        for edge in railway.edges.get(name, ()):
            yield name, edge


class Recorder:
    """Listens to a model and writes down its changes as records."""

    def __init__(self, model: Model) -> None:
        self.changes: list[Change] = []
        self._names = dict(_link_names(model.metamodel))
        Notified(model, self)

    def inserted(self, fact: Fact) -> None:
        self._note(True, fact)

    def removing(self, fact: Fact) -> None:
        self._note(False, fact)

    def restored(self) -> None:
        raise AssertionError("what is undone is not recorded")

    def take(self) -> list[Change]:
        """The changes since the last time."""
        taken, self.changes = self.changes, []
        return taken

    def _note(self, added: bool, fact: Fact) -> None:
        match fact:
            case ClassFact(cls, node):
                self.changes.append((added, (cls, (node,))))
            case ValueFact(attribute, node, value) if attribute.name in ATTRIBUTES:
                self.changes.append((added, (attribute.name, (node, as_number(attribute.name, value)))))
            case LinkFact(link, source, target) if link.index in self._names:
                name, turned = self._names[link.index]
                self.changes.append((added, (name, (target, source) if turned else (source, target))))


def _link_names(metamodel: Metamodel) -> Iterator[tuple[int, tuple[str, bool]]]:
    """By number of a reference, what it is called here and whether it goes the other way round."""
    for name in REFERENCES:
        found = reference(metamodel, name)
        yield found.index, (name, False)
        opposite = metamodel.opposite(found)
        if opposite:
            yield opposite.index, (name, True)


# --- CLIPS: a Rete network in C

CLIPS_RULES = {
    "posLength": "(length (of ?segment) (is ?l&:(<= ?l 0)))",
    "switchMonitored": "(Switch (of ?sw)) (not (monitoredBy (of ?sw)))",
    "routeSensor": """
        (follows (of ?route) (is ?swP)) (target (of ?swP) (is ?sw)) (monitoredBy (of ?sw) (is ?sensor))
        (not (requires (of ?route) (is ?sensor)))""",
    "switchSet": """
        (active (of ?route) (is 1)) (entry (of ?route) (is ?semaphore)) (signal (of ?semaphore) (is 2))
        (follows (of ?route) (is ?swP)) (target (of ?swP) (is ?sw)) (position (of ?swP) (is ?p))
        (currentPosition (of ?sw) (is ?c&~?p))""",
    "connectedSegments": " ".join(
        f"(connectsTo (of ?s{i - 1}) (is ?s{i})) (Segment (of ?s{i})) (monitoredBy (of ?s{i}) (is ?sensor))"
        if i > 1
        else "(Segment (of ?s1)) (monitoredBy (of ?s1) (is ?sensor))"
        for i in range(1, 7)
    ),
    "semaphoreNeighbor": """
        (exit (of ?r1) (is ?semaphore)) (requires (of ?r1) (is ?se1)) (monitoredBy (of ?te1) (is ?se1))
        (connectsTo (of ?te1) (is ?te2)) (monitoredBy (of ?te2) (is ?se2)) (requires (of ?r2&~?r1) (is ?se2))
        (not (entry (of ?r2) (is ?semaphore)))""",
}


class Clips:
    """An environment of CLIPS with the six queries as rules that do nothing: their activations are the matches."""

    def __init__(self) -> None:
        self.environment = environment = clips.Environment()
        for name in CLASSES:
            environment.build(f"(deftemplate {name} (slot of (type INTEGER)))")
        for name in (*ATTRIBUTES, *REFERENCES):
            environment.build(f"(deftemplate {name} (slot of (type INTEGER)) (slot is (type INTEGER)))")
        for name, left in CLIPS_RULES.items():
            environment.build(f"(defrule {name} {left} =>)")
        self.templates = {name: environment.find_template(name) for name in (*CLASSES, *ATTRIBUTES, *REFERENCES)}
        self.facts: dict[Record, Any] = {}

    def load(self, found: Iterable[Record]) -> None:
        """Assert all records; the network is built on the way."""
        for record in found:
            self.apply((True, record))

    def apply(self, change: Change) -> None:
        """Assert or retract."""
        added, record = change
        if added:
            name, columns = record
            self.facts[record] = self.templates[name].assert_fact(**dict(zip(("of", "is"), columns, strict=False)))
        else:
            self.facts.pop(record).retract()

    def counts(self) -> dict[str, int]:
        """Number of matches of each query."""
        found = dict.fromkeys(CLIPS_RULES, 0)
        for activation in self.environment.activations():
            found[activation.name] += 1
        return found


# --- databases

SQL = {
    "posLength": 'SELECT "of" FROM length WHERE "is" <= 0',
    "switchMonitored": """
        SELECT sw."of" FROM Switch sw WHERE NOT EXISTS (SELECT 1 FROM monitoredBy m WHERE m."of" = sw."of")""",
    "routeSensor": """
        SELECT f."of", m."is", t."of", t."is"
        FROM follows f JOIN target t ON t."of" = f."is" JOIN monitoredBy m ON m."of" = t."is"
        WHERE NOT EXISTS (SELECT 1 FROM requires r WHERE r."of" = f."of" AND r."is" = m."is")""",
    "switchSet": """
        SELECT e."is", e."of", t."of", t."is"
        FROM entry e JOIN active a ON a."of" = e."of" JOIN signal s ON s."of" = e."is"
        JOIN follows f ON f."of" = e."of" JOIN target t ON t."of" = f."is"
        JOIN position p ON p."of" = t."of" JOIN currentPosition c ON c."of" = t."is"
        WHERE a."is" = 1 AND s."is" = 2 AND p."is" <> c."is\"""",
    "connectedSegments": """
        SELECT m1."is", m1."of", m2."of", m3."of", m4."of", m5."of", m6."of" FROM monitoredBy m1 """
    + " ".join(
        f'JOIN connectsTo c{i} ON c{i}."of" = m{i}."of" '
        f'JOIN monitoredBy m{i + 1} ON m{i + 1}."of" = c{i}."is" AND m{i + 1}."is" = m1."is"'
        for i in range(1, 6)
    )
    + " "
    + " ".join(f'JOIN Segment s{i} ON s{i}."of" = m{i}."of"' for i in range(1, 7)),
    "semaphoreNeighbor": """
        SELECT x."is", q1."of", q2."of", q1."is", q2."is", m1."of", m2."of"
        FROM exit x JOIN requires q1 ON q1."of" = x."of" JOIN monitoredBy m1 ON m1."is" = q1."is"
        JOIN connectsTo c ON c."of" = m1."of" JOIN monitoredBy m2 ON m2."of" = c."is"
        JOIN requires q2 ON q2."is" = m2."is" AND q2."of" <> q1."of"
        WHERE NOT EXISTS (SELECT 1 FROM entry e WHERE e."of" = q2."of" AND e."is" = x."is")""",
}


class Database(Protocol):
    """What the two databases have in common."""

    def load(self, railway: Railway) -> None:
        """Make and fill the tables, a table for each class and feature, and what indexes there are."""

    def rows(self, query: str) -> Sequence[tuple[Any, ...]]:
        """The matches of one of the six."""


def tables(railway: Railway) -> dict[str, list[tuple[int, ...]]]:
    """The records by table."""
    found: dict[str, list[tuple[int, ...]]] = {name: [] for name in (*CLASSES, *ATTRIBUTES, *REFERENCES)}
    for name, columns in records(railway):
        found[name].append(columns)
    return found


class SQLite:
    """A database in memory, with an index for each direction of each link."""

    def __init__(self) -> None:
        self.connection = sqlite3.connect(":memory:")

    def load(self, railway: Railway) -> None:
        execute = self.connection.execute
        for name, rows in tables(railway).items():
            if name in CLASSES:
                execute(f'CREATE TABLE {name} ("of" INTEGER PRIMARY KEY)')
                self.connection.executemany(f"INSERT INTO {name} VALUES (?)", rows)
            elif name in ATTRIBUTES:
                execute(f'CREATE TABLE {name} ("of" INTEGER PRIMARY KEY, "is" INTEGER)')
                self.connection.executemany(f"INSERT INTO {name} VALUES (?, ?)", rows)
            else:
                execute(f'CREATE TABLE {name} ("of" INTEGER, "is" INTEGER, PRIMARY KEY ("of", "is")) WITHOUT ROWID')
                self.connection.executemany(f"INSERT INTO {name} VALUES (?, ?)", rows)
                execute(f'CREATE INDEX {name}_back ON {name} ("is", "of")')
        execute("ANALYZE")
        self.connection.commit()

    def rows(self, query: str) -> Sequence[tuple[Any, ...]]:
        return self.connection.execute(SQL[query]).fetchall()


class DuckDB:
    """A database in memory, on one thread, filled from NumPy columns."""

    def __init__(self) -> None:
        self.connection = duckdb.connect(":memory:", config={"threads": 1})

    def load(self, railway: Railway) -> None:
        for name, rows in tables(railway).items():
            columns = numpy.array(rows, dtype=numpy.int32).reshape(len(rows), 1 if name in CLASSES else 2)
            data = {key: columns[:, k].copy() for k, key in enumerate(("of", "is")[: columns.shape[1]])}
            self.connection.register("data", data)
            self.connection.execute(f"CREATE TABLE {name} AS SELECT * FROM data")
            self.connection.unregister("data")

    def rows(self, query: str) -> Sequence[tuple[Any, ...]]:
        return self.connection.execute(SQL[query]).fetchall()  # type: ignore[no-any-return]


# --- VF2

CHAIN = [("connectsTo", f"s{i}", f"s{i + 1}") for i in range(1, 6)] + [
    ("monitoredBy", f"s{i}", "sensor") for i in range(1, 7)
]
"""ConnectedSegments as a graph: the one query of the six without conditions. VF2 is injective; here it is the same."""


def networkx_chain(railway: Railway) -> Callable[[], int]:
    """A function that counts the matches of `CHAIN` with VF2 of networkx; the graphs are built before."""
    host = networkx.DiGraph()
    host.add_nodes_from((number, {"cls": cls}) for number, cls in enumerate(railway.classes, 1))
    for name, edges in railway.edges.items():
        host.add_edges_from(edges, name=name)
    chain = networkx.DiGraph()
    chain.add_nodes_from((f"s{i}", {"cls": "Segment"}) for i in range(1, 7))
    chain.add_node("sensor", cls="Sensor")
    for name, source, target in CHAIN:
        chain.add_edge(source, target, name=name)
    isomorphism = networkx.algorithms.isomorphism
    nodes = isomorphism.categorical_node_match("cls", None)
    links = isomorphism.categorical_edge_match("name", None)

    def count() -> int:
        matcher = isomorphism.DiGraphMatcher(host, chain, nodes, links)
        return sum(1 for _ in matcher.subgraph_monomorphisms_iter())

    return count


def rustworkx_chain(railway: Railway) -> Callable[[], int]:
    """As `networkx_chain`, with rustworkx."""
    host = rustworkx.PyDiGraph()
    host.add_nodes_from(railway.classes)
    for name, edges in railway.edges.items():
        host.add_edges_from([(source - 1, target - 1, name) for source, target in edges])
    chain = rustworkx.PyDiGraph()
    nodes = {f"s{i}": chain.add_node("Segment") for i in range(1, 7)} | {"sensor": chain.add_node("Sensor")}
    chain.add_edges_from([(nodes[source], nodes[target], name) for name, source, target in CHAIN])

    def count() -> int:
        found = rustworkx.vf2_mapping(
            host,
            chain,
            node_matcher=lambda one, other: one == other,
            edge_matcher=lambda one, other: one == other,
            subgraph=True,
            induced=False,
        )
        return sum(1 for _ in found)

    return count
