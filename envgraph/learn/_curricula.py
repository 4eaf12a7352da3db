"""Curricula: the environments that an agent is trained on, in order, and the number of steps in each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import accumulate, pairwise
from math import isfinite
from typing import Literal, Self, get_args

from envgraph.code import dataclass
from envgraph.draw import html_fields
from envgraph.errors import InvalidArgument, check_known
from envgraph.solve.learning import Epsilon

Kind = Literal["curriculum", "baseline", "control"]
Sequences = Literal["suffixes", "full", "baselines", "direct"]


@dataclass(frozen=True, slots=True)
class Curriculum:
    """A sequence of environments to train on.

    Attributes:
        kind: "curriculum"; "baseline" for direct training on one environment; "control" for another way to train that
            a curriculum is compared with.
        label: its name in tables, unique among its kind.
        stages: names of environments, in the order of training. Several names together are a stage in which each
            episode takes place in one of them, sampled uniformly.
        shares: length of each stage, > 0, in units of `steps_per_environment`; may be a fraction.
        initial_value: every Q-value at the beginning; None for that of the settings.
        epsilon: exploration; None for that of the settings.
        orders: orders of the stages, `orders[k % len(orders)]` for seed k; () for `stages` with every seed.
        schedule: name in `TEACHERS` of a schedule that chooses the environments of stages with several names, turn by
            turn; None to sample an environment for each episode. These stages all have the same names.
    """

    kind: Kind
    label: str
    stages: tuple[str | tuple[str, ...], ...]
    shares: tuple[int | Fraction, ...]
    initial_value: float | None = None
    schedule: str | None = None
    epsilon: Epsilon | None = None
    orders: tuple[tuple[str, ...], ...] = ()

    _repr_html_ = html_fields

    def __post_init__(self) -> None:
        if not self.stages or len(self.stages) != len(self.shares) or min(self.shares) <= 0:
            raise InvalidArgument(f"curriculum `{self.label}` needs a positive share for each of its stages")
        if any(not names or len(set(names)) != len(names) for names in self.members):
            raise InvalidArgument(
                f"each stage of curriculum `{self.label}` needs one or more environments with different names"
            )
        if self.schedule is not None and len({one for one in self.members if len(one) > 1}) != 1:
            raise InvalidArgument(
                f"curriculum `{self.label}` has a schedule, so its stages with several environments must be the same"
            )
        if self.initial_value is not None and not isfinite(self.initial_value):
            raise InvalidArgument(f"`initial_value` of curriculum `{self.label}` must be finite")
        if any(sorted(order) != sorted(map(str, self.stages)) for order in self.orders):
            raise InvalidArgument(f"each of the orders of curriculum `{self.label}` must have all its stages")

    @property
    def members(self) -> tuple[tuple[str, ...], ...]:
        """Return the names of the environments of each stage."""
        return tuple((stage,) if isinstance(stage, str) else stage for stage in self.stages)

    def for_seed(self, seed: int) -> Self:
        """Return the curriculum with its stages in the order of a seed; itself if it has no `orders`."""
        return replace(self, stages=self.orders[seed % len(self.orders)], orders=()) if self.orders else self

    def stage_steps(self, steps: int) -> list[int]:
        """Return the number of steps of each stage, if a share of 1 means `steps`; rounded so that the sum is exact."""
        ends = [int(end * steps) for end in accumulate(map(Fraction, self.shares), initial=Fraction())]
        return [end - start for start, end in pairwise(ends)]


def parse_kind(text: object) -> Kind:
    """Return the kind of a curriculum from its text.

    Raises:
        ValueError: there is no such kind.
    """
    for kind in get_args(Kind):
        if kind == text:
            return kind  # type: ignore[no-any-return]
    raise ValueError(text)


def sequences(names: Sequence[str], kind: Sequences = "suffixes") -> tuple[Curriculum, ...]:
    """Return the curricula of a family.

    Args:
        names: the environments from the easiest to the target.
        kind: "suffixes": all that end in the target and have two stages or more, the longest first, as in the paper.
            "full": the whole family. "baselines": each environment alone for the steps of the whole family.
            "direct": the target alone for the steps of the whole family.

    Raises:
        InvalidArgument: `names` is empty or has a name twice, or the kind is unknown.

    >>> [curriculum.label for curriculum in sequences(["E1", "E2", "E3"])]
    ['E1-E3', 'E2-E3']
    >>> sequences(["E1", "E2", "E3"], "direct")[0].stages, sequences(["E1", "E2", "E3"], "direct")[0].shares
    (('E3',), (3,))
    """
    check_known(kind, get_args(Sequences), f"unknown kind of sequences {kind!r}")
    if not names or len(set(names)) != len(names):
        raise InvalidArgument("`names` must be one or more environments with different names")
    if kind in ("suffixes", "full"):
        last = max(len(names) - 1, 1) if kind == "suffixes" else 1
        return tuple(_suffix_curriculum(names[first:]) for first in range(last))
    alone = names if kind == "baselines" else names[-1:]
    return tuple(Curriculum("baseline", name, (name,), (len(names),)) for name in alone)


def _suffix_curriculum(names: Sequence[str]) -> Curriculum:
    label = f"{names[0]}-{names[-1]}" if len(names) > 1 else names[0]
    return Curriculum("curriculum", label, tuple(names), (1,) * len(names))
