"""Write the pictures of `docs/tutorials/maze.md` from the files that the page shows: `python docs/pictures/maze.py`.

The picture of the training needs Stable-Baselines3, and is skipped without it.
"""

from __future__ import annotations

import contextlib
import re
import tempfile
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path

import envgraph
from envgraph.env import Simulator, scene_svg
from envgraph.lang import load_workspace
from envgraph.report import Series, line_chart, standalone_chart
from envgraph.search import Family, generate

TUTORIALS = Path(__file__).parents[1] / "tutorials"
FILE = re.compile(r"^```\w+ (\S+) file.*?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PIXELS, GAP = 26, 14
STEPS, CHUNKS = 204_800, 10
OPTIONS = {"n_steps": 32, "batch_size": 1024, "n_epochs": 4, "learning_rate": 1e-3, "ent_coef": 0.01, "gamma": 0.98}


def save_files(folder: Path) -> None:
    """Write the files that the page shows, without the mistake that its reader corrects."""
    for name, text in FILE.findall((TUTORIALS / "maze.md").read_text("utf-8")):
        (folder / name).write_text(text.replace("Gul(", "Gull("), "utf-8")


def elements(picture: str) -> str:
    """Return what is inside an SVG text, without its title and the signs of sand."""
    inside = picture.split("\n", 2)[2].rpartition("</svg>")[0]
    return re.sub(r"<text [^>]*>\.</text>\n", "", inside)


def side_by_side(pictures: Sequence[str], names: Sequence[str], cells: int, title: str) -> str:
    """Return grids of `cells` times `cells` beside each other, each with its name below, as one SVG text."""
    side = cells * PIXELS
    width, height = len(pictures) * (side + GAP) + GAP, side + 2 * GAP + 20 * any(names)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img" aria-label="{title}" font-family="ui-monospace, monospace" text-anchor="middle">',
        f'<title>{title}</title>\n<rect width="{width}" height="{height}" fill="white"/>',
    ]
    for number, (picture, name) in enumerate(zip(pictures, names, strict=True)):
        left = GAP + number * (side + GAP)
        parts += [f'<g transform="translate({left} {GAP}) scale({PIXELS})">', f"{elements(picture)}</g>"]
        if name:
            place = f'x="{left + side / 2:g}" y="{side + GAP + 20}"'
            parts.append(f'<text {place} font-family="sans-serif" font-size="14" fill="#1f2933">{name}</text>')
    return "\n".join((*parts, "</svg>\n"))


def window_picture() -> str:
    """Return the beach after the three steps of the page, with the cells that the crab does not see greyed."""
    workspace = load_workspace(["beach.model", "beach.environment"])
    simulator = Simulator(workspace.engine(), workspace.behaviour())
    for action in (1, 1, 2):
        simulator.step_with(action, 0.0)
    drawn = scene_svg(simulator.painter().draw())
    hidden = "".join(
        f'<rect x="{x}" y="{y}" width="1" height="1" fill="#ffffff" opacity="0.72"/>\n'
        for x in range(7)
        for y in range(7)
        if abs(x - 1) > 2 or abs(y - 2) > 2
    )
    return drawn.replace("</svg>", f"{hidden}</svg>")


def training_picture(beaches: Family) -> str:
    """Return the share of unseen beaches that PPO solves in the course of the two trainings of the page."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

    import envgraph.sb3

    torch.set_num_threads(1)
    train, test = ([member.name for member in part.members] for part in beaches.split(0.2, seed=1))
    tests = envgraph.sb3.make_vec(beaches, len(test), test)
    lines = []
    for label, names in (("trained on 320 beaches", train), ("trained on one beach", ["E400"])):
        envs = VecNormalize(envgraph.sb3.make_vec(beaches, 256, names, schedule="uniform"), gamma=0.98)
        model, steps, shares = PPO("MlpPolicy", envs, seed=0, device="cpu", **OPTIONS), [0.0], [0.0]
        for _ in range(CHUNKS):
            model.learn(STEPS // CHUNKS, reset_num_timesteps=False)
            steps.append(float(model.num_timesteps))
            shares.append(float(envgraph.sb3.evaluate(model, tests).success.mean()))
        lines.append(Series(label, tuple(steps), tuple(shares), has_points=True))
    titles = {"x_label": "steps of training", "y_label": "share of 80 unseen beaches solved"}
    return standalone_chart(line_chart(lines, title="Success on unseen beaches", **titles))


def pictures() -> Iterator[tuple[str, str]]:
    """Yield the name and the text of each picture; the present directory has the files of the page."""
    yield "classes", envgraph.open("beach.model").model.metamodel.picture().to_svg(graphviz=False)
    beaches = generate("family.toml", Path("run.sqlite"))
    target = beaches.members[-1]
    yield "world", side_by_side([beaches.svg(target)], [""], 7, "The beach of the page: the target")
    yield "window", side_by_side([window_picture()], [""], 7, "The cells that the crab sees")
    chosen = [beaches.member(name) for name in ("E1", "E150", "E320", "E399")]
    names = [f"{one.name}, {one.measures['plan']:.0f} steps" for one in chosen]
    yield "family", side_by_side([beaches.svg(one) for one in chosen], names, 7, "Four of 400 beaches")
    if find_spec("stable_baselines3") is not None:
        yield "training", training_picture(beaches)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        save_files(Path(folder))
        for name, text in pictures():
            (TUTORIALS / f"maze-{name}.svg").write_text(text, "utf-8")
