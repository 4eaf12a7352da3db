"""Ctrl-C where a block begins or ends."""

import signal
import sys
from collections.abc import Iterator

import pytest

from envgraph.graph import guarded_contextmanager
from tests.unit.graph.domain import forest


@guarded_contextmanager
def counted(events: list[str]) -> Iterator[int]:
    """Notes what happens."""
    try:
        events.append("begin")
        yield len(events)
        events.append("good")
    except BaseException as problem:
        events.append(type(problem).__name__)
        raise
    finally:
        events.append("end")


def test_guarded_blocks_run_to_their_end():
    events: list[str] = []
    with counted(events) as number:
        assert number == 1
    assert events == ["begin", "good", "end"]


def test_exceptions_pass_through_guarded_blocks_unchanged():
    events: list[str] = []

    def fail() -> None:
        raise KeyError("no")

    with pytest.raises(KeyError) as caught, counted(events):
        fail()
    assert events == ["begin", "KeyError", "end"]
    assert caught.value.__context__ is None


def interrupted_in(function: str, run) -> None:
    """Ctrl-C comes where a function of `contextlib` begins that a block calls, in each of its calls."""

    def profile(frame, event, _) -> None:
        code = frame.f_code
        if event == "call" and code.co_name == function and code.co_filename.endswith("contextlib.py"):
            handler = signal.getsignal(signal.SIGINT)  # a signal would come into this function
            assert callable(handler)
            handler(signal.SIGINT, frame)

    sys.setprofile(profile)
    try:
        run()
    finally:
        sys.setprofile(None)


@pytest.mark.parametrize("fails", [False, True])
def test_ctrl_c_at_the_end_of_a_block_waits_for_the_end_of_the_transaction(fails):
    model = forest()
    tile = model["t00"]
    tile.x = 0

    def change() -> None:
        with model.transaction():
            tile.x = 1
            if fails:
                raise KeyError

    with pytest.raises(KeyboardInterrupt):
        interrupted_in("__exit__", change)
    assert not model.graph.history.savepoint_depth
    assert tile.x == (0 if fails else 1)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    model.check_integrity()


def test_ctrl_c_inside_a_block_takes_effect_at_once():
    model = forest()
    tile = model["t00"]
    tile.x = 0
    with pytest.raises(KeyboardInterrupt), model.transaction():
        tile.x = 1
        signal.raise_signal(signal.SIGINT)
        tile.x = 2
    assert tile.x == 0
    assert not model.graph.history.savepoint_depth


def test_other_signal_handlers_are_not_replaced():
    def other(*_: object) -> None:
        pass

    before = signal.signal(signal.SIGINT, other)
    try:
        with forest().transaction():
            assert signal.getsignal(signal.SIGINT) is other
    finally:
        signal.signal(signal.SIGINT, before)


def test_retyping_is_completed_after_a_second_interruption(monkeypatch):
    model = forest()
    tile = model["t00"]
    tile.x = 7
    extent = type(model.graph.extent("RoadTile"))

    def interrupted(whole, after):
        calls = []

        def replaced(*arguments):
            calls.append(whole(*arguments) if after or calls else None)
            if len(calls) == 1:
                raise KeyboardInterrupt
            return calls[-1]

        return replaced

    monkeypatch.setattr(extent, "take", interrupted(extent.take, after=True))
    monkeypatch.setattr(
        model.graph.history,
        "_repair_interrupted_writes",
        interrupted(model.graph.history._repair_interrupted_writes, after=False),
    )
    with pytest.raises(KeyboardInterrupt):
        tile.retype("BurningTile")
    model.check_integrity()
    assert (tile.cls, tile.x) == ("BurningTile", 7)
