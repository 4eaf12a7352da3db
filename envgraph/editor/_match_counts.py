"""Count the matches of patterns and rules in the model of some files, with a limit on the time."""

from __future__ import annotations

from time import monotonic
from typing import ClassVar, Final

from envgraph.code import dataclass
from envgraph.editor._checked_files import CheckResult
from envgraph.editor._stoppable_call import StoppedError
from envgraph.errors import EnvgraphError
from envgraph.graph import Model
from envgraph.lang import ModelText, Workspace
from envgraph.rewrite import Engine

_SECONDS: Final = 0.5
"""Time for all counts of some files; what is not counted then has no number."""
_MOST_OBJECTS: Final = 5_000
"""Objects of a model in which matches are counted."""


@dataclass(frozen=True, slots=True)
class MatchCounts:
    """Numbers of matches.

    Attributes:
        model: the name of the model.
        numbers: by qualified name: of a pattern its matches, of a rule the matches at which it is applicable.
    """

    model: str
    numbers: dict[str, int]


def first_model(workspace: Workspace) -> ModelText | None:
    """Return the model of the family file, else the first model; None if there is none."""
    wanted = [spec.model.text for spec in workspace.families]
    return min(workspace.models, key=lambda one: one.span.source.name not in wanted, default=None)


def copy_first_model(workspace: Workspace) -> Model | None:
    """Return a copy of the `first_model`; None if there is no model, or if it has errors."""
    text = first_model(workspace)
    return None if text is None or text.model is None else text.model.copy()


def engine_of(workspace: Workspace) -> Engine | None:
    """Return an engine on a copy of the `first_model`; None if there are errors, or no model."""
    model = None if workspace.errors else copy_first_model(workspace)
    if model is None or workspace.registration is None:
        return None
    engine = workspace.engine_on(model)
    engine.analyze()
    return engine


@dataclass(frozen=True, slots=True)
class CountJob:
    """A count of all matches that may run in another thread, because the model is a copy.

    Attributes:
        roots: the paths of the check.
        result: the result of the check.
        seconds: the time after which the owner of the connection stops a single count that takes very long.
    """

    roots: tuple[str, ...]
    result: CheckResult
    seconds: ClassVar = 3.0

    def run(self) -> MatchCounts | None:
        """Return the numbers; None if there is no model in which to count."""
        workspace = self.result.workspace
        engine = engine_of(workspace)
        if engine is None or len(engine.model) > _MOST_OBJECTS:
            return None
        numbers: dict[str, int] = {}
        end = monotonic() + _SECONDS
        named = [(one.qualified_name, False) for one in workspace.patterns]
        named += [(one.qualified_name, True) for one in workspace.rules]
        for name, is_rule in named:
            if monotonic() > end:
                break
            try:
                numbers[name] = engine.count(name, applicable=True) if is_rule else engine.count(name)
            except EnvgraphError:
                continue  # It has too many matches, or cannot be counted without arguments.
            except StoppedError:
                break
        return MatchCounts(engine.model.name, numbers)
