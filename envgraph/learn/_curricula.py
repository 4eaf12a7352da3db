"""Which environments an agent meets, in which order, for how long."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument, did_you_mean

Kind = Literal["curriculum", "baseline"]
Sequences = Literal["suffixes", "full", "baselines", "direct"]


@dataclass(frozen=True, slots=True)
class Curriculum:
    """A sequence of environments to train on.

    Attributes:
        kind: "curriculum", or "baseline" for direct training on one environment.
        label: what it is called in tables, unique among its kind.
        stages: names of environments, in the order of training.
        shares: length of each stage, in units of `steps_per_environment`.
    """

    kind: Kind
    label: str
    stages: tuple[str, ...]
    shares: tuple[int, ...]

    def __post_init__(self) -> None:
        if not self.stages or len(self.stages) != len(self.shares) or min(self.shares) < 1:
            raise InvalidArgument(f"curriculum `{self.label}` needs a positive share for each of its stages")


def sequences(names: Sequence[str], kind: Sequences = "suffixes") -> tuple[Curriculum, ...]:
    """The curricula of a family.

    Args:
        names: the environments from the easiest to the target.
        kind: "suffixes": all that end in the target and have two stages or more, the longest first, as in the paper.
            "full": the whole family. "baselines": each environment alone for the steps of the whole family.
            "direct": the target alone, likewise.

    Raises:
        InvalidArgument: there are no names, one stands twice, or the kind is unknown.

    >>> [curriculum.label for curriculum in sequences(["E1", "E2", "E3"])]
    ['E1-E3', 'E2-E3']
    >>> sequences(["E1", "E2", "E3"], "direct")
    (Curriculum(kind='baseline', label='E3', stages=('E3',), shares=(3,)),)
    """
    if kind not in get_args(Sequences):
        hint = did_you_mean(str(kind), get_args(Sequences))
        raise InvalidArgument(f"unknown kind of sequences {kind!r}", hint)
    if not names or len(set(names)) != len(names):
        raise InvalidArgument("a family needs environments with different names")
    if kind in ("suffixes", "full"):
        last = max(len(names) - 1, 1) if kind == "suffixes" else 1
        return tuple(_suffix(names[first:]) for first in range(last))
    alone = names if kind == "baselines" else names[-1:]
    return tuple(Curriculum("baseline", name, (name,), (len(names),)) for name in alone)


def _suffix(names: Sequence[str]) -> Curriculum:
    label = f"{names[0]}-{names[-1]}" if len(names) > 1 else names[0]
    return Curriculum("curriculum", label, tuple(names), (1,) * len(names))
