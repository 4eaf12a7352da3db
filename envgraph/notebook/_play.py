"""Play levels in notebooks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from envgraph.behaviour import Behaviour
from envgraph.errors import InvalidArgument
from envgraph.notebook._played_levels import open_level

if TYPE_CHECKING:
    from envgraph.notebook._player import Player


def play(level: object, environment: str | Behaviour | None = None, *, seed: int = 0) -> Player:
    """Return a widget that plays a level by keys and buttons, with undo, and with the best and a random policy.

    Args:
        level: a family, whose target is played; a member of a family; an engine, with the `environment`; the workspace
            of `%envgraph`; the path of files, or the name of a bundled domain; or an environment of `envgraph.make`.
        environment: the behaviour of an engine, or the name of one of several environments in a workspace.
        seed: seed of the random choices.

    Raises:
        InvalidArgument: anywidget is not installed, or the level cannot be played.
        LoadError: the files have errors.
    """
    try:
        from envgraph.notebook._player import Player
    except ImportError:
        raise InvalidArgument("playing in a notebook needs anywidget", "pip install 'envgraph[notebook]'") from None
    return Player(open_level(level, environment), seed)
