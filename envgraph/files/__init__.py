"""Files on the disk: opened where they are files, and replaced as a whole, so that no failure costs what was there.

Also the one that people read meanwhile: standard error, where long work says how far it has come.
"""

from envgraph.files._cache import CACHE_VARIABLE, cache_directory, is_own, read_cached, write_cached
from envgraph.files._escaping import jinja_environment, markdown
from envgraph.files._lock import write_lock
from envgraph.files._open import open_input
from envgraph.files._progress import counting, telling
from envgraph.files._replace import check_free, replace_file, replacing

__all__ = [
    "CACHE_VARIABLE",
    "cache_directory",
    "check_free",
    "counting",
    "is_own",
    "jinja_environment",
    "markdown",
    "open_input",
    "read_cached",
    "replace_file",
    "replacing",
    "telling",
    "write_cached",
    "write_lock",
]
