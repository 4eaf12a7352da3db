"""The rest of a rule that was interrupted between two changes: a rule is applied wholly, or not at all."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import accumulate
from typing import Any, Final

from envgraph.errors import EvaluationError, RuleError
from envgraph.rewrite._plan import New
from envgraph.rewrite.run._source import Line

_NEXT: Final = "#"
"""Where the number of the next change stands among the variables."""

Finish = Callable[[BaseException, dict[str, Any]], None]
"""Makes the changes that are left, given the exception and a dict that remembers how far that has come."""


def finisher(
    lines: Sequence[Line], first: int, changes: Sequence[Line], namespace: Mapping[str, Any]
) -> Finish:
    """How an interrupted function is finished.

    A change that is made once more changes nothing, but for creations: one that was interrupted has been taken back.

    Args:
        lines: of the function, behind its head.
        first: which of them is the first change.
        changes: all changes, which follow each other.
        namespace: what they refer to.
    """
    begins = list(accumulate((line.source.count("\n") + 1 for line in lines), initial=2))
    numbers = {
        line: number
        for number in range(len(changes))
        for line in range(begins[first + number], begins[first + number + 1])
    }
    # A link that is there already may have been made by this application.
    names = {**namespace, "_again": lambda *_: None}

    def start(error: BaseException) -> dict[str, Any]:
        trace = error.__traceback__
        while trace is not None and trace.tb_frame.f_globals is not namespace:
            trace = trace.tb_next
        if trace is None:
            return {_NEXT: len(changes)}
        # Values are computed before, and behind the last change everything is done.
        return {**trace.tb_frame.f_locals, _NEXT: numbers.get(trace.tb_lineno, len(changes))}

    def finish(error: BaseException, known: dict[str, Any]) -> None:
        if not known:
            known.update(start(error))
        try:
            while known[_NEXT] < len(changes):
                source, operation = changes[known[_NEXT]]
                if not (isinstance(operation, New) and f"e{operation.node}" in known):
                    exec(source, names, known)
                known[_NEXT] += 1
        except (RuleError, EvaluationError):
            return  # only the first change may be refused: there was none yet

    return finish
