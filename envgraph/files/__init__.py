"""Files that envgraph writes: replaced as a whole, so that no failure costs anybody what was there."""

from envgraph.files._replace import replace_file, replacing

__all__ = ["replace_file", "replacing"]
