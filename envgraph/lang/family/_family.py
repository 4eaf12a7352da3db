"""What a `family.toml` says, as frozen data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Literal

from envgraph.code import dataclass
from envgraph.errors import Source, Span

Sequences = Literal["suffixes", "full", "baselines", "direct"]
Scheduled = Literal[
    "uniform",
    "learning_progress",
    "band",
    "learnability",
    "plr",
    "robust_plr",
    "exact_regret",
    "exact_learnability",
]
Strength = Literal["single", "heavy_tailed"]

EXPRESSIONS = "expressions"
"""The kind of an objective that is what expressions over measures of families say."""


@dataclass(frozen=True, slots=True)
class Name:
    """A name in a family file and where it stands."""

    text: str
    span: Span | None = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class ComponentSpec:
    """A part of the search by the name of its kind, with its options as plain data.

    Attributes:
        name: the user's name of a measure; for the others their role ("diversity", "parents" ..).
        kind: what is built ("path_complexity", "random" ...).
        options: everything else in the table.
        spans: where the table (""), its "kind", each option and ("along[0]") the items of a list stand.
    """

    name: str
    kind: str
    options: Mapping[str, object] = field(default_factory=dict)
    spans: Mapping[str, Span] = field(default_factory=dict, compare=False, repr=False)

    def span(self, option: str = "kind") -> Span | None:
        """Where an option's value stands; else where the table does."""
        return self.spans.get(option) or self.spans.get("")

    def key_span(self, option: str) -> Span | None:
        """Where the name of an option stands; else as `span`."""
        return self.spans.get(f"{option} =") or self.span(option)


@dataclass(frozen=True, slots=True)
class ConstraintsSpec:
    """`[constraints]`: names of patterns.

    Attributes:
        require: at least one match each.
        forbid: no match each.
        count: the number of matches is within bounds, both included; None is no upper bound.
        reachable: outcomes ("success", "failure") that the enumerated behaviour must be able to reach.
    """

    require: tuple[Name, ...] = ()
    forbid: tuple[Name, ...] = ()
    count: tuple[tuple[Name, tuple[int, int | None]], ...] = ()
    reachable: tuple[Name, ...] = ()


@dataclass(frozen=True, slots=True)
class MutationSpec:
    """`[mutation]`; the defaults are the paper's.

    Attributes:
        rules: names of rules, units and derived groups.
        rate: probability that a child is mutated.
        initial_applications: how many rules are applied to each clone of the initial model, both bounds included.
        max_attempts: how often a mutation that violates a constraint is tried again.
        strength: how many rule applications a mutation takes: one, or a number that is drawn anew each time.
    """

    rules: tuple[Name, ...] = ()
    rate: float = 0.85
    initial_applications: tuple[int, int] = (1, 5)
    max_attempts: int = 50
    strength: Strength = "single"


@dataclass(frozen=True, slots=True)
class SearchSpec:
    """`[search]`; the defaults are the paper's.

    Attributes:
        generations: None is without end (then there is another limit).
        keep_initial: the initial model is a fixed element of the family.
        time_limit: seconds, or None.
        target: stop at this diversity, or, for None, at the largest that a family can have; infinity is never.
        stagnation: stop after so many generations without improvement, or None.
    """

    population: int = 6
    generations: int | None = 1000
    keep_initial: bool = True
    parents: ComponentSpec = ComponentSpec("parents", "random")
    survivors: ComponentSpec = ComponentSpec("survivors", "simulated_annealing")
    time_limit: float | None = None
    target: float | None = None
    stagnation: int | None = None


@dataclass(frozen=True, slots=True)
class OptimiseSpec:
    """`[optimise]`: the file is about the one model that is best, not about a family.

    Attributes:
        maximise, minimise: names of measures, at least one in all.
        strategy: how models are searched.
        steps: how many moves are tried.
        time_limit: seconds, or None.
        target: a value of the only objective at which the search ends, or None.
    """

    maximise: tuple[Name, ...] = ()
    minimise: tuple[Name, ...] = ()
    strategy: ComponentSpec = ComponentSpec("strategy", "simulated_annealing")
    steps: int = 10_000
    time_limit: float | None = None
    target: float | None = None


