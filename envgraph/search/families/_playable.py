"""Find the level that a person wants to play: a member of a run or family file, or the model of a domain."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from envgraph.env import PlayedEpisode, Simulator
from envgraph.errors import InvalidArgument, did_you_mean
from envgraph.lang import bundled_domains
from envgraph.search.domain._domain import Domain
from envgraph.search.families._family_file import open_family
from envgraph.search.families._lazy_family import open_lazy_family
from envgraph.search.families._member_family import Family, Member, find_run_store

_MODEL_ENDINGS: Final = (".model", ".xmi")


def find_playable(location: str, chosen: str | None = None, directory: Path = Path("runs")) -> tuple[Family, Member]:
    """Return a family and a member of it to play.

    Args:
        location: a run, its name below `directory`, or a family file (.json); or a domain: a bundled one, its
            directory, its family.toml, or an environment file. A run is preferred to a domain of the same name.
        chosen: the name or number of a member; for a domain the file of a model, here or in the domain. None for the
            last member, or the model of the domain.
        directory: the directory that contains runs.

    Raises:
        InvalidArgument: the run, domain or member does not exist, or has no environment.
        LoadError: the files have errors.
    """
    is_model = chosen is not None and chosen.endswith(_MODEL_ENDINGS)
    is_run = location.endswith(".json") or not _is_environment(location)
    if is_run and not is_model and (location.endswith(".json") or _is_run(location, directory)):
        family = open_family(location, directory)
        family.behaviour  # noqa: B018, raises if there is no environment
        return family, family.member(chosen)
    if chosen is not None and not is_model:
        known = sorted(file.parent.name for file in directory.glob("*/run.sqlite"))
        hint = did_you_mean(location, known) or "a domain takes a `.model` file; `envgraph runs` lists all runs"
        raise InvalidArgument(f"there is no run `{location}` in {directory}", hint)
    family = open_lazy_family(_domain_files(location, chosen)).family
    return family, family.members[0]


def play_episode(family: Family, member: Member, random: Callable[[], float]) -> PlayedEpisode:
    """Begin to play a member of a family; see `PlayedEpisode`."""
    engine = family.domain.engine(family.model(member))
    return PlayedEpisode(Simulator(engine, family.behaviour, family.keys), family.limit, random)


def _is_environment(location: str) -> bool:
    return location.endswith(".environment")


def _is_run(location: str, directory: Path) -> bool:
    try:
        find_run_store(location, directory)
    except InvalidArgument:
        return False
    return True


def _domain_files(location: str, model: str | None) -> str | list[str]:
    """Return a domain for `open_lazy_family`: its name, or the files of a model and an environment."""
    if _is_environment(location):
        if model is None:
            raise InvalidArgument(f"`{location}` needs a model to play", f"write `envgraph play {location} NAME.model`")
        return [model, location]
    known = bundled_domains()
    if not Path(location).exists() and location.partition("/")[0] not in known:
        hint = did_you_mean(location, known) or "the bundled domains are " + ", ".join(known)
        raise InvalidArgument(f"there is no run and no domain `{location}`", hint)
    if model is None:
        return location
    environment = Domain.load(location).spec.environment
    if environment is None:
        raise InvalidArgument(f"`{location}` has no environment", 'write `environment = "name.environment"` in it')
    beside = Path(str(environment)).parent / model
    return [str(beside) if beside.exists() and not Path(model).exists() else model, str(environment)]
