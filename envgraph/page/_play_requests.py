"""Answer requests about episodes: begin one on a model or member, and pass steps on to it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from envgraph.errors import InvalidArgument, check_known
from envgraph.page._work import Params, Work

if TYPE_CHECKING:
    from envgraph.page._page_session import PageSession
    from envgraph.page._play_session import PlaySession


def start(session: PageSession, params: Params) -> Any:
    """Begin an episode on a model of the texts or a member of the run, and return its state.

    Without a model and a member, the episode begins on the state of the model that is shown.
    """
    session.play = None
    session.play = make_play_session(session, params)
    return session.play.answer("page/play/start", params)


def step(session: PageSession, params: Params) -> Any:
    """Do the action with a number, and return the state of the episode."""
    return _playing(session).answer("page/play/step", params)


def undo(session: PageSession, params: Params) -> Any:
    """Undo the last step of the episode, and return its state."""
    return _playing(session).answer("page/play/undo", params)


def policy(session: PageSession, params: Params) -> Any:
    """Do one step of a policy, and return the state of the episode."""
    return _playing(session).answer("page/play/policy", params)


def certificate(session: PageSession, params: Params) -> Any:
    """Return the exact results about a model or member; without either, about the level that is played."""
    if not any(params.get(name) for name in ("model", "member", "environment")):
        return _playing(session).certify()
    member = params.get("member")
    if member is not None and session.run is not None:
        known = session.run.certificate(str(member))
        if known is not None:
            return known
    play = make_play_session(session, params)
    found = play.certify()
    if isinstance(found, Work) and session.play is not None and session.play.title == play.title:
        return session.play.certify()  # so that its best policy is known, too
    return found


def _playing(session: PageSession) -> PlaySession:
    if session.play is None:
        raise InvalidArgument("nothing is played", "request `page/play/start` first")
    return session.play


def make_play_session(session: PageSession, params: Params) -> PlaySession:
    """Return an episode that has not begun, on the level that the parameters of a request name.

    Raises:
        InvalidArgument: there is no such environment, model or member.
        ResolutionError: the model has no object for a parameter of the environment.
    """
    from envgraph.env import Simulator
    from envgraph.page._play_session import PlaySession

    member, model, chosen = (params.get(name) for name in ("member", "model", "environment"))
    if member is None and model is None:
        member = session.member
    if member is not None:
        if session.run is None:
            raise InvalidArgument("no run is open", "open a run first")
        return PlaySession.of_member(session.run.family, session.run.family.member(member))
    behaviours = {one.name: one for one in session.workspace.behaviours}
    name = str(chosen) if chosen else session.environment
    if name is None:
        raise InvalidArgument("the folder has no environment", "write a `.environment` file with actions")
    check_known(name, behaviours, f"there is no environment `{name}`")
    shown = session.model_on_page() if model is None else session.show_model(str(model))
    engine = session.workspace.engine_on(shown.model.copy())
    behaviour = behaviours[name]
    return PlaySession(Simulator(engine, behaviour), limit=behaviour.limit, title=f"{name}, {shown.name or 'model'}")
