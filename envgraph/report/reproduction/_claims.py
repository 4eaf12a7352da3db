"""What the paper says, beside what many seeds say."""

from __future__ import annotations

from collections.abc import Iterator
from statistics import fmean
from typing import Literal

from envgraph.code import dataclass
from envgraph.learn import Summary, bootstrap_interval, compare, wilson_interval
from envgraph.report.reproduction._published import AGENTS, NORMAL
from envgraph.report.reproduction._runs import Budget, Reproduction, Sample

Verdict = Literal["holds", "does not hold", "holds in part", "depends on the seed", "undecided"]

NEARLY_ALL, NEARLY_NONE = 0.95, 0.05
"""An interval of success above the one, or below the other, is what the paper calls 100 % and 0 %."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A sentence of the paper, or what it lets one expect.

    Attributes:
        text: the sentence.
        paper: what was published.
        here: what was found.
        verdict: whether it holds; "depends on the seed" where some agents do what the published one did, and some not.
    """

    text: str
    paper: str
    here: str
    verdict: Verdict


def claims(found: Reproduction) -> list[Claim]:
    """What of the paper holds, in the order of its text; without what was not trained or measured."""
    return [
        *_agents(found),
        *_budgets(found),
        *_random(found),
        *_ordering(found),
        *_reverse(found),
        *_own(found),
        *_times(found),
    ]


def percent(rate: float, interval: tuple[float, float] | None = None) -> str:
    """A rate, and where it lies at 95 %.

    >>> percent(0.5, (0.41, 0.59))
    '50 % (41-59)'
    """
    return f"{rate:.0%}".replace("%", " %") + (
        f" ({interval[0]:.0%}-{interval[1]:.0%})" if interval else ""
    ).replace("%", "")


def summaries(budget: Budget) -> dict[str, Summary]:
    """What became of the published family, by label."""
    return {one.label: one for one in budget.experiment.best_optimistic().summaries()}


def interval(sample: Sample) -> tuple[float, float]:
    """Of the mean success over the families, at 95 %: the bootstrap's, or Wilson's where each has one agent."""
    if sample.agents == 1:
        return wilson_interval(fmean(sample.success), len(sample.success))
    return bootstrap_interval(sample.success) or (0.0, 1.0)


def _success(one: Summary) -> str:
    return f"{one.label} {percent(one.success_rate, one.success_interval)}"


def _judged(rates: list[float], intervals: list[tuple[float, float]], wanted: list[float]) -> Verdict:
    """Whether success is nearly all or nearly none, as it was published."""
    pairs = [*zip(intervals, wanted, strict=True)]
    if all(low >= NEARLY_ALL if rate else high <= NEARLY_NONE for (low, high), rate in pairs):
        return "holds"
    if any(high < 0.5 if rate else low > 0.5 for (low, high), rate in pairs):
        return "does not hold"
    return "depends on the seed" if any(NEARLY_NONE < rate < NEARLY_ALL for rate in rates) else "undecided"


def _agents(found: Reproduction) -> Iterator[Claim]:
    """Table 3."""
    for budget in found.budgets:
        if budget.steps != NORMAL:
            continue
        every = summaries(budget)
        for text, labels in (
            ("Agents that were trained on one environment alone do not succeed on E6", [*AGENTS][:6]),
            ("Agents of the curricula E1-E6 to E4-E6 succeed on E6", [*AGENTS][6:10]),
            ("Agents of E5-E6 do not", [*AGENTS][10:]),
        ):
            ones = [every[label] for label in labels]
            wanted = [AGENTS[label][0] for label in labels]
            verdict = _judged(
                [one.success_rate for one in ones], [one.success_interval for one in ones], wanted
            )
            yield Claim(text, percent(wanted[0]), ", ".join(map(_success, ones)), verdict)
        for optimistic in (one for label, one in every.items() if label.startswith("optimistic")):
            yield Claim(
                "Training on E6 alone cannot solve it",
                "0 %",
                f"values that begin at 0: {percent(every['E6'].success_rate)}; "
                f"{optimistic.label}, the best of several, with as many steps: {percent(optimistic.success_rate)}",
                "holds" if optimistic.success_interval[1] <= NEARLY_NONE else "holds in part",
            )


