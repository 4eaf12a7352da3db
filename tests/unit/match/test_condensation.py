"""Reachability of many pairs, after exceptions."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from envgraph.match.demand._condensation import Condensation

STEPS = {1: [2], 2: [3], 3: [1, 4], 4: [5], 5: [4, 6], 6: []}
SIZES = {1: 6, 2: 6, 3: 6, 4: 3, 5: 3, 6: 0}


@pytest.mark.parametrize("found", range(3))
def test_what_was_interrupted_is_explored_anew(found: int) -> None:
    left = found

    class Bits(dict[int, int]):
        """Raises when components have become known so often."""

        def update(self, items: object) -> None:
            nonlocal left
            left -= 1
            if left < 0:
                raise KeyboardInterrupt
            super().update(items)  # type: ignore[call-overload]

    reached = Condensation(STEPS.__getitem__)
    reached._bits = Bits()
    with pytest.raises(KeyboardInterrupt):
        reached.size(1)
    left = 100
    assert {node: reached.size(node) for node in (6, 4, 1, 2, 3, 5)} == SIZES
    pairs: Iterable[tuple[int, int]] = ((a, b) for a in STEPS for b in STEPS)
    assert sum(reached.holds(*pair) for pair in pairs) == sum(SIZES.values())
