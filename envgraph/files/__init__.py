"""Files on the disk: opened where they are files, and replaced as a whole, so that no failure costs what was there."""

from envgraph.files._open import open_input
from envgraph.files._replace import replace_file, replacing

__all__ = ["open_input", "replace_file", "replacing"]
