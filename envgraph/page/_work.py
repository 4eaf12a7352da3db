"""Describe work that takes long, so that a connection can answer other requests meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from threading import Event
from typing import Any

from envgraph.code import dataclass

JsonObject = dict[str, Any]
"""An object of JSON."""

Params = Mapping[str, Any]
"""The parameters of a request."""

Notify = Callable[[str, JsonObject], None]
"""A function that sends a notification, by its method and parameters. Any thread may call it."""


@dataclass(frozen=True, slots=True)
class Work:
    """A result that takes long to compute.

    Attributes:
        run: computes it; it shares no data that change with the requests, so another thread may call it.
        finish: takes the value of `run`, and returns the result. It is called between two requests.
        stopped: `run` ends with `StoppedError` soon after this is set.
        seconds: the time after which `run` is stopped; None for no limit.
    """

    run: Callable[[], Any]
    finish: Callable[[Any], Any] = lambda value: value
    stopped: Event = field(default_factory=Event)
    seconds: float | None = None
