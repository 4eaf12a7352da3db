"""Turn what a person has in a notebook into a level that can be played."""

from __future__ import annotations

from os import PathLike
from typing import Any

from envgraph.behaviour import Behaviour
from envgraph.env import Simulator
from envgraph.errors import InvalidArgument
from envgraph.lang import Workspace, open_workspace
from envgraph.page import PlaySession
from envgraph.rewrite import Engine
from envgraph.search import Family, Member, open_family


def open_level(level: object, environment: str | Behaviour | None = None) -> PlaySession:
    """Return a session that plays a level. It uses a copy of the model.

    Args:
        level: a family, whose target is played; a member; an engine, with the `environment`; a workspace, such as that
            of `%envgraph`; the path of files, or the name of a bundled domain; or a Gymnasium environment that
            `envgraph.make` returned.
        environment: the behaviour of an engine, or the name of one of several environments in a workspace.

    Raises:
        InvalidArgument: the level is none of these, lacks an environment, or is a member without its family.
        LoadError: the files have errors.
    """
    if isinstance(level, Family):
        return PlaySession.of_member(level, level.member())
    if isinstance(level, Member):
        if level.family is None:
            raise InvalidArgument(f"member `{level.name}` belongs to no family", "use `family.member(..)`")
        return PlaySession.of_member(level.family, level)
    if isinstance(level, Engine):
        if not isinstance(environment, Behaviour):
            raise InvalidArgument("an engine has no environment", "write `play(engine, workspace.behaviour())`")
        return PlaySession(Simulator(level.copy(), environment), environment.limit, level.model.name)
    if isinstance(level, str | PathLike):
        level = open_workspace(level)
    if isinstance(level, Workspace):
        behaviour = environment if isinstance(environment, Behaviour) else level.behaviour(environment)
        engine = level.engine_on(level.model().copy())
        return PlaySession(Simulator(engine, behaviour), behaviour.limit, engine.model.name)
    spec = getattr(level, "spec", None)
    if spec is not None and {"domain", "family"} & spec.kwargs.keys():
        return _open_made(spec.kwargs, spec.max_episode_steps)
    message = f"a {type(level).__name__} cannot be played"
    raise InvalidArgument(message, "give a family, a member, a workspace, an engine, a path, or an `envgraph.make(..)`")


def _open_made(arguments: dict[str, Any], limit: int | None) -> PlaySession:
    """Return a session that plays the member or domain from which `envgraph.make` made an environment."""
    if arguments.get("family") is not None:
        family = open_family(arguments["family"])
        found = PlaySession.of_member(family, family.member(arguments.get("variant")))
    else:
        files = arguments["domain"]
        found = open_level(open_workspace(*([files] if isinstance(files, str) else files)))
    found.limit = limit
    return found
