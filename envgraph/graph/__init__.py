"""The model: a typed attributed graph with change events, one undo log, transactions and versions."""

from envgraph.graph._facts import ClassFact, Fact, LinkFact, Listener, ValueFact
from envgraph.graph._history import Savepoint, Version
from envgraph.graph._journal import EXCHANGE, IN, OUT, SET, Exchangeable, IndexedSet
from envgraph.graph._model import Model
from envgraph.graph._node import Node, Targets
from envgraph.graph._store import Relation, Store

__all__ = [
    "EXCHANGE",
    "IN",
    "OUT",
    "SET",
    "ClassFact",
    "Exchangeable",
    "Fact",
    "IndexedSet",
    "LinkFact",
    "Listener",
    "Model",
    "Node",
    "Relation",
    "Savepoint",
    "Store",
    "Targets",
    "ValueFact",
    "Version",
]
