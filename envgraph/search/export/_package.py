"""Render a family with a directory of templates."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Final
from unicodedata import normalize

import numpy as np

from envgraph import __version__
from envgraph.env import Agent, Behaviour, EnvgraphEnv, FloatRange, Tabular, TooManyStates
from envgraph.env.compiled import CompiledEnv, CompiledProgram, NotCompiled, check_package_name, program_files
from envgraph.errors import EvaluationError, InvalidArgument
from envgraph.files import check_empty_folder, replace_file
from envgraph.graph import Model
from envgraph.search.export._array_export import write_tables
from envgraph.search.export._templates import TemplateDirectory
from envgraph.search.families._certificate_texts import format_certificates
from envgraph.search.families._family_pictures import format_measures
from envgraph.search.families._member_family import Family, Member

TEMPLATES_DIRECTORY: Final = Path(__file__).parent / "templates"
"""Directory of the built-in templates."""

MINIGRID_TEMPLATES: Final = Path(__file__).parent / "minigrid"
"""Directory of the built-in templates for levels of MiniGrid."""

TABLES_NAME, PROGRAM_NAME = "tables.npz", "program"
"""Names of empty template files that are replaced: by the tables, or by the package of the compiled program."""

_FAMILY_VALUES: Final = ("package", "name", "version", "limit", "members", "facts")
_ENVIRONMENT_VALUES: Final = (
    "environment",
    "actions",
    "observation_shape",
    "floats",
    "observed",
    "agents",
    "tables",
    "episodes",
)

_RECORDED_STEPS: Final = 40
"""Number of steps of a recording."""


def write_package(family: Family, folder: Path, templates: Path | None = None) -> list[Path]:
    """Write the files that templates render for a family. The built-in templates write an installable package.

    Nothing is written if an error occurs. The values available in templates are documented in
    `docs/howto/export-code.md`, "Code from templates".

    Args:
        family: the family. It needs an environment if the templates use values of the environment.
        folder: an empty or new directory; its name is the name of the package.
        templates: a directory of templates. None: the built-in templates.

    Returns:
        The paths of the files.

    Raises:
        InvalidArgument: the folder is not empty, its name is not a valid package name, or a template renders an invalid
            path.
        LoadError: the templates have errors.
        EvaluationError: a template fails; or the environments have too many states for tables and cannot be compiled.
    """
    read = TemplateDirectory(templates or TEMPLATES_DIRECTORY, (*_FAMILY_VALUES, *_ENVIRONMENT_VALUES))
    if "package" in read.used_names:
        check_package_name(folder.name)
    check_empty_folder(folder)
    members = [TemplateMember(family, member) for member in family.members]
    values: dict[str, Any] = {
        "package": folder.name,
        "name": family.name,
        "version": __version__,
        "members": members,
        "facts": [*dict.fromkeys(fact for member in members for fact in member.facts)],
    }
    if "limit" in read.used_names:
        values["limit"] = family.limit
    placed = {place.rpartition("/")[2] for place in read.template_paths}
    steps = None
    if read.used_names & {*_ENVIRONMENT_VALUES} or placed & {TABLES_NAME, PROGRAM_NAME}:
        steps = _EnvironmentData(family)
        values |= steps.template_values(episodes="episodes" in read.used_names)
    files = _with_environment_files(read.render_files(values, values["members"]), steps)
    for name, content in files.items():
        replace_file(folder / name, content)
    return [folder / name for name in files]


def copy_templates(folder: Path) -> list[Path]:
    """Copy the built-in templates to a folder, so that they can be changed, and return the paths of the files.

    Raises:
        InvalidArgument: the folder is not empty.
    """
    check_empty_folder(folder)
    found = sorted(path for path in TEMPLATES_DIRECTORY.rglob("*") if path.is_file())
    for path in found:
        replace_file(folder / path.relative_to(TEMPLATES_DIRECTORY), path.read_bytes())
    return [folder / path.relative_to(TEMPLATES_DIRECTORY) for path in found]


class TemplateMember:
    """A member of a family as templates see it.

    Attributes:
        name, measures, certificates, initial: as those of `Member`.
    """

    def __init__(self, family: Family, member: Member) -> None:
        self.name, self.initial = member.name, member.initial
        self.measures, self.certificates = dict(member.measures), dict(member.certificates)
        self._family, self._member = family, member

    @cached_property
    def facts(self) -> dict[str, str]:
        """Return the member's measures and certificates as text for people, by name."""
        return {
            **dict(format_measures(self._family, self._member)),
            **dict(format_certificates(self._member)),
        }

    @cached_property
    def model(self) -> Model:
        """Return the model of the member; templates use, for example, `member.model.nodes("Tile")`."""
        return self._family.model(self._member)

    @cached_property
    def picture(self) -> str:
        """Return a picture of the member's model as text."""
        return self._family.text(self._member)