def _budgets(found: Reproduction) -> Iterator[Claim]:
    """Table 5, the curriculum."""
    ones = [(budget.steps, summaries(budget)["E1-E6"]) for budget in found.budgets]
    here = ", ".join(f"{steps:,}: {percent(one.success_rate, one.success_interval)}" for steps, one in ones)
    verdict = _judged(
        [one.success_rate for _, one in ones], [one.success_interval for _, one in ones], [1.0] * len(ones)
    )
    yield Claim("The generated curriculum reaches 100 % with every budget", "100 %", here, verdict)


def _random(found: Reproduction) -> Iterator[Claim]:
    """Table 5, the others."""
    parts, below = [], []
    for budget in found.budgets:
        one = summaries(budget)["E1-E6"]
        sample = budget.samples["random"]
        parts.append(
            f"{budget.steps:,}: {percent(one.success_rate)} against {percent(fmean(sample.success), interval(sample))}"
        )
        below.append(interval(sample)[1] < one.success_interval[0])
    text = "Random families never reach what the generated one does"
    verdict: Verdict = "holds" if all(below) else "holds in part" if any(below) else "undecided"
    yield Claim(text, "100 % against 10, 47 and 63 %", ", ".join(parts), verdict)


def _ordering(found: Reproduction) -> Iterator[Claim]:
    """The same random families in both orders: a difference for each of them."""
    pairs = [
        fmean(
            ordered - drawn
            for ordered, drawn in zip(
                (budget.samples["ordered"].success[place] for budget in found.budgets),
                (budget.samples["random"].success[place] for budget in found.budgets),
                strict=True,
            )
        )
        for place in range(len(found.budgets[0].samples["random"].success))
    ]
    low, high = bootstrap_interval(pairs) or (0.0, 0.0)
    yield Claim(
        "To order random families by complexity raises their success slightly",
        "+3, -4 and 0 points",
        f"{100 * fmean(pairs):+.1f} points ({100 * low:+.1f} to {100 * high:+.1f}), mean of the budgets",
        "holds" if low > 0 else "does not hold" if high < 0 else "undecided",
    )


def _reverse(found: Reproduction) -> Iterator[Claim]:
    """The order of the generated family."""
    compared = {
        budget.steps: next((one for one in compare(budget.experiment) if one.control == "reversed"), None)
        for budget in found.budgets
    }
    ones = {steps: one for steps, one in compared.items() if one is not None}
    verdicts = {one.verdict for one in ones.values()}
    verdict: Verdict = (
        "does not hold" if "worse" in verdicts else "holds" if "better" in verdicts else "undecided"
    )
    here = ", ".join(
        f"{steps:,}: {percent(one.value)} against {percent(one.other)}" for steps, one in ones.items()
    )
    yield Claim("From easy to hard is the order that teaches", "not compared", f"{here} reversed", verdict)


def _own(found: Reproduction) -> Iterator[Claim]:
    """The method rather than the one family that it led to."""
    samples = [(budget.steps, budget.samples["own"]) for budget in found.budgets]
    here = ", ".join(f"{steps:,}: {percent(fmean(one.success), interval(one))}" for steps, one in samples)
    most = max(found.diversity)
    diverse = sum(one >= most - 1e-9 for one in found.diversity) / len(found.diversity)
    yield Claim(
        "The approach generates families that teach",
        "100 % (one family)",
        f"{len(found.diversity)} families, {percent(diverse)} of them with {most:.3f} bits, one agent each: {here}",
        _judged(
            [fmean(one.success) for _, one in samples],
            [interval(one) for _, one in samples],
            [1.0] * len(samples),
        ),
    )


def _times(found: Reproduction) -> Iterator[Claim]:
    """Table 4."""
    if found.times:
        sizes = {size: seconds for size, seconds in found.times[min(found.times)].items()}
        small, large = min(sizes), max(sizes)
        growth = sizes[large] / sizes[small]
        yield Claim(
            "The time of generation scales well with the size of the map",
            "47 s at 8x8, 50 s at 12x12",
            f"{sizes[small]:.1f} s at {small}x{small}, {sizes[large]:.1f} s at {large}x{large}",
            "holds" if growth < (large / small) ** 2 else "does not hold",
        )
