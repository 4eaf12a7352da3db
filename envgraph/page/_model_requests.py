"""Answer requests about the model that is shown: its picture, its matches, and applications of rules."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from envgraph.errors import InvalidArgument, check_known
from envgraph.page._pictures import draw_state, list_objects
from envgraph.page._shown_model import Option, ShownModel, option_of
from envgraph.page._work import JsonObject, Params

if TYPE_CHECKING:
    from envgraph.page._page_session import PageSession

_LIMIT: Final = 100
"""Matches that are listed, if the page does not say how many."""


def select(session: PageSession, params: Params) -> JsonObject:
    """Show a model, or a member of the run, with the `draw` clause of an environment; return its picture."""
    member, model, environment = (params.get(name) for name in ("member", "model", "environment"))
    if environment is not None:
        known = [one.name for one in session.workspace.behaviours]
        check_known(environment, known, f"there is no environment `{environment}`")
    if member is not None:
        if session.run is None:
            raise InvalidArgument("no run is open", "open a run first")
        session.shown, session.member = session.run.show_member(member), str(member)
    elif model is not None:
        session.shown, session.member = session.show_model(str(model)), None
    if environment is not None:
        session.environment = environment
    return picture(session, {})


def picture(session: PageSession, params: Params = {}) -> JsonObject:  # noqa: B006, it is only read
    """Return the picture of the model that is shown, its objects, and the rules that were applied to it."""
    shown = session.model_on_page()
    behaviour = session.behaviour()
    drawn = draw_state(shown.engine, behaviour)
    return {
        **drawn,
        **shown.history,
        "objects": list_objects(shown.model),
        "model": shown.name,
        "member": session.member,
        "environment": None if behaviour is None else behaviour.name,
    }


def matches(session: PageSession, params: Params) -> JsonObject:
    """Return the matches of a pattern in the model that is shown."""
    shown = session.model_on_page()
    found = shown.matches(_text(params, "pattern"), _bound(params))
    return _list_matches(shown, [option_of(one) for one in found[: _limit(params)]], len(found))


def applicable(session: PageSession, params: Params) -> JsonObject:
    """Return the matches at which a rule can be applied, or the values with which a unit can be run."""
    shown, rule = session.model_on_page(), _text(params, "rule")
    options, more = shown.options(rule, _bound(params), _limit(params))
    session.offered = shown.version, rule, options
    return _list_matches(shown, options, len(options), more)


def apply(session: PageSession, params: Params) -> JsonObject:
    """Apply a rule or unit at the match with a number of the last `page/applicable`, or with values of variables."""
    shown, rule, index = session.model_on_page(), _text(params, "rule"), params.get("index")
    if params.get("version", shown.version) != shown.version:
        raise InvalidArgument("the model has changed since the matches were listed", "list the matches again")
    if index is None:
        options: Sequence[Option] = shown.options(rule, _bound(params, "values"), 1)[0]
        index = 0
    else:
        version, offered, options = session.offered
        if (version, offered) != (shown.version, rule):
            options = shown.options(rule, _bound(params), _LIMIT)[0]
    if type(index) is not int or not 0 <= index < len(options):
        raise InvalidArgument(f"`{rule}` cannot be applied here", "choose the rule again to see why it has no match")
    changes = shown.apply(options[index])
    return {"changes": changes, "picture": picture(session)}


def undo(session: PageSession, params: Params) -> JsonObject:
    """Undo the last applied rule, and return the picture."""
    session.model_on_page().undo()
    return picture(session)


def redo(session: PageSession, params: Params) -> JsonObject:
    """Apply the rule again that was undone last, and return the picture."""
    session.model_on_page().redo()
    return picture(session)


def reset(session: PageSession, params: Params) -> JsonObject:
    """Undo all applied rules, and return the picture."""
    session.model_on_page().reset()
    return picture(session)


def why_not(session: PageSession, params: Params) -> JsonObject:
    """Return why a pattern, rule or unit has no match, or the match if it has one; and the constraints that fail."""
    shown, name = session.model_on_page(), _text(params, "name")
    bound = shown.add_only_values(name, _bound(params))
    why = shown.engine.why_not(name, bound=bound)
    return {"text": str(why), "spans": [session.locate(span) for span in why.failing_spans()]}


def _list_matches(shown: ShownModel, options: Sequence[Option], count: int, more: bool = False) -> JsonObject:
    listed = [{"index": index, **option.data} for index, option in enumerate(options)]
    return {"count": count, "more": more or count > len(options), "matches": listed, "version": shown.version}


def _text(params: Params, name: str) -> str:
    found = params.get(name)
    if not isinstance(found, str):
        raise InvalidArgument(f"`{name}` must be a text")
    return found


def _bound(params: Params, name: str = "bound") -> Mapping[str, Any]:
    found = params.get(name) or {}
    if not isinstance(found, dict):
        raise InvalidArgument(f"`{name}` must be an object with values of variables")
    return found


def _limit(params: Params) -> int:
    found = params.get("limit", _LIMIT)
    if type(found) is not int or found < 0:
        raise InvalidArgument("`limit` must be a whole number, 0 or more")
    return found
