"""The content of a `family.toml`, as frozen dataclasses: one for each table."""

from __future__ import annotations

from dataclasses import field, replace
from math import inf
from typing import Literal, get_args

from envgraph.code import dataclass
from envgraph.errors import Source
from envgraph.lang.family._table_reader import (
    ComponentSpec,
    LocatedName,
    TableReader,
    key,
    read_cover,
    read_match_counts,
)

CurriculumSequences = Literal["suffixes", "full", "baselines", "direct"]
ScheduleName = Literal[
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

EXPRESSION_KIND = "expressions"
"""The kind of an objective that is given by expressions over measures of families."""


@dataclass(frozen=True, slots=True)
class ConstraintsSpec:
    """The `[constraints]` table: patterns that every member of a family must or must not match.

    Attributes:
        require: patterns that must have at least one match.
        forbid: patterns that must have no match.
        count: patterns with bounds on the number of their matches, such as `{ p = "1..5", q = 3, r = "2..*" }`.
        reachable: outcomes that the agent must be able to reach.
    """

    require: tuple[LocatedName, ...] = key((), TableReader.names)
    forbid: tuple[LocatedName, ...] = key((), TableReader.names)
    count: tuple[tuple[LocatedName, tuple[int, int | None]], ...] = key((), read_match_counts)
    reachable: tuple[LocatedName, ...] = key((), TableReader.choices, what="outcome", known=("success", "failure"))


@dataclass(frozen=True, slots=True)
class MutationSpec:
    """The `[mutation]` table; the defaults are those of the paper (X. Liu and I. David, 2026).

    Attributes:
        rules: names of rules (derived rules, too), units and derived groups.
        rate: probability that a child is mutated.
        initial_applications: smallest and largest number of rule applications that make a member of the first
            population.
        max_attempts: number of attempts at a mutation that satisfies the constraints.
        strength: number of rule applications in a mutation: one, or sampled each time from a heavy-tailed distribution.
    """

    rules: tuple[LocatedName, ...] = key((), TableReader.names)
    rate: float = key(0.85, TableReader.number, low=0, high=1)
    initial_applications: tuple[int, int] = key((1, 5), TableReader.interval, most="applications")
    max_attempts: int = key(50, TableReader.integer, low=1, most="attempts")
    strength: Strength = key("single", TableReader.choice, known=get_args(Strength))


@dataclass(frozen=True, slots=True)
class SearchSpec:
    """The `[search]` table; the defaults are those of the paper (X. Liu and I. David, 2026).

    Attributes:
        population: number of members of the family.
        generations: number of generations; `false` means no limit, and another stop criterion is then required.
        keep_initial: true if the initial model is always a member of the family.
        parents: parent selection.
        survivors: survivor selection.
        time_limit: seconds after which the search stops.
        target: diversity at which the search stops: by default the largest possible one; `false` means never.
        stagnation: number of generations without improvement after which the search stops.
    """

    population: int = key(6, TableReader.integer, low=1, most="members")
    generations: int | None = key(
        1000, TableReader.unless_false, false_value=None, read=TableReader.integer, low=0, most="steps"
    )
    keep_initial: bool = key(True, TableReader.boolean)
    parents: ComponentSpec = key(ComponentSpec("parents", "random"), TableReader.named_component)
    survivors: ComponentSpec = key(ComponentSpec("survivors", "simulated_annealing"), TableReader.named_component)
    time_limit: float | None = key(None, TableReader.number, low=0)
    target: float | None = key(None, TableReader.unless_false, false_value=inf, read=TableReader.number)
    stagnation: int | None = key(None, TableReader.integer, low=1, most="steps")


@dataclass(frozen=True, slots=True)
class OptimiseSpec:
    """The `[optimise]` table, for a search of a single best model instead of a family.

    Attributes:
        maximise, minimise: names of measures, at least one in total.
        strategy: search strategy.
        steps: number of moves to try.
        time_limit: seconds after which the search stops. With a limit the result depends on the machine.
        target: value of a single objective at which the search ends.
    """

    maximise: tuple[LocatedName, ...] = key((), TableReader.names)
    minimise: tuple[LocatedName, ...] = key((), TableReader.names)
    strategy: ComponentSpec = key(ComponentSpec("strategy", "simulated_annealing"), TableReader.named_component)
    steps: int = key(10_000, TableReader.integer, low=1, most="steps")
    time_limit: float | None = key(None, TableReader.number, low=0)
    target: float | None = key(None, TableReader.number)


@dataclass(frozen=True, slots=True)
class SamplesSpec:
    """The `[samples]` table: the members are many sampled models, instead of a small family optimised as a whole.

    Attributes:
        count: number of members, including the initial model.
        cover: measures, each with a number of bins. The members are spread evenly over the bins.
        maximise, minimise: measures by which a better model replaces a member in the same bins, the most important
            first. One of the two is empty.
        attempts: number of models to try, by default ten times `count`.
    """

    count: int = key(1_000, TableReader.integer, low=2, most="members")
    cover: tuple[ComponentSpec, ...] = key((), read_cover)
    maximise: tuple[LocatedName, ...] = key((), TableReader.names)
    minimise: tuple[LocatedName, ...] = key((), TableReader.names)
    attempts: int | None = key(None, TableReader.integer, low=1, most="steps")


@dataclass(frozen=True, slots=True)
class CurriculumSpec:
    """The `[curriculum]` table: how environments are ordered for training.

    Attributes:
        order: measure that orders the environments from easy to hard.
        sequences: curricula to train on: every suffix of the family, the whole family, each member alone, or the target
            alone.
        initial: position of the initial model: last as the target, or ordered by the measure.
        schedules: adaptive schedules to compare the curricula with.
    """

    order: LocatedName | None = key(None, TableReader.string)
    sequences: CurriculumSequences = key("suffixes", TableReader.choice, known=get_args(CurriculumSequences))
    initial: Literal["last", "ordered"] = key("last", TableReader.choice, known=("last", "ordered"))
    schedules: tuple[LocatedName, ...] = key((), TableReader.choices, what="schedule", known=get_args(ScheduleName))


@dataclass(frozen=True, slots=True)
class EpsilonSpec:
    """The exploration rate `epsilon` of `[training]`: from `start`, it is multiplied by `decay` down to `minimum`.

    Attributes:
        start: probability of a random action at the beginning.
        decay: factor of the probability after each episode or step.
        minimum: smallest probability.
        per: unit of the decay.
        reset: when `epsilon` starts again: with each stage, or never.
    """

    start: float = key(1.0, TableReader.number, low=0, high=1)
    decay: float = key(0.995, TableReader.number, low=0, high=1)
    minimum: float = key(0.05, TableReader.number, low=0, high=1)
    per: Literal["episode", "step"] = key("episode", TableReader.choice, known=("episode", "step"))
    reset: Literal["stage", "never"] = key("stage", TableReader.choice, known=("stage", "never"))


def _read_epsilon(top: TableReader, name: str, default: EpsilonSpec) -> EpsilonSpec:
    section = top.table(name)
    spec = section.read(EpsilonSpec)
    if spec.minimum > spec.start and "minimum" in section:
        message = f"`minimum` is {spec.minimum}, but must be at most `start`, which is {spec.start}"
        section.error("bad-range", message, section.span("minimum"), "lower `minimum`, or raise `start`")
    return replace(spec, minimum=min(spec.minimum, spec.start))


@dataclass(frozen=True, slots=True)
class TrainingSpec:
    """The `[training]` table; the defaults are those of the paper (X. Liu and I. David, 2026).

    Attributes:
        agent: update rule.
        learning_rate: learning rate of the update.
        discount: discount of future rewards.
        epsilon: exploration rate, with the keys below.
        steps_per_environment: number of steps in a stage, on one environment.
        evaluation_episodes: number of episodes if an evaluation has to sample.
        seeds: number of training runs, each with an agent of its own.
        initial_value: initial value of every action.
        n_step: number of rewards that `sarsa` and `expected_sarsa` sum before they bootstrap (Sutton and Barto 2018,
            7.1).
        ties: choice among several best actions in training.
    """

    agent: str = key(
        "q_learning", TableReader.choice, known=("q_learning", "sarsa", "expected_sarsa", "double_q_learning")
    )
    learning_rate: float = key(0.1, TableReader.positive, high=1)
    discount: float = key(0.99, TableReader.number, low=0, high=1)
    epsilon: EpsilonSpec = key(EpsilonSpec(), _read_epsilon)
    steps_per_environment: int = key(50_000, TableReader.integer, low=1, most="steps")
    evaluation_episodes: int = key(3_000, TableReader.integer, low=1, most="episodes")
    seeds: int = key(30, TableReader.integer, low=1, most="members")
    initial_value: float = key(0.0, TableReader.number)
    n_step: int = key(1, TableReader.integer, low=1, most="attempts")
    ties: Literal["lowest", "random"] = key("lowest", TableReader.choice, known=("lowest", "random"))


@dataclass(frozen=True, slots=True)
class FamilySpec:
    """The content of a whole family file.

    Attributes:
        name: name of the family, by default that of the file's directory.
        model: path of the initial model. It must satisfy all constraints.
        environment: path of the agent's behaviour. Without it the family can be generated, but no agent can be trained.
        imports: paths of further files, such as queries that neither model nor environment import.
        seed: seed of all random choices, by default 0.
        limit: time limit of an episode in steps, by default the environment's own.
        measures: at least one, in the order of the file.
        diversity: `options["of"]` is the name of a measure.
        objective: the value of a family as a whole; None to maximise diversity. It is of a built-in kind, or has the
            options `maximise`, `minimise` and `subject_to`; then its kind is `EXPRESSION_KIND`.
        samples: number and kind of sampled members; None if a family is searched for.
        optimise: the search for a single model; None for a family.
        audit: observations and learning of the students in audits of level scores.
        ga4cl: classes with per-step rewards that fill the reward schedule of the GA4CL format.
        path: name of the file.
    """

    name: str
    model: LocatedName
    environment: LocatedName | None = None
    imports: tuple[LocatedName, ...] = ()
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
    ga4cl: tuple[LocatedName, ...] = ()
    path: str = "family.toml"
    source: Source | None = field(default=None, compare=False, repr=False)

    def has_key(self, *key: str) -> bool:
        """Return True if the family has an objective and its file has this key, such as "search", "population"."""
        text = self.objective.text if self.objective else None
        return text is not None and key in text.values

    @property
    def chooses_steps(self) -> bool:
        """Return True if the file does not set the number of training steps on each member, or has no objective.

        A search with an objective then chooses the steps itself.
        """
        steps = ("training", "steps_per_environment"), ("objective", "steps")
        return not any(self.has_key(*key) for key in steps)

    @property
    def files(self) -> tuple[str, ...]:
        """Return the names of all files that the family uses."""
        named = [self.model, *self.imports, *([self.environment] if self.environment else [])]
        return tuple(dict.fromkeys(str(one) for one in named))

    @property
    def uses_genetic_algorithm(self) -> bool:
        """Return True if the genetic algorithm generates the family, not a search over whole families or samples."""
        return not self.searches_whole_families and self.samples is None

    @property
    def searches_whole_families(self) -> bool:
        """Return True if the search changes whole families to improve the objective, instead of single members."""
        found = self.objective
        whole = found is not None and (found.kind != EXPRESSION_KIND or found.options.get("search") == "climb")
        return whole and self.samples is None

    @property
    def uses_diversity(self) -> bool:
        """Return True if a diversity is maximised, or the file has the table `[diversity]`."""
        text = self.diversity.text
        has_table = text is not None and any(key[0] == "diversity" for key in text.values)
        return has_table or self.uses_genetic_algorithm

    @property
    def size(self) -> int:
        """Return the number of members that the family should have."""
        return self.search.population if self.samples is None else self.samples.count

    def measure(self, name: str) -> ComponentSpec | None:
        """Return the measure of this name; None if there is none."""
        return next((measure for measure in self.measures if measure.name == name), None)
