"""The state behind one page: the texts of a domain, the model that is shown, the episode that is played, a run."""

from __future__ import annotations

import os
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from envgraph.editor import LanguageService, first_model
from envgraph.errors import InvalidArgument, Span, check_known, name_hint
from envgraph.graph import Model
from envgraph.lang import DiskFiles, Workspace, load_workspace
from envgraph.page._shown_model import ShownModel
from envgraph.page._work import JsonObject, Notify, Params

if TYPE_CHECKING:  # These are loaded when they are first needed.
    from envgraph.behaviour import Behaviour
    from envgraph.page._opened_run import OpenedRun
    from envgraph.page._play_session import PlaySession
    from envgraph.page._search import RunningSearch

METHODS: Final[Mapping[str, str]] = {
    "page/open": "_domain_contents:open_page",
    "page/save": "_domain_contents:save_text",
    "page/select": "_model_requests:select",
    "page/picture": "_model_requests:picture",
    "page/matches": "_model_requests:matches",
    "page/applicable": "_model_requests:applicable",
    "page/apply": "_model_requests:apply",
    "page/undo": "_model_requests:undo",
    "page/redo": "_model_requests:redo",
    "page/reset": "_model_requests:reset",
    "page/whyNot": "_model_requests:why_not",
    "page/play/start": "_play_requests:start",
    "page/play/step": "_play_requests:step",
    "page/play/undo": "_play_requests:undo",
    "page/play/policy": "_play_requests:policy",
    "page/certificate": "_play_requests:certificate",
    "page/run/list": "_run_requests:list_runs",
    "page/run/open": "_run_requests:open_run",
    "page/search/start": "_search:start",
    "page/search/stop": "_search:stop",
}
"""The function that answers each method: its module in this package, and its name. It takes the session and the
parameters, and is imported with the first request."""


class PageSession:
    """The state behind one page.

    Unsaved edits count, because texts are read through the documents of the language server. With mistakes in the
    texts, the last content without mistakes stays shown.

    Args:
        service: the language server for the same files.
        folder: the name of the folder with the files, for the files of the service.
        notify: sends a notification to the page.
        title: the name of the domain or run.
        writable: True if texts may be saved.
        runs: the directory of all runs; None if there are none here.

    Attributes:
        workspace: the files of the folder as they were last checked without errors.
        errors: the number of errors in the current texts.
        version: a number that grows whenever the texts were checked.
        sources: the texts that were checked last, by file name.
        shown: the model that is shown; None if there is no metamodel, or before `page/open`.
        environment: the environment that is chosen, whose `draw` clause draws the model; None for none.
        member: the member of the opened run whose model is shown; None for a model of the texts.
        play: the episode that is played, or None.
        run: the run that is open, or None.
        search: the search that runs, or None.
    """

    def __init__(
        self,
        service: LanguageService,
        folder: str,
        notify: Notify,
        *,
        title: str = "",
        writable: bool = False,
        runs: Path | None = None,
    ) -> None:
        self.service, self.notify, self.runs, self.writable = service, notify, runs, writable
        self.folder = service.files.name(folder)
        self.title = title or Path(self.folder).resolve().name
        self.workspace = Workspace()
        self.errors, self.version = 0, 0
        self.sources: Mapping[str, str] = {}
        self.shown: ShownModel | None = None
        self.environment: str | None = None
        self.member: str | None = None
        self.play: PlaySession | None = None
        self.run: OpenedRun | None = None
        self.search: RunningSearch | None = None
        self.offered: tuple[int, str, Any] = 0, "", ()
        service.folders = (self.folder,)

    def answer(self, method: str, params: Params) -> Any:
        """Return the result of a request as JSON, or the `Work` that leads to it.

        Raises:
            InvalidArgument: there is no such method, or it is not possible with these parameters.
            EnvgraphError: what was asked for fails, such as a rule that is refused.
        """
        if method not in METHODS:
            raise InvalidArgument(f"there is no method `{method}`", name_hint(method, METHODS))
        module, _, name = METHODS[method].partition(":")
        return getattr(import_module(f"envgraph.page.{module}"), name)(self, params)

    # --- texts

    def load(self) -> None:
        """Read and check the files of the folder."""
        self.show_checked(load_workspace([self.folder], files=self.service.edited_files()))

    def show_checked(self, workspace: Workspace) -> None:
        """Show the content of checked files, unless they have errors."""
        self.sources = workspace.sources
        self.errors, self.version = len(workspace.errors), self.version + 1
        if not self.errors:
            self.workspace = workspace
            if self.member is None:
                self._show_again()

    def show_edited(self, workspace: Workspace) -> None:
        """Show files that were checked again, and tell the page to ask for them again, if a text is different."""
        if workspace.sources != self.sources:
            self.show_checked(workspace)
            self.notify("page/changed", {"version": self.version, "errors": self.errors})

    def contains(self, name: str) -> bool:
        """Return True if a file is in the folder or in one below it, after all symbolic links are followed."""
        if not isinstance(self.service.files, DiskFiles):
            return True
        if "\0" in name:
            return False
        root = os.path.realpath(self.folder)
        return os.path.realpath(name).startswith(root.rstrip(os.sep) + os.sep)

    def _show_again(self) -> None:
        """Show the chosen model with the new definitions, and repeat the rules that were applied to it."""
        environments = [one.name for one in self.workspace.behaviours]
        if self.environment not in environments:
            self.environment = environments[0] if environments else None
        old, first = self.shown, first_model(self.workspace)
        name = None if first is None else first.name
        if old is not None and any(text.name == old.name for text in self.workspace.models):
            name = old.name
        if self.workspace.metamodel is None:
            self.shown = None
            return
        self.shown = self.show_model(name)
        if old is not None and old.name == self.shown.name:
            self.shown.repeat_steps(old)

    def show_model(self, name: str | None) -> ShownModel:
        """Return a model of the texts, to show it; the empty model for None.

        Raises:
            InvalidArgument: there is no such model, or no metamodel.
        """
        if self.workspace.metamodel is None:
            raise InvalidArgument("the folder has no metamodel", "write one, such as `class Room { int size }`")
        models = {text.name: text.model for text in reversed(self.workspace.models)}  # the first of one name
        if name is not None:
            check_known(name, models, f"there is no model `{name}`")
        model = models[name] if name is not None else Model(self.workspace.metamodel)
        assert model is not None, "the texts have no errors"
        return ShownModel(self.workspace.engine_on(model.copy()), name or "")

    def behaviour(self) -> Behaviour | None:
        """Return the environment that is chosen; None if there is none."""
        if self.member is not None and self.run is not None:
            return self.run.family.domain.behaviour
        return next((one for one in self.workspace.behaviours if one.name == self.environment), None)

    def model_on_page(self) -> ShownModel:
        """Return the model that is shown.

        Raises:
            InvalidArgument: there is none.
        """
        if self.shown is None:
            hint = "correct the errors in the texts" if self.errors else "write a metamodel"
            raise InvalidArgument("there is no model to show", hint)
        return self.shown

    def locate(self, span: Span) -> JsonObject:
        """Return the URI and the range of a span, and its place as text."""
        return {**self.service.location(span), "place": str(span)}

    def close(self) -> None:
        """Stop the search, if one runs."""
        if self.search is not None:
            self.search.stopped.set()
