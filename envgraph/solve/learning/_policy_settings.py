"""The settings of a learner whose policy generalises; they are checked without NumPy."""

from __future__ import annotations

from envgraph.code import dataclass
from envgraph.errors import InvalidArgument


@dataclass(frozen=True, slots=True)
class PolicySettings:
    """The hyperparameters of proximal policy optimisation (Schulman et al. 2017).

    Attributes:
        hidden: number of units of the only hidden layer, which are rectified.
        learning_rate: learning rate of Adam.
        epochs: number of passes over the steps of a batch.
        minibatches: number of parts of a batch, each of whole levels.
        levels: number of levels in a batch.
        steps: number of steps of each level in a batch.
        clip: greatest distance of the ratio of new and old action probability from 1.
        entropy, value: weights of the entropy and of the value's error in the loss.
        norm: the greatest norm of a gradient.
        discount: discount factor of rewards.
        smoothing: the lambda of generalised advantage estimation.
        limit: steps after which an episode is truncated.
    """

    hidden: int = 64
    learning_rate: float = 0.002
    epochs: int = 3
    minibatches: int = 4
    levels: int = 32
    steps: int = 128
    clip: float = 0.2
    entropy: float = 0.05
    value: float = 0.5
    norm: float = 0.5
    discount: float = 0.97
    smoothing: float = 0.95
    limit: int = 64

    def __post_init__(self) -> None:
        if self.levels % self.minibatches:
            raise InvalidArgument("`levels` must be a multiple of `minibatches`")
