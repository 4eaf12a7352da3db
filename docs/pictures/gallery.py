"""Make the pictures of the bundled domains, and the tables of their families, in `docs/gallery`.

The families are those of `envgraph generate DOMAIN`. The search for all of them takes 300 CPU seconds. Their runs are
kept in `build/gallery`, and used again until a file of the domain changes.
"""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import envgraph
from docs.pictures import models
from docs.pictures.drawing import sheet, tile
from envgraph.draw import SvgFrame, film
from envgraph.env import EnvgraphEnv, EnvgraphLiveEnv, scene_svg
from envgraph.env.compiled import Plans
from envgraph.files import replace_file
from envgraph.lang import bundled_domain
from envgraph.search import Domain, Family, Verification, format_certificates, generate, open_family, verify
from envgraph.solve import value_iteration

PAGES = Path(__file__).parents[1] / "gallery"
CACHE = Path(__file__).parents[2] / "build" / "gallery"

ENVIRONMENTS = {
    "burning_forest": ("Burning Forest", "a fire truck on a grid"),
    "jobshop": ("Job Shop", "jobs, machines, durations"),
    "keydoor": ("Key and Door", "keys of coloured doors"),
    "lava": ("Lava", "rooms as in MiniGrid"),
    "network": ("Routing Network", "routers, links, a packet"),
    "sokoban": ("Sokoban", "boxes pushed onto goals"),
    "taxi": ("Taxi", "as in Gymnasium"),
    "triage": ("Triage", "an emergency room"),
    "warehouse": ("Warehouse", "two robots take turns"),
}
"""The bundled domains with an environment: titles and descriptions."""

HEAD = ("environment", "states", "shortest plan", "random success", "optimal return")
"""The columns of the table of a family."""

ROWS = 4
"""The largest number of members in such a table; `envgraph verify` prints all members."""

PLANNED = {"warehouse"}
"""The domains with too many states for a table."""


@dataclass(frozen=True)
class Step:
    """A state of an episode: its picture, the action that led to it, the return so far, and the end if it is one."""

    svg: str
    action: str
    gain: float
    end: str = ""

    @property
    def result(self) -> str:
        """Return the end, if the episode has ended, and the return so far."""
        return f"{self.end and self.end + ', '}return {self.gain:z.4g}"


def main(names: Sequence[str]) -> None:
    """Write the pictures of some environments, or of all domains; and replace the tables of families in the pages."""
    for name in names or ENVIRONMENTS:
        print(f"  {name}", flush=True)
        family = family_of(name)
        for file, text in {**episode_pictures(name), **family_picture(name, family)}.items():
            replace_file(PAGES / "pictures" / file, text)
        page = PAGES / f"{name}.md"
        replace_file(page, with_table(page.read_text("utf-8"), family_table(family)))
    for file, text in () if names else models.pictures().items():
        replace_file(PAGES / "pictures" / file, text)


def family_of(name: str) -> Family:
    """Return the family of a bundled domain: that of the cache, or a new one, which can take minutes."""
    texts = [path.name.encode() + path.read_bytes() for path in sorted(bundled_domain(name).rglob("*.*"))]
    run = f"{name}-{hashlib.sha256(b''.join(texts)).hexdigest()[:8]}"
    if not (CACHE / run).exists():
        (CACHE / run).mkdir(parents=True)
        generate(name, CACHE / run / "run.sqlite")
    return open_family(run, CACHE)


def episode_pictures(name: str) -> dict[str, str]:
    """Return the picture of the initial model, and the animated episode of the best policy, by their file names."""
    steps = [*episode(name)]
    count, (last, title) = len(steps) - 1, (steps[-1], ENVIRONMENTS[name][0])
    frames = [SvgFrame(steps[0].svg, "start")]
    frames += [SvgFrame(one.svg, f"{number}: {one.action}", one.result) for number, one in enumerate(steps[1:], 1)]
    how = "a shortest plan" if name in PLANNED else "an episode of the best policy"
    words = f"{title}: {how}, {count} steps, {last.result}"
    return {f"{name}.svg": tile(steps[0].svg, *ENVIRONMENTS[name]), f"{name}-episode.svg": film(frames, words)}


def episode(name: str, seed: int = 0) -> Iterator[Step]:
    """Yield the states of an episode of the best policy in the initial model of a domain."""
    live = envgraph.make(domain=name, engine="live").unwrapped
    assert isinstance(live, EnvgraphLiveEnv)
    live.reset(seed=seed)
    painter, gain = live.simulator.painter(), 0.0
    yield Step(scene_svg(painter.draw()), "", gain)
    for action in best_actions(name, seed):
        _, reward, terminated, truncated, info = live.step(live.action_names.index(action))
        gain += float(reward)
        end = "success" if info["success"] else "failure" if terminated else ""
        yield Step(scene_svg(painter.draw()), action, gain, end)
        assert not truncated


def best_actions(name: str, seed: int) -> Iterator[str]:
    """Yield the actions of an episode of the best policy; those of a shortest plan without a table."""
    if name in PLANNED:
        domain = Domain.load(name)
        yield from Plans(domain.behaviour).plan(domain.engine()).actions
        return
    env = envgraph.make(domain=name, engine="table").unwrapped  # the same random numbers as in the live environment
    assert isinstance(env, EnvgraphEnv)
    policy = value_iteration(env.tabular).policy
    _, info = env.reset(seed=seed)
    ended = False
    while not ended:
        action = int(policy[info["state"]])
        yield env.action_names[action]
        _, _, terminated, truncated, info = env.step(action)
        ended = terminated or truncated


def family_picture(name: str, family: Family) -> dict[str, str]:
    """Return the picture of the members of a family side by side, by its file name."""
    members = [(family.svg(member), member.name) for member in family.members]
    columns = 4 if len(members) > 9 else 3 if len(members) > 4 else 2
    title = f"{len(members)} environments of {ENVIRONMENTS[name][0]}"
    return {f"{name}-family.svg": sheet(members, title, columns=columns, size=540 // columns)}


def family_table(family: Family) -> str:
    """Return the certificates of some members of a family as a Markdown table."""
    found = [*verify(family)]
    rows = [HEAD, ("---", *["---:"] * (len(HEAD) - 1)), *(table_row(found[one]) for one in shown_places(len(found)))]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def shown_places(members: int) -> list[int]:
    """Return the places of the first member, the last member and evenly spaced members between, at most `ROWS`."""
    rows = min(ROWS, members)
    return [round(row * (members - 1) / (rows - 1)) for row in range(rows)]


def table_row(found: Verification) -> tuple[str, ...]:
    """Return the cells of the row of a member."""
    assert not found.differences, f"{found.member.name}: {found.differences}"
    facts = dict(format_certificates(replace(found.member, certificates=found.certificates)))
    walk = next(text for name, text in facts.items() if name.startswith("random walk"))
    states = f"{found.states:,}" if found.states else "too many for a table"
    return found.member.name, states, facts["shortest plan"], walk, facts["optimal return"]


def with_table(page: str, table: str) -> str:
    """Return the text of a page with a new table in place of the table of the family."""
    old = re.compile(rf"^\| {' | '.join(HEAD)} \|\n(\|.*\n)*".replace(" | ", r" \| "), re.MULTILINE)
    assert len(old.findall(page)) == 1, "the page has one table of a family"
    return old.sub(lambda _: table, page)


if __name__ == "__main__":
    main(sys.argv[1:])
