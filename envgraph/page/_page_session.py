"""The state behind one page: an open domain or run, the model that it shows, and the episode that is played."""

from __future__ import annotations


class PageSession:
    """An open domain or run."""
