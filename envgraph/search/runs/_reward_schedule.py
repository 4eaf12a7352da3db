"""The reward schedule of the ga4cl format: the reward for arriving on a cell of each class."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from envgraph.env import ExploredEnvironment, GridScene
from envgraph.search.families._member_family import Family


def reward_schedule(family: Family) -> tuple[float, ...]:
    """Return the reward for arriving on a cell, for each class that the family file lists under `[ga4cl] rewards`.

    If the file lists no classes, they are the cell classes with a glyph in the order of the metamodel. The class of the
    start cell is left out, and classes that end an episode in success come last. For the Burning Forest this is the
    published order: road, vegetation, burning, water, goal.

    Of several rewards on arrival the one with the largest absolute value counts, so that a reward that is paid once
    (fresh water) counts as on the first arrival. A class that the agent cannot reach in any member counts 0.0.
    """
    letters = {glyph.letter: cls.name for cls in family.domain.metamodel.class_list if (glyph := cls.glyph) is not None}
    rewards: dict[str, float] = {}
    winning: set[str] = set()
    starts: set[str] = set()
    for member in reversed(family.members):
        start_letters, arrivals = _find_arrivals(family.explored(member, pictures=True))
        starts |= {letters[letter] for letter in start_letters if letter in letters}
        for letter, reward, outcome in arrivals:
            cls = letters.get(letter, "")
            winning |= {cls} if outcome == 1 else set()  # 1 is success
            if abs(reward) > abs(rewards.setdefault(cls, reward)):
                rewards[cls] = reward
        if set(_rewarded_classes(family, starts, winning)) <= set(rewards):
            break
    return tuple(rewards.get(cls, 0.0) for cls in _rewarded_classes(family, starts, winning))


def _rewarded_classes(family: Family, starts: set[str], winning: set[str]) -> Sequence[str]:
    named = [str(name) for name in family.domain.spec.ga4cl]
    if named:
        return named
    draw, metamodel = family.behaviour.draw, family.domain.metamodel
    cells = [] if draw is None else metamodel.concrete_classes(draw.cls)
    shown = [cls for cls in cells if metamodel.classes[cls].glyph is not None and cls not in starts]
    return [cls for cls in shown if cls not in winning] + [cls for cls in shown if cls in winning]


def _find_arrivals(explored: ExploredEnvironment) -> tuple[Iterable[str], Iterable[tuple[str, float, int]]]:
    """Return the letters of the cells on which episodes start, and (letter, reward, outcome) of every possible step."""
    tabular = explored.tabular
    letters = [_letter_under_token(scene) for scene in explored.pictures if isinstance(scene, GridScene)]
    if len(letters) != tabular.n_states:
        return (), ()
    possible = tabular.probability > 0
    steps = zip(
        tabular.next_state[possible].tolist(),
        tabular.reward[possible].tolist(),
        tabular.terminated[possible].tolist(),
        strict=True,
    )
    arrivals = dict.fromkeys((letters[state], reward, outcome) for state, reward, outcome in steps)
    return [letters[state] for state in tabular.start_states.tolist()], arrivals


def _letter_under_token(scene: GridScene) -> str:
    """Return the letter of the cell under the first token; "" if there is no token."""
    if not scene.marks:
        return ""
    column, row = scene.marks[0].place
    kind = scene.cells[row * scene.width + column]
    return scene.glyphs[kind].letter if kind < len(scene.glyphs) else ""
