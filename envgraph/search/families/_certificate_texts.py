"""Format the certificates of members for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import floor, log10
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from envgraph.search.families._member_family import Member


def format_certificates(member: Member, family: Sequence[Member] = ()) -> list[tuple[str, str]]:
    """Format a member's certificates as pairs of a name and a text for people.

    A member without certificates is "not verified" if other members of `family` have certificates, else the result is
    [].
    """
    said = member.certificates
    if not said:
        return [("shortest plan", "not verified")] if any(one.certificates for one in family) else []
    plan, limit, best = said["shortest_plan"], said["limit"], said["optimal_return"]
    walk = f"random walk in the family, {limit:.0f} steps"
    if "sampled_episodes" not in said:
        return [
            ("shortest plan", "none" if plan is None else f"{plan:.0f}"),
            (walk, f"{said['random_success']:.3g}"),
            ("optimal return", "not finite" if best is None else f"{best:z.3f}"),
        ]
    found, gain, how = said["plan_found"], said["plan_return"], f"(sampled, {said['sampled_episodes']:,.0f} episodes)"
    pairs = [
        ("shortest plan", "none found" if found is None else f"{'at most ' if plan is None else ''}{found:.0f}"),
        ("return of the plan", "" if gain is None else f"{gain:z.3f}"),
        (walk, f"{_format_estimate(said, 'sampled_success')} {how}"),
        ("return of the walk", f"{_format_estimate(said, 'sampled_return')} (sampled)"),
        ("optimal return", "not computed"),
    ]
    if "sampled_legal_success" in said:
        means = (_format_estimate(said, f"sampled_legal_{mean}") for mean in ("success", "return"))
        pairs.insert(-1, ("walk of legal actions", " (sampled), return ".join(means)))
    return pairs


def _format_estimate(said: Mapping[str, Any], name: str) -> str:
    """Return a mean "± distance" to the farther end of its interval, rounded to the first digit of the distance."""
    mean = said[name]
    half = max(mean - said[f"{name}_low"], said[f"{name}_high"] - mean)
    places = max(0, -floor(log10(half))) if half > 0.0 else 3
    return f"{mean:z.{places}f} ± {half:.{places}f}"
