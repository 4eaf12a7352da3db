"""List what a folder contains, and save its texts."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from envgraph.errors import LIMITS, EnvgraphError, InvalidArgument, LoadError, Span, list_names
from envgraph.files import replace_file
from envgraph.lang import LANGUAGES, DiskFiles, TextFiles, Workspace, load_workspace, read_source
from envgraph.metamodel import type_name
from envgraph.page._work import JsonObject, Params, Work
from envgraph.pattern import ObjectType, Parameter, StaticType

if TYPE_CHECKING:
    from envgraph.page._page_session import PageSession

_LANGUAGE_OF: Final = {
    **{language: language for language in LANGUAGES},
    "vql": "query",
    "ecore": "xml",
    "xmi": "xml",
    "toml": "toml",
}
"""The languages of the files that the page shows, by suffix."""


def open_page(session: PageSession, params: Params) -> JsonObject | Work:
    """Return everything that the page lists: files, models, patterns, rules, environments, and members of the run.

    With `files`, a list of names and texts, these become the content of the folder. This is only possible if the
    folder is in memory, as in a page without a server.
    """
    given = params.get("files")
    if given is not None:
        _replace_texts(session, given)
    if session.version:  # Later, the language server checks texts that are edited.
        return _describe_folder(session)
    root, files = session.folder, session.service.edited_files()

    def finish(workspace: Workspace) -> JsonObject:
        session.show_checked(workspace)
        return _describe_folder(session)

    return Work(lambda: load_workspace([root], files=files), finish)


def _describe_folder(session: PageSession) -> JsonObject:
    files = session.service.edited_files()
    imported = sorted(name for name in session.sources if session.contains(name))
    listed = dict.fromkeys([*files.entries(session.folder), *imported])
    return {
        "title": session.title,
        "folder": session.folder,
        "rootUri": session.service.document_named(session.folder).uri,
        "writable": session.writable,
        "version": session.version,
        "errors": session.errors,
        "files": [_describe_file(session, name) for name in listed if _language(name)],
        **list_definitions(session),
    }


def _replace_texts(session: PageSession, given: Any) -> None:
    if isinstance(session.service.files, DiskFiles):
        raise InvalidArgument("a link with files cannot be opened by `envgraph serve`", "open it in the playground")
    texts = {str(one["name"]): str(one["text"]) for one in given}
    wrong = [name for name in texts if name[:1] == "/" or ".." in name or "\\" in name or not _language(name)]
    if wrong:
        endings = ", ".join(f".{one}" for one in _LANGUAGE_OF)
        raise InvalidArgument(
            f"the link has files with wrong names: {list_names(wrong)}", f"names are relative, and end in {endings}"
        )
    session.service.files = TextFiles(texts)
    session.service.documents.clear()
    session.folder = "."
    session.service.folders = (session.folder,)
    session.shown, session.version = None, 0


def _language(name: str) -> str | None:
    return _LANGUAGE_OF.get(name.rpartition(".")[2])


def _describe_file(session: PageSession, name: str) -> JsonObject:
    try:
        text = read_source(session.service.edited_files(), name).text
    except EnvgraphError:  # Its diagnostics say why it cannot be read.
        text = ""
    short = name.removeprefix("" if session.folder == "." else f"{session.folder}/")
    return {"uri": session.service.document_named(name).uri, "name": short, "language": _language(name), "text": text}


def list_definitions(session: PageSession) -> JsonObject:
    """Return the models, patterns, rules, units and environments of the texts, and the members of the run."""
    workspace, members = session.workspace, session.run.family.members if session.run is not None else ()
    patterns = [
        {
            "name": one.qualified_name,
            "uri": _uri(session, one.span),
            "parameters": _parameters(one.parameters),
            "doc": one.doc,
        }
        for one in workspace.patterns
        if not one.private
    ]
    return {
        "models": [{"name": one.name, "uri": _uri(session, one.span)} for one in workspace.models],
        "patterns": patterns,
        "rules": _rules(session),
        "environments": [{"name": one.name} for one in workspace.behaviours],
        "members": [{"name": one.name} for one in members],
    }


def _rules(session: PageSession) -> list[JsonObject]:
    """Return the rules and units in the order of the texts, and then the rules of derived groups."""
    workspace, registration = session.workspace, session.workspace.registration
    written = [(one, "rule") for one in workspace.rules] + [(one, "unit") for one in workspace.units]
    found: list[JsonObject] = [
        {
            "name": one.qualified_name,
            "kind": kind,
            "uri": _uri(session, one.span),
            "parameters": _parameters(one.parameters),
            "doc": one.doc,
        }
        for one, kind in written
    ]
    if session.shown is None or registration is None:
        return found
    engine, known = session.shown.engine, {one["name"] for one in found}
    homes = {member: one for one in workspace.derivations for member in engine.group(one.qualified_name)}
    for name in engine.rules:
        if name not in known:
            taken = {one.name: one.type for one in engine.signature(name).parameters if not one.is_output}
            home = homes.get(name)
            shown = [{"name": one, "type": _type_text(type_)} for one, type_ in taken.items()]
            found.append(
                {
                    "name": name,
                    "kind": "rule",
                    "uri": _uri(session, home.span if home is not None else None),
                    "parameters": shown,
                    "doc": f"derived by `{home.qualified_name}`" if home is not None else None,
                }
            )
    return found


def _type_text(type_: StaticType | None) -> str | None:
    if type_ is None:
        return None
    return type_.cls if isinstance(type_, ObjectType) else type_name(type_)


def _parameters(parameters: Iterable[Parameter]) -> list[Mapping[str, str | None]]:
    return [{"name": one.name, "type": one.type} for one in parameters if one.direction != "out"]


def _uri(session: PageSession, span: Span | None) -> str | None:
    return None if span is None else session.service.document_named(span.source.name).uri


def save_text(session: PageSession, params: Params) -> JsonObject:
    """Replace a file of the folder by a text, with the line ends that the file has.

    Nothing is written if the parameter `was`, the text that the page read, is given and is not that of the file any
    more: the result is then the text of the file, as `changed`.

    Raises:
        InvalidArgument: the folder is read-only, or the file is outside of it, in no language of envgraph, or cannot
            be read or written.
    """
    uri, text, was = str(params.get("uri", "")), params.get("text"), params.get("was")
    if not isinstance(text, str):
        raise InvalidArgument("`text` must be a text")
    if not session.writable:
        hint = f"copy them: `envgraph new my_copy --domain {session.title}`, then `envgraph serve my_copy`"
        raise InvalidArgument("these files are read-only", hint)
    name = session.service.name_of(uri)  # Links and `..` are resolved.
    if not session.contains(name):
        raise InvalidArgument(f"`{uri}` is not in the folder that is open", "save files of this folder only")
    if _language(name) is None:
        raise InvalidArgument(f"`{name}` is not a file in a language of envgraph")
    try:
        old = read_source(session.service.files, name).text if os.path.lexists(name) else None
        if old is not None and isinstance(was, str) and _with_line_feeds(old) != _with_line_feeds(was):
            return {"changed": old}
        if old is not None and "\r\n" in old:
            text = _with_line_feeds(text).replace("\n", "\r\n")
        _check_encoding(name, text)
        replace_file(Path(name), text)
    except LoadError as error:
        hint = "change it with another program; the page does not replace what it cannot read"
        raise InvalidArgument(f"`{name}`: {error.diagnostics[0].message}", hint) from error
    except OSError as error:
        raise InvalidArgument(f"`{name}` cannot be written: {error.strerror}") from error
    session.service.mark_stale(name)
    return {"saved": uri}


def _with_line_feeds(text: str) -> str:
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _check_encoding(name: str, text: str) -> None:
    """Raise InvalidArgument if a text is too long, or would be read as another one from a file in UTF-8."""
    try:
        size = len(text.encode())
    except UnicodeEncodeError as error:
        raise InvalidArgument("the text has half of a surrogate pair, which is not a character", "delete it") from error
    if size > LIMITS["file bytes"]:
        raise InvalidArgument(f"the text is longer than {LIMITS['file bytes'] / 2**20:g} MB")
    if _language(name) == "xml" and read_source(TextFiles({name: text}), name).text != text:
        raise InvalidArgument(
            f"`{name}` declares another encoding than UTF-8", 'write `encoding="UTF-8"` in its first line'
        )