@dataclass(frozen=True, slots=True)
class SamplesSpec:
    """`[samples]`: the family is many members that need not go together, not a few that are as diverse as can be.

    Attributes:
        count: members of the family, the initial model among them.
        cover: measures whose bins are to have as many members each; their options are `bins` and `range`.
        maximise, minimise: measures by which a better member takes the place of one in the same bins, the one that
            counts most first; one of the two is empty.
        attempts: how many models are tried; None for ten times as many as members.
    """

    count: int = 1_000
    cover: tuple[ComponentSpec, ...] = ()
    maximise: tuple[Name, ...] = ()
    minimise: tuple[Name, ...] = ()
    attempts: int | None = None


@dataclass(frozen=True, slots=True)
class CurriculumSpec:
    """`[curriculum]`.

    Attributes:
        order: the measure that orders the environments from easy to hard.
        sequences: what is trained on.
        initial: where the initial model stands: it is the "last", the target, or "ordered" like the others.
        schedules: what else the environments are chosen by, to be compared with.
    """

    order: Name | None = None
    sequences: Sequences = "suffixes"
    initial: Literal["last", "ordered"] = "last"
    schedules: tuple[Name, ...] = ()


@dataclass(frozen=True, slots=True)
class EpsilonSpec:
    """`epsilon` of `[training]`: it starts at `start` and is multiplied by `decay` down to `minimum`."""

    start: float = 1.0
    decay: float = 0.995
    minimum: float = 0.05
    per: Literal["episode", "step"] = "episode"
    reset: Literal["stage", "never"] = "stage"


@dataclass(frozen=True, slots=True)
class TrainingSpec:
    """`[training]`; the defaults are the published settings."""

    agent: str = "q_learning"
    learning_rate: float = 0.1
    discount: float = 0.99
    epsilon: EpsilonSpec = EpsilonSpec()
    steps_per_environment: int = 50_000
    evaluation_episodes: int = 3_000
    seeds: int = 30
    initial_value: float = 0.0
    n_step: int = 1
    ties: Literal["lowest", "random"] = "lowest"


@dataclass(frozen=True, slots=True)
class FamilySpec:
    """A whole family file.

    Attributes:
        name: of the family; by default that of the file's directory.
        model: path of the initial model, as names of files go (see `Files`); likewise `environment` and `imports`.
        environment: path of the behaviour; None when the family is only generated.
        imports: further files, such as queries that neither model nor environment import.
        seed: of the search.
        limit: steps of an episode, where the environment's own limit is overridden.
        measures: in the order of the file; at least one.
        diversity: `options["of"]` is the name of a measure.
        objective: what a family is worth as a whole; None: families are as diverse as can be. Either of a kind, or
            with the options `maximise`, `minimise` and `subject_to`: then its kind is `EXPRESSIONS`.
        samples: how many members are drawn, and of which kinds; None: a family is searched for.
        optimise: which model is searched for, if not a family.
        audit: what students see, and how they learn, where scores of levels are audited.
        ga4cl: the classes whose standing rewards fill the reward schedule of that format.
        path: name of the file.
    """

    name: str
    model: Name
    environment: Name | None = None
    imports: tuple[Name, ...] = ()
    seed: int = 0
    limit: int | None = None
    constraints: ConstraintsSpec = ConstraintsSpec()
    measures: tuple[ComponentSpec, ...] = ()
    diversity: ComponentSpec = ComponentSpec("diversity", "binned_entropy")
    objective: ComponentSpec | None = None
    samples: SamplesSpec | None = None
    audit: ComponentSpec | None = None
    mutation: MutationSpec = MutationSpec()
    search: SearchSpec = SearchSpec()
    curriculum: CurriculumSpec = CurriculumSpec()
    training: TrainingSpec = TrainingSpec()
    optimise: OptimiseSpec | None = None
    ga4cl: tuple[Name, ...] = ()
    path: str = "family.toml"
    source: Source | None = field(default=None, compare=False, repr=False)

    @property
    def files(self) -> tuple[str, ...]:
        """All files that the family names."""
        named = [self.model, *self.imports, *([self.environment] if self.environment else [])]
        return tuple(dict.fromkeys(str(one) for one in named))

    @property
    def evolves(self) -> bool:
        """Whether the genetic algorithm makes the family, generation after generation."""
        return not self.climbs and self.samples is None

    @property
    def climbs(self) -> bool:
        """Whether the family is searched for as a whole, and not selected from a population of models."""
        found = self.objective
        return found is not None and (found.kind != EXPRESSIONS or found.options.get("search") == "climb")

    @property
    def size(self) -> int:
        """How many members the family is to have."""
        return self.search.population if self.samples is None else self.samples.count

    def measure(self, name: str) -> ComponentSpec | None:
        """A measure by name."""
        return next((measure for measure in self.measures if measure.name == name), None)
