"""The command `envgraph adopt`: write a domain whose environment behaves like one of Gymnasium."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from envgraph.cli._new_command import render_domain, write_files
from envgraph.cli._output import print_json, print_line
from envgraph.env import (
    AdoptedTransitions,
    MiniGridLevel,
    Simulator,
    TooManyStates,
    TransitionOutcome,
    adopt,
    explore,
)
from envgraph.errors import LIMITS, InvalidArgument
from envgraph.lang import Bundle, format_text
from envgraph.search import Domain

_LETTERS = "SFHG"
"""The letters of a FrozenLake map: start, frozen, hole, goal."""

_WALK_STEPS = 200
"""The length of the random walk from the end of each path, for levels with more states."""

_TemplateVariables = Mapping[str, Any]


def adopt_environment(environment: str, output: Path | None, options: Iterable[str], seed: int) -> None:
    """Compare a Gymnasium environment with a generated domain, and write the domain if all transitions are the same.

    Raises:
        InvalidArgument: the environment does not expose its transitions, the languages cannot express them, or a file
            exists.
    """
    name = _domain_name(environment)
    adopted, limit = adopt(environment, seed, **_parse_options(options))
    for kind, more in _candidate_templates(adopted):
        words = {"id": environment, "limit": limit, **more}
        texts = {file: _format_file(file, text) for file, text in render_domain(f"adopt/{kind}", name, words).items()}
        tried = _DomainComparison(texts)
        problem = next(tried.differences(adopted), None)
        if problem is None:
            break
    else:
        raise InvalidArgument(f"the generated domain differs from `{environment}`: {problem}")
    directory = output or Path(name)
    paths = write_files({directory / file: text for file, text in texts.items()})
    found = {"states": tried.states, "actions": tried.actions, "kind": kind}
    print_json(lambda: {"written": [path.as_posix() for path in paths], **found})
    for path in paths:
        print_line(f"wrote {path}")
    print_line(f"same transitions as `{environment}`: {tried.description}")
    print_line(f"next: envgraph generate {directory}")


def _domain_name(id: str) -> str:
    """Return the name of a domain for an environment id such as `FrozenLake-v1`."""
    short_id = re.sub(r"-v\d+$", "", id.rpartition("/")[2].rpartition(":")[2])
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|\W+", "_", short_id).lower().strip("_")
    return words if re.match("[a-z]", words) else f"domain_{words}"


def _parse_options(given: Iterable[str]) -> dict[str, Any]:
    """Parse `KEY=VALUE` options for `gymnasium.make`; a value that is not valid TOML becomes a string."""
    found: dict[str, Any] = {}
    for one in given:
        key, equals, value = one.partition("=")
        if not equals:
            raise InvalidArgument(
                f"`{one}` is not of the form NAME=VALUE", "write the name of an option, `=`, and a value"
            )
        try:
            found[key] = tomllib.loads(f"value = {value}")["value"]
        except (ValueError, RecursionError):
            found[key] = value
    return found


def _candidate_templates(
    adopted: AdoptedTransitions | MiniGridLevel,
) -> Iterator[tuple[str, _TemplateVariables]]:
    """Yield the kinds of templates that can describe the environment and their variables, the most readable first."""
    if isinstance(adopted, MiniGridLevel):
        yield "minigrid", {"level": adopted, "said": adopted.mission}
        return
    if adopted.map_rows and adopted.n_actions == 4 and set("".join(adopted.map_rows)) <= {*_LETTERS}:
        yield "grid", _grid_variables(adopted)
    yield "states", _state_variables(adopted)


def _grid_variables(adopted: AdoptedTransitions) -> _TemplateVariables:
    """Return the template variables of a FrozenLake map: rows, start, slip probabilities, the reward of each letter."""
    width = len(adopted.map_rows[0])
    letters = "".join(adopted.map_rows)
    first = min(adopted.start_probabilities)
    tried = adopted.outcomes[first][0]
    entered = {
        letters[outcome.state]: outcome.reward
        for state in range(len(letters))
        if letters[state] in "SF"
        for action in adopted.outcomes[state]
        for outcome in action
    }
    return {
        "said": "a lake with holes",
        "rows": adopted.map_rows,
        "start": (first % width, first // width),
        "slip": _simple_probability(tried[0].probability) if len(tried) == 3 else None,
        "ahead": _simple_probability(tried[len(tried) // 2].probability),
        "rewards": {**dict.fromkeys(_LETTERS, 0.0), **entered},
    }


def _simple_probability(chance: float) -> float:
    """Return a probability without rounding errors: 1/3 instead of 0.33333333333333337."""
    fraction = float(Fraction(chance).limit_denominator(1000))
    return fraction if abs(fraction - chance) < 1e-12 else chance


def _state_variables(adopted: AdoptedTransitions) -> _TemplateVariables:
    """Return the template variables of an environment that is described as a list of states and outcomes."""
    ways = {True: "success", False: "failure", None: "none_yet"}
    states = range(len(adopted.outcomes))
    acts = [
        [
            adopted.merged_outcomes(state, action)
            for action in range(adopted.n_actions if state not in adopted.final_states else 0)
        ]
        for state in states
    ]
    most = max(len(outcomes) for rows in acts for outcomes in rows)
    return {
        "said": "states and outcomes",
        "endings": [ways[adopted.final_states.get(state)] for state in states],
        "actions": adopted.n_actions,
        "most": most,
        "acts": [[_pad_outcomes(outcomes, most) for outcomes in rows] for rows in acts],
        "starts": adopted.equally_likely_starts(),
        "states": len(adopted.outcomes),
    }


def _pad_outcomes(outcomes: list[TransitionOutcome], most: int) -> list[tuple[float, int, float]]:
    """Return probability, next state and reward of each outcome, padded to `most` outcomes with probability 0."""
    found = [(_simple_probability(one.probability), one.state, one.reward) for one in outcomes]
    return found + [(0.0, *found[0][1:])] * (most - len(found))


def _format_file(name: str, text: str) -> str:
    """Return the text in the style of its language; models and TOML files are returned unchanged, for speed."""
    language = name.rpartition(".")[2]
    return text if language in ("model", "toml") else format_text(language, text, name)


class _DomainComparison:
    """A comparison of a generated domain with the environment that it imitates.

    Attributes:
        states: number of states; None if there are too many for a table.
        actions: number of actions.
        description: text that describes what was compared.
    """

    def __init__(self, texts: Mapping[str, str]) -> None:
        self._domain = Domain.from_bundle(Bundle(("family.toml",), texts))
        self.states: int | None = None
        self.actions = 0
        self.description = ""

    def differences(self, adopted: AdoptedTransitions | MiniGridLevel) -> Iterator[str]:
        """Yield descriptions of differences: in all states, or for a large level along some paths."""
        engine, behaviour = self._domain.engine(), self._domain.behaviour
        assert behaviour is not None
        try:
            limit = LIMITS["level states"] if isinstance(adopted, MiniGridLevel) else LIMITS["states"]
            table = explore(engine, behaviour, limit=limit).tabular
        except TooManyStates:
            if not isinstance(adopted, MiniGridLevel):
                raise
            yield from self._compare_paths(adopted, Simulator(engine, behaviour))
            return
        self.states, self.actions = table.n_states, table.n_actions
        each = "its reward" if isinstance(adopted, MiniGridLevel) else "its probability and reward"
        self.description = f"{self.states:,} states, {self.actions} actions, each outcome with {each}"
        yield from adopted.differences(table)

    def _compare_paths(self, level: MiniGridLevel, simulator: Simulator) -> Iterator[str]:
        self.actions = len(simulator.action_names)
        first, plan = level.shortest_sequences(LIMITS["level states"])
        if not plan and level.success_kind != "goal":  # Other goals are guessed, so a plan must confirm them.
            yield "no path to success was found, and there are too many states to compare all"
            return
        tried: set[Any] = set()
        rng = np.random.default_rng(0)
        for way in (plan, *first):
            walk = [rng.permutation(self.actions).tolist() for _ in range(_WALK_STEPS)]
            yield from level.compare_episode(simulator, [*((action,) for action in way), *walk], tried)
        success = f"to success in {len(plan)} steps and " if plan else ""
        where = f"each action in {len(tried):,} states, on paths {success}to objects that can be carried or opened"
        self.description = f"{where}; there are too many states to compare all"
