"""The methods that an audit compares: ways to choose the levels that a student learns on, built from the same parts."""

from __future__ import annotations

from typing import Final, Literal, get_args

from envgraph.code import dataclass
from envgraph.env.schedules import Buffer, Sifting

Score = Literal["random", "PVL", "L1", "MaxMC", "MNA", "SFL", "exact regret", "exact learnability"]
SCORES: Final[tuple[Score, ...]] = get_args(Score)

PROBED: Final[tuple[Score, ...]] = ("PVL", "L1", "MaxMC", "MNA", "SFL", "exact learnability")
"""Scores whose rankings are audited, by comparison with exact regret."""


@dataclass(frozen=True, slots=True)
class AuditMethod:
    """A way to choose levels.

    Attributes:
        name: the name in tables and charts.
        score: the score by which levels are chosen; None for random choice.
        choice: settings of the schedule; None to draw levels at random.
        only_solvable: True to draw only solvable levels.
        counts_scoring: True to count the steps of episodes that are played only to score levels.
        edits_levels: True to edit levels that were replayed (`Editor`), and offer the results to the buffer.
        is_decisive: True to run it with all seeds, since it takes part in a main claim about teaching.
    """

    name: str
    score: Score | None = None
    choice: Buffer | Sifting | None = None
    only_solvable: bool = False
    counts_scoring: bool = True
    edits_levels: bool = False
    is_decisive: bool = False


ROBUST: Final = Buffer(fresh_learned=False)

METHODS: Final = (
    AuditMethod("DR", is_decisive=True),
    AuditMethod("DR, solvable only", only_solvable=True, is_decisive=True),
    AuditMethod("PLR, random score", "random", Buffer(), is_decisive=True),
    AuditMethod("PLR, PVL", "PVL", Buffer()),
    AuditMethod("PLR, L1", "L1", Buffer()),
    AuditMethod("PLR, MaxMC", "MaxMC", Buffer(), is_decisive=True),
    AuditMethod("PLR, MNA", "MNA", Buffer()),
    AuditMethod("robust PLR, PVL", "PVL", ROBUST),
    AuditMethod("robust PLR, MaxMC", "MaxMC", ROBUST),
    AuditMethod("SFL, 4 rollouts", "SFL", Sifting(4)),
    AuditMethod("SFL, 16 rollouts", "SFL", Sifting(16)),
    AuditMethod("SFL, 16 rollouts uncounted", "SFL", Sifting(16), counts_scoring=False),
    AuditMethod("SFL, exact learnability", "exact learnability", Sifting(None)),
    AuditMethod("PLR, exact regret", "exact regret", Buffer(), is_decisive=True),
    AuditMethod("PLR, exact learnability", "exact learnability", Buffer(), is_decisive=True),
    AuditMethod("PLR, MaxMC, solvable only", "MaxMC", Buffer(), only_solvable=True),
    AuditMethod("PLR, exact learnability, solvable only", "exact learnability", Buffer(), only_solvable=True),
)
"""All methods of an audit; the first is the baseline of the others."""


EDITING: Final = (
    AuditMethod("ACCEL, MaxMC", "MaxMC", ROBUST, edits_levels=True),
    AuditMethod("PLR with edits, exact learnability", "exact learnability", Buffer(), edits_levels=True),
)
"""Methods that make new levels during training. They take ten times as long, so they are run only if named."""


@dataclass(frozen=True, slots=True)
class Contrast:
    """A claim about two methods, made before anything is run.

    Attributes:
        claim: the claim in words.
        part: the step from domain randomisation to exact scores that the difference is due to.
        method, other: names of methods; the claim is that `method` succeeds more often.
    """

    claim: str
    part: str
    method: str
    other: str


CONTRASTS: Final = (
    Contrast("a buffer of levels helps, whatever is in it", "buffer", "PLR, random score", "DR"),
    Contrast("leaving unsolvable levels out helps", "filter", "DR, solvable only", "DR"),
    Contrast("positive value loss teaches more than a random score", "score", "PLR, PVL", "PLR, random score"),
    Contrast("L1 value loss teaches more than a random score", "score", "PLR, L1", "PLR, random score"),
    Contrast("MaxMC teaches more than a random score", "score", "PLR, MaxMC", "PLR, random score"),
    Contrast("MNA teaches more than a random score", "score", "PLR, MNA", "PLR, random score"),
    Contrast("exact regret teaches more than a random score", "score", "PLR, exact regret", "PLR, random score"),
    Contrast(
        "exact learnability teaches more than leaving unsolvable levels out",
        "score",
        "PLR, exact learnability",
        "DR, solvable only",
    ),
    Contrast(
        "exact learnability teaches more than exact regret",
        "score",
        "PLR, exact learnability",
        "PLR, exact regret",
    ),
    Contrast("SFL teaches more than no choice at all", "score", "SFL, 16 rollouts", "DR"),
    Contrast(
        "the steps of SFL's rollouts cost what it teaches",
        "cost",
        "SFL, 16 rollouts uncounted",
        "SFL, 16 rollouts",
    ),
    Contrast(
        "SFL with exact scores teaches more than with rollouts that cost nothing",
        "precision",
        "SFL, exact learnability",
        "SFL, 16 rollouts uncounted",
    ),
    Contrast("edits teach more than robust replay alone", "edits", "ACCEL, MaxMC", "robust PLR, MaxMC"),
    Contrast("ACCEL teaches more than no choice at all", "edits", "ACCEL, MaxMC", "DR"),
    Contrast(
        "edits teach more than replay by exact learnability alone",
        "edits",
        "PLR with edits, exact learnability",
        "PLR, exact learnability",
    ),
)
