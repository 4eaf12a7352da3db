"""Write an episode that was played into a file: as an animation, or as data."""

from __future__ import annotations

from typing import Any

from envgraph.draw import LAST_STEPS, STEP_SECONDS, SvgFrame, film
from envgraph.env._played_episode import PlayedEpisode
from envgraph.env.scene._scene import DRAW_HINT, Scene
from envgraph.env.scene._scene_svg import scene_svg
from envgraph.errors import InvalidArgument

END_NAMES = {1: "success", 2: "failure", -1: "truncated"}
"""By number in `PlayedStep.end`: how an episode ended."""


def episode_svg(episode: PlayedEpisode, title: str) -> str:
    """Return an animated SVG of the steps so far; `title` is its first words.

    Raises:
        InvalidArgument: the behaviour has no `draw` clause.
    """
    pictures = [scene_svg(scene) for scene in _scenes(episode)]
    frames = [SvgFrame(pictures[0], "start")]
    totals, end = episode.totals, END_NAMES.get(episode.end, "")
    for number, (step, svg) in enumerate(zip(episode.steps, pictures[1:], strict=True), 1):
        result = f"{END_NAMES.get(step.end, '')} total {totals[number]:z.4g}".strip()
        frames.append(SvgFrame(svg, f"{number}: {step.name}", result))
    count = len(episode.steps)
    words = f"{title}: {count} step{'s' * (count != 1)}, {end and end + ', '}total {totals[-1]:z.4g}"
    return film(frames, words)


def episode_gif(episode: PlayedEpisode) -> bytes:
    """Return an animated GIF of the steps so far. Raise InvalidArgument if the behaviour has no `draw` clause."""
    from envgraph.env.scene._gif import animated_gif  # needs NumPy
    from envgraph.env.scene._pixels import scene_rgb

    pictures = [scene_rgb(scene) for scene in _scenes(episode)]
    seconds = [STEP_SECONDS] * (len(pictures) - 1) + [STEP_SECONDS * LAST_STEPS]
    return animated_gif(pictures, seconds)


def episode_to_dict(episode: PlayedEpisode) -> dict[str, Any]:
    """Return the steps so far as JSON-ready data; `random` are the random numbers of the reset and of each step."""
    steps = [{"action": step.name, "reward": step.reward} for step in episode.steps]
    end, reason = END_NAMES.get(episode.end), episode.steps[-1].reason if episode.steps else ""
    found = {"environment": episode.simulator.behaviour.name, "steps": steps, "total": episode.totals[-1]}
    return {**found, "end": end, "reason": reason, "random": [*episode.uniforms]}


def _scenes(episode: PlayedEpisode) -> list[Scene]:
    scenes = episode.scenes
    if not scenes:
        raise InvalidArgument(f"environment `{episode.simulator.behaviour.name}` has no pictures", DRAW_HINT)
    return scenes
