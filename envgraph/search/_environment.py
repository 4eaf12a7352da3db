"""What `gymnasium.make` calls for a family member."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal

from envgraph.env import (
    Behaviour,
    EnvgraphEnv,
    EnvgraphLiveEnv,
    EnvgraphVectorEnv,
    Explored,
    Simulator,
)
from envgraph.errors import InvalidArgument
from envgraph.search._domain import Domain
from envgraph.search._family import open_family
from envgraph.search._tables import Tables


def make_environment(
    domain: str | None = None,
    family: str | PathLike[str] | None = None,
    variant: int | str | None = None,
    *,
    render_mode: str | None = None,
    observation: Literal["index", "multi"] = "index",
    live: bool = False,
    **options: Any,
) -> EnvgraphEnv | EnvgraphLiveEnv:
    """The Gymnasium environment of one member of a family.

    Args:
        domain: where the behaviour and the initial model come from when there is no family: a family file, its
            directory, or the name of a bundled domain.
        family: a family file (`envgraph export`), a run, or its run store.
        variant: name of a member ("E6") or its number from 1; the target, which is the last one, by default.
        render_mode: None, "ansi" or "rgb_array".
        observation: "index" for one number, "multi" for its components.
        live: whether to step on an engine. By default all states are visited now, which makes steps faster, but there
            must not be too many of them. Episodes are the same.
        options: passed on to `EnvgraphEnv`, or `EnvgraphLiveEnv`.

    Raises:
        InvalidArgument: no such family or member, or neither a domain nor a family is given.
        LoadError: the files have errors.
        EvaluationError: too many states to visit.
    """
    if live:
        simulator = _simulator(domain, family, variant)
        return EnvgraphLiveEnv(simulator, render_mode=render_mode, observation=observation, **options)
    variants = () if variant is None else (variant,)
    (found,) = _explored(domain, family, variants, pictures=render_mode is not None)
    return EnvgraphEnv(
        found.tabular, pictures=found.pictures, render_mode=render_mode, observation=observation, **options
    )


def make_vector_environment(
    num_envs: int = 1,
    domain: str | None = None,
    family: str | PathLike[str] | None = None,
    variant: int | str | Sequence[int | str] | None = None,
    *,
    render_mode: str | None = None,
    observation: Literal["index", "multi"] = "index",
    max_episode_steps: int | None = None,
) -> EnvgraphVectorEnv:
    """The vector environment that `gymnasium.make_vec` makes: `num_envs` environments, stepped by array indexing.

    The arguments are those of `make_environment`, but `variant` may be a list: its members take turns, so that
    `num_envs=60, variant=["E1", "E2"]` gives thirty of each.
    """
    variants = () if variant is None else (variant,) if isinstance(variant, int | str) else tuple(variant)
    found = _explored(domain, family, variants, pictures=render_mode is not None)
    return EnvgraphVectorEnv(
        [one.tabular for one in found],
        num_envs,
        pictures=[one.pictures for one in found],
        render_mode=render_mode,
        observation=observation,
        max_episode_steps=max_episode_steps,
    )


def _explored(
    domain: str | None, family: str | PathLike[str] | None, variants: Sequence[int | str], *, pictures: bool
) -> list[Explored]:
    """The tables of members by names or numbers; of the target of a family, or the domain's own model, for none."""
    if family is not None:
        opened = open_family(Path(family))
        return [opened.explored(opened.member(one), pictures=pictures) for one in variants or (None,)]
    loaded, behaviour = _loaded(domain, *variants)
    tables = Tables.of_user()
    return [tables.explored(loaded, behaviour, loaded.initial(), loaded.keys(), pictures=pictures)]


def _simulator(
    domain: str | None, family: str | PathLike[str] | None, variant: int | str | None
) -> Simulator:
    """A member of a family, or the domain's own model, on an engine of its own."""
    if family is not None:
        opened = open_family(Path(family))
        engine = opened.domain.engine(opened.model(opened.member(variant)))
        return Simulator(engine, opened.behaviour, opened.keys)
    loaded, behaviour = _loaded(domain, variant)
    return Simulator(loaded.engine(), behaviour, loaded.keys())


def _loaded(domain: str | None, *variants: int | str | None) -> tuple[Domain, Behaviour]:
    """A domain without a family, and its behaviour."""
    if any(variant is not None for variant in variants):
        raise InvalidArgument("`variant` names a member of a family: give `family` as well")
    if domain is None:
        raise InvalidArgument("give a `family`, or a `domain`")
    loaded = Domain.load(domain)
    if loaded.behaviour is None:
        raise InvalidArgument(f"`{domain}` has no environment: its family file names none")
    return loaded, loaded.behaviour
