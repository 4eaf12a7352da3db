"""Random edits, nested savepoints, commits and checkouts against deep copies of every state."""

from __future__ import annotations

import pytest
from hypothesis import settings, strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from envgraph.errors import TransactionError
from envgraph.graph import Model, Savepoint, Version
from tests.facts import Notified
from tests.profile import examples
from tests.property.snapshots import Shadow, snapshot
from tests.property.strategies import EDITS, edit, metamodels
from tests.thresholds import set_thresholds


class Transactions(RuleBasedStateMachine):
    """A model, the states that its open savepoints and held versions must bring back, and a listener."""

    @initialize(data=st.data())
    def start(self, data: st.DataObject) -> None:
        self.model = Model(data.draw(metamodels()))
        self.shadow = Shadow(self.model)
        Notified(self.model, self.shadow)
        self.savepoints: list[tuple[Savepoint, dict[str, object]]] = []
        self.versions: list[tuple[Version, dict[str, object]]] = []

    @rule(data=st.data(), kinds=st.lists(st.sampled_from((*EDITS, "new", "link")), min_size=1, max_size=6))
    def edit(self, data: st.DataObject, kinds: list[str]) -> None:
        for kind in kinds:
            before, revision = snapshot(self.model), self.model.graph.store.revision
            edit(data.draw, self.model, kind)
            assert self.model.graph.store.revision != revision or snapshot(self.model) == before

    @rule()
    def open(self) -> None:
        self.savepoints.append((self.model.graph.history.savepoint(), snapshot(self.model)))

    @precondition(lambda self: self.savepoints)
    @rule()
    def roll_back(self) -> None:
        savepoint, before = self.savepoints.pop()
        self.model.graph.history.rollback(savepoint)
        assert snapshot(self.model) == before

    @precondition(lambda self: self.savepoints)
    @rule()
    def release(self) -> None:
        now = snapshot(self.model)
        self.model.graph.history.release(self.savepoints.pop()[0])
        assert snapshot(self.model) == now

    @rule()
    def commit(self) -> None:
        if self.savepoints:
            with pytest.raises(TransactionError):
                self.model.commit()
            return
        now = snapshot(self.model)
        version = self.model.commit()
        assert self.model.version is version
        assert snapshot(self.model) == now
        self.versions.append((version, now))

    @precondition(lambda self: self.versions)
    @rule(data=st.data())
    def check_out(self, data: st.DataObject) -> None:
        # Never draw a version itself: hypothesis would hold it.
        version, expected = self.versions[data.draw(st.integers(0, len(self.versions) - 1))]
        if self.savepoints:
            with pytest.raises(TransactionError):
                self.model.checkout(version)
            return
        clean = self.model.version is not None
        try:
            self.model.checkout(version)
            assert clean
        except TransactionError:
            assert not clean
            self.model.checkout(version, discard=True)
        assert snapshot(self.model) == expected
        assert self.model.version is version

    @precondition(lambda self: not self.savepoints)
    @rule(data=st.data(), kinds=st.lists(st.sampled_from((*EDITS, "new", "link")), min_size=2, max_size=6))
    def descend(self, data: st.DataObject, kinds: list[str]) -> None:
        """A chain of versions of which only the last one is held."""
        for kind in kinds:
            edit(data.draw, self.model, kind)
            version = self.model.commit()
        self.versions.append((version, snapshot(self.model)))

    @precondition(lambda self: self.versions)
    @rule(indexes=st.lists(st.integers(0, 100), min_size=1, max_size=4))
    def forget(self, indexes: list[int]) -> None:
        for index in indexes:
            if self.versions:
                del self.versions[index % len(self.versions)]

    @invariant()
    def everything_agrees(self) -> None:
        if hasattr(self, "model"):
            self.model.check_integrity()
            self.shadow.check()

    def teardown(self) -> None:
        if not hasattr(self, "model"):
            return
        while self.savepoints:
            self.roll_back()
        for version, expected in self.versions:
            self.model.checkout(version, discard=True)
            assert snapshot(self.model) == expected
            self.model.check_integrity()


class EagerTransactions(Transactions):
    """The same, where what else happens in large models only happens at once.

    Every spliced segment is reduced to its net changes, and three targets are a crowd.
    """

    def __init__(self) -> None:
        super().__init__()
        self.patch = pytest.MonkeyPatch()
        set_thresholds(self.patch, {"long change between versions": 0, "crowd of targets": 2})

    def teardown(self) -> None:
        super().teardown()
        self.patch.undo()


# One example takes about 40 ms: the invariants recompute everything after every step.
_SETTINGS = settings(max_examples=examples(40), stateful_step_count=30)

TestTransactions = Transactions.TestCase
TestTransactions.settings = _SETTINGS
TestEagerTransactions = EagerTransactions.TestCase
TestEagerTransactions.settings = _SETTINGS
