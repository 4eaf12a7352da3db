"""`envgraph adopt`: a domain of an environment of Gymnasium."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

from envgraph.cli._new import KINDS, domain_environment, write_files
from envgraph.cli._output import OutputFormat, print_json, print_line
from envgraph.env import Adopted, adopt, explore
from envgraph.errors import InvalidArgument
from envgraph.lang import Bundle, format_text
from envgraph.search import Domain

_LETTERS = "SFHG"
"""Of a lake: start, frozen, hole, goal."""

_Words = Mapping[str, Any]


def adopt_environment(id: str, output: Path | None, options: Iterable[str], format: OutputFormat) -> None:
    """Write a domain whose environment steps as one of Gymnasium does, which is tried out before.

    Raises:
        InvalidArgument: the environment does not tell its transitions, or the languages cannot say them; or a file
            exists.
    """
    name = _name(id)
    adopted, limit = adopt(id, **_options(options))
    words = {
        "id": id,
        "name": name,
        "environment": "".join(word.capitalize() for word in name.split("_")),
        "limit": limit or 200,
    }
    for kind, more in _ways(adopted):
        texts = _texts(kind, {**words, **more})
        problem = _difference(adopted, texts)
        if problem is None:
            break
    else:
        raise InvalidArgument(f"`{id}` is not what the domain does: {problem}")
    directory = output or Path(name)
    paths = write_files({directory / file: text for file, text in texts.items()})
    states, actions = len(adopted.outcomes), adopted.actions
    if format is OutputFormat.JSON:
        written = [path.as_posix() for path in paths]
        print_json({"written": written, "states": states, "actions": actions, "kind": kind})
        return
    for path in paths:
        print_line(f"wrote {path}")
    print_line(
        f"steps as `{id}` does: {states:,} states, {actions} actions, each outcome with its chance and reward"
    )
    print_line(f"next: envgraph generate {directory}")


def _name(id: str) -> str:
    """`FrozenLake-v1` as the name of a domain."""
    plain = re.sub(r"-v\d+$", "", id.rpartition("/")[2].rpartition(":")[2])
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|\W+", "_", plain).lower().strip("_")
    return words if re.match("[a-z]", words) else f"domain_{words}"


def _options(given: Iterable[str]) -> dict[str, Any]:
    """`is_slippery=false` as an argument of `gymnasium.make`; what is no value of TOML is a text."""
    found: dict[str, Any] = {}
    for one in given:
        key, equals, value = one.partition("=")
        if not equals:
            raise InvalidArgument(
                f"`{one}` is no option of an environment", "write its name, `=`, and a value"
            )
        try:
            found[key] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            found[key] = value
    return found


def _ways(adopted: Adopted) -> Iterator[tuple[str, _Words]]:
    """The templates that may say what an environment does, the most readable first, with their words."""
    if adopted.rows and adopted.actions == 4 and set("".join(adopted.rows)) <= {*_LETTERS}:
        yield "grid", _grid(adopted)
    yield "states", _states(adopted)


def _grid(adopted: Adopted) -> _Words:
    """A lake: what one tile of each letter says, which the comparison finds true of all, or not."""
    width = len(adopted.rows[0])
    letters = "".join(adopted.rows)
    first = min(adopted.starts)
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
        "rows": adopted.rows,
        "start": (first % width, first // width),
        "slip": _plain(tried[0].probability) if len(tried) == 3 else None,
        "ahead": _plain(tried[len(tried) // 2].probability),
        "rewards": {**dict.fromkeys(_LETTERS, 0.0), **entered},
    }


def _plain(chance: float) -> float:
    """A chance without what calculating it has added: 1/3 and not 0.33333333333333337."""
    plain = float(Fraction(chance).limit_denominator(1000))
    return plain if abs(plain - chance) < 1e-12 else chance


def _states(adopted: Adopted) -> _Words:
    """States and outcomes, whatever they mean."""
    ways = {True: "success", False: "failure", None: "none_yet"}
    states = range(len(adopted.outcomes))
    outcomes = (
        (state, action, share.state, share.reward)
        for state in states
        if state not in adopted.endings
        for action in range(adopted.actions)
        for share in adopted.shares(state, action)
        for _ in range(share.copies)
    )
    return {
        "said": "states and outcomes",
        "endings": [ways[adopted.endings.get(state)] for state in states],
        "outcomes": list(outcomes),
        "starts": [share.state for share in adopted.first() for _ in range(share.copies)],
        "last": adopted.actions - 1,
        "states": len(adopted.outcomes),
    }


def _texts(kind: str, words: _Words) -> dict[str, str]:
    """The files of a domain, in the order in which they are best read."""
    templates = domain_environment(f"adopt/{kind}")
    names = {f"{words['name']}.{one}": f"{one}.j2" for one in KINDS} | {"family.toml": "family.toml.j2"}
    texts = {name: templates.get_template(template).render(words) for name, template in names.items()}
    return {name: _formatted(name, text) for name, text in texts.items()}


def _formatted(name: str, text: str) -> str:
    """A text in the style of its language; a model may have thousands of lines, and is written in it."""
    language = name.rpartition(".")[2]
    return text if language in ("model", "toml") else format_text(language, text, name)


def _difference(adopted: Adopted, texts: Mapping[str, str]) -> str | None:
    """The first thing that a domain does in another way."""
    domain = Domain.from_bundle(Bundle(("family.toml",), texts))
    assert domain.behaviour is not None
    table = explore(domain.engine(), domain.behaviour).tabular
    return next(adopted.differences(table), None)
