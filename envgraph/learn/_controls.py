"""What a curriculum is compared with: other ways to spend as many steps on the same environments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import factorial
from typing import Final, Literal, get_args

import numpy as np

from envgraph.env import Tabular
from envgraph.errors import InvalidArgument, did_you_mean
from envgraph.learn._curricula import Curriculum, sequences
from envgraph.learn._teachers import TEACHERS
from envgraph.solve import optimal_return
from envgraph.solve.learning import TrainingSettings

Control = Literal["direct", "optimistic", "reversed", "shuffled", "randomised"]
CONTROLS: Final[tuple[Control, ...]] = get_args(Control)

ORDERS: Final = 4
"""How many shuffled orders there are by default."""


def controls(
    names: Sequence[str],
    kinds: Sequence[str] = CONTROLS,
    *,
    optimism: float | None = None,
    orders: int = ORDERS,
    seed: int = 0,
) -> tuple[Curriculum, ...]:
    """Controls for the whole family as a curriculum; each has as many steps as that.

    "direct": the target alone. "optimistic": likewise, with higher values at first. "reversed" and "shuffled": other
    orders; the target stays last, since it is what success is measured on. "randomised": domain randomisation (Tobin et
    al. 2017), an environment of the family drawn for each episode, the target among them; once in one stage, with one
    schedule of epsilon, and once with epsilon renewed as often as in the curriculum.

    Schedules (`TEACHERS`) stand in place of the order: they choose the environment of each turn among the earlier ones,
    by what came of the turns before; the target stays last. "uniform" is the one that chooses at random.

    What a small family has no room for is left out: with fewer than three environments there is no other order.

    Args:
        names: the environments from the easiest to the target.
        kinds: some of those above; schedules only where they are named.
        optimism: what every Q-value is at first in "optimistic", see `optimistic_value`; None leaves it out.
        orders: how many shuffled orders at most; all different, and neither the given one nor its reverse.
        seed: of the shuffled orders.

    Raises:
        InvalidArgument: there are no names, one stands twice, or a kind is unknown.

    >>> [one.label for one in controls(["E1", "E2", "E3", "E4"], optimism=5.0, orders=1)]
    ['E4', 'optimistic', 'reversed', 'shuffled 1', 'randomised', 'randomised, renewed']
    >>> [stage for stage in controls(["E1", "E2", "E3"], ["reversed"])[0].stages]
    ['E2', 'E1', 'E3']
    """
    for kind in kinds:
        if kind not in (*CONTROLS, *TEACHERS):
            raise InvalidArgument(
                f"unknown control {kind!r}", did_you_mean(str(kind), (*CONTROLS, *TEACHERS))
            )
    direct, count = sequences(names, "direct"), len(names)
    found: list[Curriculum] = [*direct] if "direct" in kinds else []
    if "optimistic" in kinds and optimism is not None:
        found.append(Curriculum("control", "optimistic", direct[0].stages, direct[0].shares, optimism))
    *earlier, target = names
    backwards = tuple(reversed(earlier))
    if "reversed" in kinds and count > 2:
        found.append(_order("reversed", (*backwards, target)))
    if "shuffled" in kinds:
        shuffled = _shuffled(tuple(earlier), orders, seed)
        found += [_order(f"shuffled {place}", (*one, target)) for place, one in enumerate(shuffled, start=1)]
    if "randomised" in kinds and count > 1:
        every = tuple(names)
        found.append(Curriculum("control", "randomised", (every,), (count,)))
        found.append(Curriculum("control", "randomised, renewed", (every,) * count, (1,) * count))
    if count > 2:
        stages: list[str | tuple[str, ...]] = [tuple(earlier)] * (count - 1) + [target]
        taught = [kind for kind in kinds if kind in TEACHERS]
        found += [Curriculum("control", one, (*stages,), (1,) * count, schedule=one) for one in taught]
    return tuple(found)


def optimistic_value(target: Tabular, settings: TrainingSettings) -> float | None:
    """Half the greatest discounted return within the limit: a value that is optimistic and soon found to be.

    An agent goes where its values have not yet fallen, so it visits everything systematically (Sutton and Barto 2018,
    section 2.6). Values as high as the best return, or higher, keep it doing so after it has found that return, until
    all others have fallen below; half of it leaves room on either side.

    Returns:
        None where the settings begin with as much, as where no return is positive and 0 is optimistic already.
    """
    value = optimal_return(target, settings.limit, discount=settings.discount) / 2
    return value if value > settings.initial_value else None


def _order(label: str, stages: tuple[str, ...]) -> Curriculum:
    return Curriculum("control", label, stages, (1,) * len(stages))


def _shuffled(names: tuple[str, ...], orders: int, seed: int) -> Iterator[tuple[str, ...]]:
    """So many orders, if there are as many beside the given one and its reverse."""
    seen = {names, names[::-1]}
    wanted = min(len(seen) + orders, factorial(len(names)))
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(len(names),)))
    while len(seen) < wanted:
        one = tuple(names[place] for place in rng.permutation(len(names)))
        if one not in seen:
            seen.add(one)
            yield one
