"""Recordings of episodes: what an independent reader of GIF sees, and what the SVG and the data contain."""

from __future__ import annotations

import random
from struct import unpack_from

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

import envgraph
from envgraph.draw import SvgFrame, film
from envgraph.env import PlayedEpisode, episode_gif, episode_svg, episode_to_dict, scene_rgb
from envgraph.env.scene._gif import animated_gif
from envgraph.errors import InvalidArgument
from tests.unit.env.coins import simulator


def decompressed(codes: bytes) -> list[int]:
    """Return the numbers of colours of an LZW stream with 256 colours, as the standard says how to read it."""
    bits, place, table, found = 9, 0, dict[int, list[int]](), list[int]()
    before: list[int] | None = None
    stream = int.from_bytes(codes, "little")
    while True:
        code = stream >> place & (1 << bits) - 1
        place += bits
        if code == 257:
            assert place <= 8 * len(codes) < place + 8, "the stream ends with the code of the end"
            return found
        if code == 256:
            bits, table, before = 9, {}, None
            continue
        entry = [code] if code < 256 else table[code] if code in table else [*(before or []), (before or [])[0]]
        if before is not None and len(table) < 4096 - 258:
            table[258 + len(table)] = [*before, entry[0]]
        bits = min(12, max(9, (258 + len(table)).bit_length()))
        found += entry
        before = entry


def frames_of(gif: bytes) -> list[tuple[NDArray[np.uint8], int]]:
    """Return what a GIF shows: each picture [height, width, 3], and its time in hundredths of a second."""
    assert gif[:6] == b"GIF89a" and gif[10] == 0xF7
    width, height = unpack_from("<HH", gif, 6)
    palette = np.frombuffer(gif[13 : 13 + 768], np.uint8).reshape(256, 3)
    canvas, found, place, time = np.zeros((height, width, 3), np.uint8), [], 13 + 768, 0
    while gif[place] != 0x3B:
        if gif[place] == 0x2C:
            left, top, across, down = unpack_from("<HHHH", gif, place + 1)
            place += 11
        else:
            time = unpack_from("<H", gif, place + 4)[0] if gif[place + 1] == 0xF9 else time
            across, place = 0, place + 2
        blocks = b""
        while gif[place]:
            blocks += gif[place + 1 : place + 1 + gif[place]]
            place += 1 + gif[place]
        place += 1
        if across:
            numbers = np.array(decompressed(blocks)).reshape(down, across)
            canvas[top : top + down, left : left + across] = palette[numbers]
            found.append((canvas.copy(), time))
    return found


@given(st.integers(0, 2**32), st.integers(1, 70), st.sampled_from([1, 2, 200]))
def test_gif_shows_the_pictures_for_their_times(seed: int, side: int, colours: int) -> None:
    rng = np.random.default_rng(seed)
    palette = rng.integers(256, size=(colours, 3), dtype=np.uint8)
    pictures = [palette[rng.integers(colours, size=(side, 3 * side))] for _ in range(2)]
    shown = frames_of(animated_gif([*pictures, pictures[1]], [0.6, 1, 2.4]))
    assert [time for _, time in shown] == [60, 100, 240]
    for (picture, _), wanted in zip(shown, [*pictures, pictures[1]], strict=True):
        assert np.array_equal(picture, wanted)


def test_gif_of_many_colours_rounds_them_and_of_two_sizes_has_paper_around_the_smaller_picture() -> None:
    many = np.random.default_rng(0).integers(256, size=(40, 40, 3), dtype=np.uint8)
    (first, _), (second, _) = frames_of(animated_gif([many, many[:10]], [1, 1]))
    assert np.abs(first.astype(int) - many).max() < 64
    assert second.shape == first.shape and len(np.unique(second[10:].reshape(-1, 3), axis=0)) == 1


def played(domain: str) -> PlayedEpisode:
    env = envgraph.make(domain=domain, engine="live").unwrapped
    episode = PlayedEpisode(env.simulator, None, random.Random(0).random)  # type: ignore[attr-defined]
    for action in (0, 1, 2):
        episode.choose(action)
    return episode


def test_recordings_have_the_steps_that_were_not_undone() -> None:
    episode = played("keydoor")
    assert len(frames_of(episode_gif(episode))) == 4
    episode.undo()
    pictures = [scene_rgb(scene) for scene in episode.scenes]
    assert all(
        np.array_equal(one, wanted) for (one, _), wanted in zip(frames_of(episode_gif(episode)), pictures, strict=True)
    )
    text = episode_svg(episode, "Two rooms")
    assert 'aria-label="Two rooms: 2 steps, total -0.02"' in text and "prefers-reduced-motion" in text
    assert [f"{number}: {step.name}" in text for number, step in enumerate(episode.steps, 1)] == [True, True]
    data = episode_to_dict(episode)
    assert [step["action"] for step in data["steps"]] == [step.name for step in episode.steps]
    assert (data["total"], data["end"], len(data["random"])) == (episode.totals[-1], None, 3)


def test_recorded_numbers_repeat_the_episode() -> None:
    first = played("triage")
    data = episode_to_dict(first)
    first.close()
    again = PlayedEpisode(first.simulator, None, iter(data["random"]).__next__)
    for step in data["steps"]:
        again.choose(again.action_names.index(step["action"]))
    assert episode_to_dict(again) == data


def test_environment_without_pictures_is_not_recorded_as_a_film() -> None:
    episode = PlayedEpisode(simulator("action grab(coin : Coin) = grab(hand, coin, _)"), None, random.Random(0).random)
    for write in (lambda: episode_svg(episode, "Coins"), lambda: episode_gif(episode)):
        with pytest.raises(InvalidArgument, match="environment `Coins` has no pictures; write a clause such as `draw"):
            write()


def test_film_of_pictures_of_several_sizes_has_room_for_each() -> None:
    head, rest = '<svg viewBox="0 0 {0} {1}" width="{0}0" height="{1}0">', "\n<title>a</title>\n<a/>\n</svg>"
    text = film([SvgFrame(head.format(*size) + rest, "") for size in ((3, 4), (5, 2))], "two sizes")
    assert 'viewBox="0 0 5 4" x="112" y="12" width="50" height="40"' in text
