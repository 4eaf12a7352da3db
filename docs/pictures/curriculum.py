"""Write the pictures of `docs/tutorials/curriculum.md`: `python docs/pictures/curriculum.py`."""

from __future__ import annotations

import contextlib
import re
import sys
import tempfile
from pathlib import Path

from envgraph.cli import main
from envgraph.learn import FamilyMember, TrainingSettings, controls, other_starts, run_experiment, sequences
from envgraph.report import Series, line_chart, standalone_chart
from envgraph.search import Family, generate

TUTORIALS = Path(__file__).parents[1] / "tutorials"
PIXELS, GAP, COLUMNS = 22, 14, 3
STEPS = (50, 100, 150, 200, 250, 300, 400, 600, 800, 1000, 1200, 1500, 1800, 2000)
"""Steps on each of the six members."""


def elements(picture: str) -> str:
    """Return what is inside an SVG text, without its title and the signs of floor."""
    inside = picture.split("\n", 2)[2].rpartition("</svg>")[0]
    return re.sub(r"<text [^>]*>[.#]</text>\n", "", inside)


def family_picture(family: Family) -> str:
    """Return the members in rows of three, each with its name and its plan below, as one SVG text."""
    side, row = 8 * PIXELS, 8 * PIXELS + 2 * GAP + 10
    width, height = COLUMNS * (side + GAP) + GAP, 2 * row + GAP
    title = "Six mazes; the robot begins ever farther from the goal"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img" aria-label="{title}" font-family="ui-monospace, monospace" text-anchor="middle">',
        f'<title>{title}</title>\n<rect width="{width}" height="{height}" fill="white"/>',
    ]
    for number, member in enumerate(family.members):
        left, top = GAP + number % COLUMNS * (side + GAP), GAP + number // COLUMNS * row
        parts += [f'<g transform="translate({left} {top}) scale({PIXELS})">', f"{elements(family.svg(member))}</g>"]
        place = f'x="{left + side / 2:g}" y="{top + side + 18}"'
        name = f"{member.name}: {member.measures['plan']:.0f} steps"
        parts.append(f'<text {place} font-family="sans-serif" font-size="14" fill="#1f2933">{name}</text>')
    return "\n".join((*parts, "</svg>\n"))


def steps_picture(family: Family) -> str:
    """Return the share of 100 agents that solve the target, by the steps of their training, as a chart."""
    members = [FamilyMember(one.name, family.explored(one).tabular) for one in family.members]
    names, target = [one.name for one in members], members[-1].tabular
    labels = {"E1-E6": "curriculum", "backplay": "backplay", "E6": "target alone"}
    shares: dict[str, list[float]] = {label: [] for label in labels}
    for steps in STEPS:
        settings = TrainingSettings(steps_per_environment=steps, limit=100)
        starts = other_starts(names[-1], target, settings.limit)
        ways = [*sequences(names, "full"), *controls(names, starts=[*starts])]
        chosen = [way for way in ways if way.label in labels]
        for one in run_experiment(members, settings, chosen, seeds=range(1000, 1100), starts=starts).summaries():
            shares[one.label].append(one.success_rate)
    x = tuple(6.0 * steps for steps in STEPS)
    lines = [Series(labels[label], x, tuple(found), has_points=True) for label, found in shares.items()]
    titles = {"x_label": "steps of training in all", "y_label": "share of 100 agents that solve E6"}
    return standalone_chart(line_chart(lines, title="How many steps the target needs", **titles))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        sys.argv = ["envgraph", "new", "maze"]
        with contextlib.redirect_stdout(None), contextlib.suppress(SystemExit):
            main()
        family = generate("maze", Path("run.sqlite"))
        (TUTORIALS / "curriculum-family.svg").write_text(family_picture(family), "utf-8")
        (TUTORIALS / "curriculum-steps.svg").write_text(steps_picture(family), "utf-8")
