"""The diversity of a generated family, and the reasons for a low diversity."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import field
from itertools import groupby
from math import inf

from envgraph.code import dataclass
from envgraph.draw import html_text
from envgraph.errors import SHOWN, TOLERANCE, Diagnostic, Severity
from envgraph.lang import Strength
from envgraph.search._run_store import RunStore, _checked_texts
from envgraph.search.families._member_family import Family
from envgraph.search.problem._problem import Problem
from envgraph.search.problem._statistics import BinnedEntropy

_LOW_SUCCESS_RATE = 0.5
"""A warning is given if a smaller share of learners solves the target."""

_NEEDLESS_DIFFERENCE = 0.05
"""The target needs no other members if the success of training on it alone is lower by at most this share."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The diversity of a family, and the value of its objective.

    Attributes:
        diversity: diversity of the members.
        maximum: largest possible diversity of a family of the wanted size; infinite if it is unknown.
        unit: "bits", or "" if the diversity has no unit.
        bins: number of each member's bin, from 1, in the order of the curriculum; empty without bins.
        objective: values of the objective's terms; {} without an objective. See `Family.objective`.
        target: name of the last member.
        wants_diversity: True if the search asked for diversity.
    """

    diversity: float
    maximum: float
    unit: str = ""
    bins: tuple[int, ...] = ()
    objective: Mapping[str, float] = field(default_factory=dict)
    target: str = ""
    wants_diversity: bool = True

    @classmethod
    def of(cls, family: Family) -> Outcome:
        """Return the outcome of the search that generated a family."""
        problem = family.domain.problem(family.domain.engine())
        values, measure = _diversity_values(family, problem), problem.diversity
        maximum = problem.largest_diversity(family.domain.spec.size)
        bins: tuple[int, ...] = ()
        if isinstance(measure, BinnedEntropy):
            bins = tuple(measure.bin_of(value) + 1 for value in values)
        unit, target, spec = "bits" if bins else "", family.members[-1].name, family.domain.spec.objective
        diverse = "steps" not in family.objective or (spec is not None and "diversity" in spec.options)
        diverse = diverse and (family.domain.spec.samples is None or family.domain.spec.uses_diversity)
        return cls(measure.score(values), maximum, unit, bins, family.objective, target, diverse)

    _repr_html_ = html_text

    def __str__(self) -> str:
        limit = f" of {self.maximum:.3f}" if self.maximum < inf else ""
        unit = f" {self.unit}" if self.unit else ""
        bins = f", members in bins {','.join(map(str, self.bins))}" if self.bins else ""
        if len(self.bins) > SHOWN.rows:
            counts = [f"{number} ({count:,})" for number, count in sorted(Counter(self.bins).items())]
            bins = f", members in bins {', '.join(counts)}" if len(counts) <= SHOWN.rows // 4 else ""
            bins = bins or f", members in {len(counts)} bins"
        parts = [f"{name} {value:.3f}" for name, value in self.objective.items()]
        if "steps" in self.objective:
            success, *_ = self.objective.values()
            steps, fewest, alone = (self.objective[name] for name in ("steps", "fewest", "alone"))
            several = f"{fewest:,.0f} to " if fewest < steps else ""
            parts = [
                f"{success:.1%} of new learners solve {self.target} after {several}{steps:,.0f} steps in all",
                f"{alone:.1%} after as many steps on {self.target} alone",
            ]
        if self.wants_diversity:
            parts.append(f"diversity {self.diversity:.3f}{limit}{unit}{bins}")
        return ", ".join(parts)


def why_low(family: Family, store: RunStore) -> Diagnostic | None:
    """Return a warning with the reason for a low diversity and a remedy; None if the diversity is not low.

    The first reason that applies is reported: a violated condition of the objective, missing members, values outside of
    the range, bins that no model reached, or a search that ended too early.
    """
    outcome = Outcome.of(family)
    wanted, found = family.domain.spec.size, len(family.members)
    low = family.domain.spec.samples is None and outcome.diversity < outcome.maximum - TOLERANCE
    if family.violated_conditions:
        return _violated_condition_warning(family)
    if "steps" in family.objective and (family.value or 0.0) < _LOW_SUCCESS_RATE:
        return _low_success_warning(family)
    if family.domain.spec.objective is not None or (found >= wanted and (not low or outcome.maximum == inf)):
        return None  # an objective is maximised instead of the diversity
    problem, spec = family.domain.problem(family.domain.engine()), family.domain.spec
    of, values = problem.diversity_measure_name, _diversity_values(family, problem)
    met = [one.measures[of] for one in store.individuals()]
    rejected = _format_rejections(store.rejection_counts(), len(met))
    span = spec.diversity.span()
    if found < wanted:
        code, span = "small-family", spec.mutation.rules[0].span if spec.mutation.rules else None
        message = f"only {found} of {wanted} environments that satisfy the constraints were found{rejected}"
        tries = "`attempts` of `[samples]`" if spec.samples else "`max_attempts`"
        hint = f"check that the mutation rules match, loosen the constraints, or raise {tries}"
        return Diagnostic(code, message, span, hint, Severity.WARNING)
    hint = _continue_hint(store)
    message = f"every bin was reached by some model, but no family has members in all bins{rejected}"
    if not isinstance(problem.diversity, BinnedEntropy):
        message = f"all values of `{of}` were from {min(met):g} to {max(met):g}{rejected}"
    else:
        bins = problem.diversity
        outside = sum(not bins.low <= value <= bins.high for value in values)
        empty = set(range(bins.bins)).difference(map(bins.bin_of, met))
        if outside:
            message = (
                f"`{of}` of {outside} of {found} members is outside of the range {bins.low:g} to {bins.high:g}, "
                "and counts in the first or last bin"
            )
            hint = f"write {_format_range(met)} in `[diversity]`: values were from {min(met):g} to {max(met):g}"
        elif empty:
            message = f"no model reached {_format_bins(bins, sorted(empty))} of `{of}`{rejected}"
            hint = (
                f"use mutations that change `{of}` more{_mutation_strength_hint(spec.mutation.strength)}, loosen the "
                f"constraints, raise `generations`, or write {_format_range(met)} in `[diversity]`, the range of the "
                "values so far"
            )
    return Diagnostic("low-diversity", f"the diversity is below its maximum: {message}", span, hint, Severity.WARNING)


def describe_search(family: Family, store: RunStore) -> list[str]:
    """Return sentences about the search for a family with a learning objective; [] for other families."""
    found, known = store.objective, family.objective
    if "steps" not in known:
        return []
    target = family.members[-1].name
    sentences = [f"the environments before {target} are {found['origin']}"]
    exempted = ", ".join(f"`{text}`" for text in _checked_texts(found.get("exempted", [])))
    if exempted:
        sentences.append(f"only {target} has to satisfy these constraints: {exempted}")
    if known["alone"] > max(_LOW_SUCCESS_RATE, (family.value or 0.0) - _NEEDLESS_DIFFERENCE):
        sentences.append(
            f"the other environments are not needed: as many steps on {target} alone have the same success"
        )
    elif "unsearched" in known:
        sentences[0] += f", improved by search: without search {known['unsearched']:.1%} of learners succeed"
    elif "eased" not in sentences[0]:
        sentences[0] += ", unchanged: the search found nothing better"
    return sentences


def _low_success_warning(family: Family) -> Diagnostic:
    """Return the warning that fewer than half of the learners solve the target."""
    spec = family.domain.spec.objective
    message = f"the family teaches little: {family.value:.1%} of new learners solve {family.members[-1].name}"
    hint = "raise `effort`, or remove `steps_per_environment` and `population`, so that the search chooses them"
    return Diagnostic("teaches-little", message, spec.span() if spec else None, hint, Severity.WARNING)


def _violated_condition_warning(family: Family) -> Diagnostic:
    """Return the warning about the condition of the objective that is violated most."""
    text, excess = max(family.violated_conditions.items(), key=lambda one: one[1])
    spec = family.domain.spec.objective
    texts = spec.options.get("subject_to", []) if spec else []
    place = f"subject_to[{texts.index(text)}]" if isinstance(texts, list) and text in texts else "subject_to"
    message = f"the family violates `{text}` by {excess:.3g}"
    hint = "raise `generations` or `effort`, use mutations that change more, or relax the condition"
    return Diagnostic("unsatisfied", message, spec.span(place) if spec else None, hint, Severity.WARNING)


def _mutation_strength_hint(strength: Strength) -> str:
    return ', such as `strength = "heavy_tailed"` in `[mutation]`' if strength == "single" else ""


def _diversity_values(family: Family, problem: Problem) -> list[float]:
    return [member.measures[problem.diversity_measure_name] for member in family.members]


def _format_range(values: Sequence[float]) -> str:
    """Return a setting for a range that contains the values. If all values are equal, the range is widened."""
    low, high = min(values), max(values)
    return f"`range = [{low:g}, {high if high > low else low + 1:g}]`"


def _format_bins(measure: BinnedEntropy, empty_bins: Sequence[int]) -> str:
    """Format the numbers of empty bins, from 1, with the ranges of their values."""
    width = (measure.high - measure.low) / measure.bins
    runs = [[one for _, one in run] for _, run in groupby(enumerate(empty_bins), key=lambda pair: pair[1] - pair[0])]
    parts = [
        (f"{run[0] + 1}" if len(run) == 1 else f"{run[0] + 1} to {run[-1] + 1}")
        + f" ({measure.low + run[0] * width:.3g} to {measure.low + (run[-1] + 1) * width:.3g})"
        for run in runs
    ]
    return f"bin{'s' if len(empty_bins) > 1 else ''} {', '.join(parts)}"


def _format_rejections(reasons: Mapping[str, int], number_accepted: int) -> str:
    """Return a text about the most frequent reason of rejection; "" if no more models were rejected than accepted."""
    rejected = sum(reasons.values())
    if rejected <= number_accepted:
        return ""
    most = max(reasons, key=lambda reason: reasons[reason])
    return f"; {rejected} of {rejected + number_accepted} mutations were rejected, {reasons[most]} because {most}"


def _continue_hint(store: RunStore) -> str:
    last = store.last_generation()
    number = last.number if last else 0
    return f"continue with `--resume --generations {2 * max(1, number)}`, or use mutations that change more"
