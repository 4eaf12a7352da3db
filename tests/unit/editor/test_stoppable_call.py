"""Calls in other threads are stopped, before and while they run, and leave the thread usable."""

from __future__ import annotations

import asyncio
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import count
from threading import Event, Thread

import pytest

from envgraph.editor import LanguageService, StoppableCall, StoppedError, TookTooLongError
from envgraph.lang import TextFiles


def test_a_call_that_never_ends_is_stopped_and_its_thread_goes_on() -> None:
    begun = Event()

    def run() -> None:
        for number in count():
            if number == 1000:
                begun.set()

    with ThreadPoolExecutor(1) as pool:
        call = StoppableCall(run)
        future = pool.submit(call)
        begun.wait()
        call.stop()
        with pytest.raises(StoppedError):
            future.result()
        call.stop()  # has no effect on what the thread does now
        assert pool.submit(lambda: sum(range(100_000))).result() == 4_999_950_000
        late = StoppableCall(run)
        late.stop()
        with pytest.raises(StoppedError):
            pool.submit(late).result()


def test_a_call_ends_with_its_time_limit_or_its_task() -> None:
    def run() -> None:
        for _ in count():
            pass

    async def wait() -> None:
        with pytest.raises(TookTooLongError):
            await StoppableCall(run).run_in(None, 0.05)
        task = asyncio.create_task(StoppableCall(run).run_in(None, None))
        await asyncio.sleep(0.05)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert await StoppableCall(lambda: 7).run_in(None, 5.0) == 7

    asyncio.run(wait())  # waits for all threads


def test_counts_that_take_too_long_leave_out_the_rest() -> None:
    loose = "pattern loose(a : N, b : N, c : N, d : N, e : N) { "
    loose += "N.v(a, v); N.v(b, w); N.v(c, x); N.v(d, y); N.v(e, z); check v + w + x + y + z == 1; }"
    texts = {
        "a.metamodel": "metamodel h\nclass N { int v contains N[*] ns }\n",
        "a.query": f'import "a.metamodel"\npattern first(n : N) {{ N(n); }}\n{loose}\n',
        "a.model": f'import "a.metamodel"\nmodel m:h {{ N {{ v = 0, ns = [{", ".join(["N { v = 0 }"] * 300)}] }} }}\n',
    }
    service = LanguageService(lambda method, params: None, TextFiles(texts))
    service.folders = (".",)
    document = {"uri": "memory:///a.query", "languageId": "query", "version": 1, "text": texts["a.query"]}
    service.answer("textDocument/didOpen", {"textDocument": document})
    check = service.next_job()
    assert check is not None and check.seconds is None
    service.record(check, check.run())
    counting = service.next_job()
    assert counting is not None and counting.seconds is not None
    found = asyncio.run(StoppableCall(counting.run).run_in(None, 0.3))
    service.record(counting, found)
    lenses = service.answer("textDocument/codeLens", {"textDocument": {"uri": "memory:///a.query"}})
    assert [one["command"]["title"] for one in lenses] == ["301 matches in m"]


def test_a_call_that_was_not_stopped_leaves_nothing_for_profilers() -> None:
    called: list[str] = []

    def function() -> int:
        return 7

    assert StoppableCall(function)() == 7
    sys.setprofile(lambda frame, event, _: called.append(event))
    try:
        function()
    finally:
        sys.setprofile(None)
    assert called[:2] == ["call", "return"]


def test_a_stop_at_the_end_of_a_call_does_not_reach_later_code() -> None:
    late: list[BaseException] = []
    results: list[object] = []

    def run(call: StoppableCall[int]) -> None:
        with suppress(StoppedError):
            results.append(call())
        try:
            for _ in range(1000):
                pass
        except StoppedError as error:
            late.append(error)

    for pause in range(200):
        call = StoppableCall(lambda: sum(range(1000)))
        thread = Thread(target=run, args=(call,))
        thread.start()
        for _ in range(20 * pause):
            pass
        call.stop()
        thread.join(10)
        assert not thread.is_alive()
    assert not late and {*results} <= {sum(range(1000))}