class _EnvironmentData:
    """The environments of a family as data: transition tables, or a compiled program if a table would be too large."""

    def __init__(self, family: Family) -> None:
        self._family = family
        self.tables: dict[str, Tabular] = {}
        self.program: CompiledProgram | None = None
        try:
            self.tables = {one.name: family.explored(one).tabular for one in family.members}
        except TooManyStates as many:
            try:
                self.program = family.program(family.members)
            except NotCompiled as refused:
                message = f"{many.message}, and it cannot be compiled: {refused}"
                raise EvaluationError(message, refused.span, "remove this construct, or use smaller models") from None

    def template_values(self, episodes: bool) -> Mapping[str, Any]:
        behaviour = self._family.behaviour
        owners: tuple[Behaviour | Agent, ...] = (behaviour, *behaviour.agents)
        observed = dict.fromkeys(one.span for owner in owners for one in owner.observations if one.span is not None)
        given: Any = self.program or next(iter(self.tables.values()))
        names = [one.name for one in self._family.members]
        name = normalize("NFKC", behaviour.name)  # as Python normalises identifiers
        if not name.isidentifier():
            raise InvalidArgument(f"environment `{name}` is not a valid name of a Python class; rename it")
        found = {
            "environment": name,
            "actions": tuple(given.action_names),
            "observation_shape": tuple(given.observation_shape) or (1,),
            "floats": any(isinstance(size, FloatRange) for size in given.observation_shape),
            "observed": [" ".join(one.text.split()) for one in sorted(observed, key=lambda one: one.start)],
            "agents": bool(behaviour.agents) and not behaviour.together,
            "tables": bool(self.tables),
        }
        if episodes:
            found["episodes"] = [
                record_episodes(self._environment(place), name, seed)
                for place, name in enumerate(names)
                for seed in (0, 1)
            ]
        return found

    def _environment(self, place: int) -> EnvgraphEnv | CompiledEnv:
        if self.program is not None:
            return CompiledEnv(self.program, place)
        return EnvgraphEnv([*self.tables.values()][place])

    def environment_files(self) -> dict[str, str | bytes]:
        """Return the files of the program's package by path, without its README; no files if there are tables."""
        if self.program is None:
            return {}
        names = [one.name for one in self._family.members]
        found = program_files(
            self.program,
            PROGRAM_NAME,
            name=self._family.behaviour.name,
            members=names,
            limit=self._family.limit,
        )
        return {name: content for name, content in found.items() if name != "README.md"}


def record_episodes(environment: EnvgraphEnv | CompiledEnv, member: str, seed: int) -> dict[str, Any]:
    """Play 40 random actions, and return actions and results as JSON-ready data. Reset whenever an episode ends."""
    actions = np.random.default_rng(seed).integers(len(environment.action_names), size=_RECORDED_STEPS).tolist()
    observation, _ = environment.reset(seed=seed)
    observations, rewards, ends = [observation.tolist()], [], []
    for action in actions:
        observation, reward, terminated, truncated, _ = environment.step(action)
        observations.append(observation.tolist())
        rewards.append(reward)
        ends.append([terminated, truncated])
        if terminated or truncated:
            observations.append(environment.reset()[0].tolist())
    return {
        "member": member,
        "seed": seed,
        "actions": actions,
        "observations": observations,
        "rewards": rewards,
        "ends": ends,
    }


def _with_environment_files(
    files: Mapping[str, str | bytes], environment_data: _EnvironmentData | None
) -> dict[str, str | bytes]:
    """Return the files. Empty files `tables.npz` and `program` are replaced by their content, or removed without it."""
    found: dict[str, str | bytes] = {}
    for name, content in files.items():
        last = name.rpartition("/")[2]
        if content or environment_data is None or last not in (TABLES_NAME, PROGRAM_NAME):
            found[name] = content
        elif last == PROGRAM_NAME:
            found |= {f"{name}/{inner}": text for inner, text in environment_data.environment_files().items()}
        elif environment_data.tables:
            found[name] = write_tables(environment_data.tables)
    return found
