"""A widget that plays a level in a notebook: the player of the page, with messages of the widget as its connection."""

from __future__ import annotations

from importlib.resources import files
from typing import Any, Final

import anywidget
import traitlets

from envgraph.draw import escape_markup
from envgraph.page import PlaySession, Work, error_object

_WIDGET_CODE: Final = """
function render({ model, el }) {
  const waiting = new Map();
  let last = 0;
  const receive = (message) => {
    const { resolve, reject } = waiting.get(message.id) ?? {};
    waiting.delete(message.id);
    if (message.error) reject?.(message.error);
    else resolve?.(message.result);
  };
  const connection = {
    request: (method, params) => new Promise((resolve, reject) => {
      const id = `${Math.random()} ${(last += 1)}`; // each view of the widget gets the answers to all of them
      waiting.set(id, { resolve, reject });
      model.send({ jsonrpc: "2.0", id, method, params });
    }),
  };
  model.on("msg:custom", receive);
  el.setAttribute("data-lm-suppress-shortcuts", "true"); // keys are those of the player, not those of Jupyter
  const player = mountPlayer(el, connection, { seed: model.get("seed") });
  return () => {
    model.off("msg:custom", receive);
    player.destroy();
  };
}
export default { render };
"""


class Player(anywidget.AnyWidget):
    """A level that a person plays; the traits say how. `player.observe(f, "steps")` calls a function at each step.

    Attributes:
        seed: seed of the random choices of an episode.
        actions: the names of the actions so far.
        steps: the number of steps.
        total: the sum of the rewards.
        end: "" while the episode goes on, then "success", "failure" or "truncated".
    """

    _esm = files("envgraph.page").joinpath("player.js").read_text("utf-8") + _WIDGET_CODE
    _css = files("envgraph.page").joinpath("player.css").read_text("utf-8")

    seed = traitlets.Int(0, read_only=True).tag(sync=True)
    actions = traitlets.Tuple(read_only=True)
    steps = traitlets.Int(0, read_only=True)
    total = traitlets.Float(0.0, read_only=True)
    end = traitlets.Unicode("", read_only=True)

    def __init__(self, session: PlaySession, seed: int = 0) -> None:
        """Show a session; its episodes begin when the widget is displayed."""
        super().__init__()
        self.session = session
        self.set_trait("seed", seed)
        self._update(session.start(seed))
        self.on_msg(self._receive)

    def request(self, method: str, **params: Any) -> Any:
        """Return the answer of the session to a request such as `request("page/play/step", action=0)`.

        Raises:
            InvalidArgument: there is no such method or action, or the episode is over.
        """
        found = self.session.answer(method, params)
        if isinstance(found, Work):
            found = found.finish(found.run())
        if "steps" in found:
            self._update(found)
        return found

    def _receive(self, _: object, message: Any, __: object) -> None:
        """Answer a message of a view."""
        if not isinstance(message, dict) or "method" not in message:
            return  # a message of anywidget itself
        answer = {"jsonrpc": "2.0", "id": message.get("id")}
        try:
            self.send({**answer, "result": self.request(message["method"], **message.get("params", {}))})
        except Exception as error:  # the widget shows it; an unexpected one is written to the log
            self.send({**answer, "error": error_object(error, lambda span: {})})

    def _update(self, state: dict[str, Any]) -> None:
        self._svg = state["picture"]["svg"] or ""
        done = state["steps"]
        names = self.actions[: max(0, done - 1)]
        with self.hold_trait_notifications():  # so that an observer of one trait finds new values in all of them
            self.set_trait("actions", (*names, state["chosenName"]) if done else ())
            self.set_trait("total", state["total"])
            self.set_trait("end", state["end"] or "")
            self.set_trait("steps", done)

    def __repr__(self) -> str:
        return f"<Player of {self.session.title}: {self.steps} steps>"

    def _repr_mimebundle_(self, **options: Any) -> Any:
        """Return the widget, and for pages without a kernel its picture."""
        shown = super()._repr_mimebundle_(**options)
        if shown is not None:
            shown[0]["text/html"] = f"{self._svg}<p>{escape_markup(self.session.title)}: run this notebook to play.</p>"
        return shown
