"""Context managers that end whatever comes."""

from collections.abc import Iterator
from itertools import count
from traceback import format_exception

import pytest

from envgraph.graph import ensured
from tests.property.interrupting import Trip
from tests.unit.graph.domain import forest


@ensured
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


def test_a_block_begins_and_ends():
    events: list[str] = []
    with counted(events) as number:
        assert number == 1
    assert events == ["begin", "good", "end"]


def test_an_exception_passes_as_it_is():
    events: list[str] = []

    def fail() -> None:
        raise KeyError("no")

    with pytest.raises(KeyError) as caught, counted(events):
        fail()
    assert events == ["begin", "KeyError", "end"]
    assert caught.value.__context__ is None
    assert "_steps" not in "".join(format_exception(caught.value))


def test_what_the_end_raises_is_raised():
    @ensured
    def refusing() -> Iterator[None]:
        yield
        raise ValueError

    with pytest.raises(ValueError), refusing():
        pass


@pytest.mark.parametrize("fails", [False, True])
def test_no_interruption_leaves_a_transaction_open(fails):
    model = forest()
    tile = model["t00"]
    tile.x = 0

    def change() -> None:
        with model.transaction():
            tile.x = 1
            if fails:
                raise KeyError

    for instruction in count(1):
        trip = Trip(instruction)
        try:
            interrupted = trip.run(change)
        except KeyError:
            interrupted = False
        assert model.depth == 0
        assert tile.x in ((0,) if fails else (0, 1))
        model.check_integrity()
        tile.x = 0
        if not interrupted and not trip.tripped:
            break
    assert instruction > 100
