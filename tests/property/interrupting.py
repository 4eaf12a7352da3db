"""Exceptions at chosen instructions: what Ctrl-C does at some time, at every place and without a clock."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dis import get_instructions
from functools import cache
from inspect import CO_GENERATOR
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import envgraph

PLACES = tuple(str(Path(envgraph.__file__).parent / package) for package in ("graph", "match", "rewrite"))


class Interrupted(BaseException):
    """Like KeyboardInterrupt."""


def _ours(frame: FrameType) -> bool:
    name = frame.f_code.co_filename
    return name.startswith(PLACES) or name.startswith("<")


@cache
def _sheltered(code: CodeType) -> frozenset[int]:
    """Where nobody looks for signals: from the beginning of a handler up to its first call, and where a function ends.

    Nor does anybody between the end of a `with` block and the call that follows, or when a function in Python has
    returned. And an assignment to several names or attributes is one step: nothing can go wrong between the first
    and the last, unless the first has been preceded by a call.
    """
    found: set[int] = set()
    inside, nones, stored = False, list[int](), False
    for instruction in get_instructions(code):
        name = instruction.opname
        if stored and name in ("STORE_ATTR", "STORE_FAST", "LOAD_FAST", "LOAD_DEREF"):
            found.add(instruction.offset)
        stored = name in ("STORE_ATTR", "STORE_FAST", "STORE_SUBSCR") or (stored and name.startswith("LOAD_"))
        inside |= name == "PUSH_EXC_INFO"
        if inside or name in ("RETURN_VALUE", "JUMP_FORWARD", "NOP", "SWAP"):
            found.add(instruction.offset)
        inside &= not name.startswith("CALL")
        if name == "LOAD_CONST" and instruction.argval is None:
            nones.append(instruction.offset)
        elif len(nones) >= 3 and name in ("PRECALL", "CALL"):
            found.update([*nones, instruction.offset])
        else:
            nones = []
    return frozenset(found)


class Trip:
    """Raises `Interrupted` before an instruction of the engine, and perhaps once more after so many further calls.

    Attributes:
        passed: instructions, and calls after the first exception.
    """

    def __init__(self, instruction: int, call: int | None = None) -> None:
        self._instruction = instruction
        self._call = call
        self._back = False
        self.passed = 0
        self.calls = 0
        self.tripped = False

    def run(self, function: Callable[[], object]) -> bool:
        """Call a function; whether it was interrupted."""
        if self.tripped:
            function()
            return False
        if self._call is not None:
            sys.setprofile(self._profile)
        sys.settrace(self._trace)
        try:
            function()
        except Interrupted:
            return True
        finally:
            sys.settrace(None)
            sys.setprofile(None)
        return False

    def _trace(self, frame: FrameType, event: str, argument: Any) -> Any:
        if not _ours(frame):
            return None
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        return self._instructions

    def _instructions(self, frame: FrameType, event: str, argument: Any) -> Any:
        if event == "return":
            self._back = True
        elif event == "opcode":
            back, self._back = self._back, False
            if back or frame.f_lasti in _sheltered(frame.f_code):
                return self._instructions
            self.passed += 1
            if self.passed == self._instruction:
                self.tripped = True
                self.where = (frame.f_code.co_name, frame.f_lineno, frame.f_lasti)
                raise Interrupted
        return self._instructions

    def _profile(self, frame: FrameType, event: str, argument: Any) -> None:
        # Where Python looks for signals: a function begins, a call of one in C returns. A generator that goes on would
        # be interrupted in its `try`, which cannot be had here.
        goes_on = event == "call" and frame.f_code.co_flags & CO_GENERATOR
        if self.tripped and self._call is not None and event in ("call", "c_return") and not goes_on and _ours(frame):
            self.calls += 1
            if self.calls == self._call:
                self._call = None
                self.where = (frame.f_code.co_name, frame.f_lineno, frame.f_lasti)
                raise Interrupted
