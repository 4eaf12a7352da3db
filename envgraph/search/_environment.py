"""What `gymnasium.make` calls for a family member."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any, Literal

from envgraph.env import EnvgraphEnv, explore
from envgraph.errors import InvalidArgument
from envgraph.search._domain import Domain
from envgraph.search._family import open_family


def make_environment(
    domain: str | None = None,
    family: str | PathLike[str] | None = None,
    variant: int | str | None = None,
    *,
    render_mode: str | None = None,
    observation: Literal["index", "multi"] = "index",
    **options: Any,
) -> EnvgraphEnv:
    """The Gymnasium environment of one member of a family.

    Args:
        domain: where the behaviour and the initial model come from when there is no family: a family file, its
            directory, or the name of a bundled domain.
        family: a family file (`envgraph export`), a run, or its run store.
        variant: name of a member ("E6") or its number from 1; the target, which is the last one, by default.
        render_mode: None, "ansi" or "rgb_array".
        observation: "index" for one number, "multi" for its components.
        options: passed on to `EnvgraphEnv`.

    Raises:
        InvalidArgument: no such family or member, or neither a domain nor a family is given.
        LoadError: the files have errors.
    """
    if family is not None:
        opened = open_family(Path(family))
        found = opened.explored(opened.member(variant), pictures=True)
    elif domain is not None:
        if variant is not None:
            raise InvalidArgument("`variant` names a member of a family: give `family` as well")
        loaded = Domain.load(domain)
        behaviour = loaded.behaviour
        if behaviour is None:
            raise InvalidArgument(f"`{domain}` has no environment: its family file names none")
        found = explore(loaded.engine(), behaviour, loaded.keys(), pictures=True)
    else:
        raise InvalidArgument("give a `family`, or a `domain`")
    return EnvgraphEnv(
        found.tabular, pictures=found.pictures, render_mode=render_mode, observation=observation, **options
    )
