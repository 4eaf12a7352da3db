"""Read and replace files safely, lock and cache them, escape text in templates, and show progress on standard error.

A file is replaced as a whole, so that a failure never destroys its former content.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.files._cache import (
        CACHE_VARIABLE as CACHE_VARIABLE,
        cache_directory as cache_directory,
        is_own as is_own,
        read_cached as read_cached,
        write_cached as write_cached,
    )
    from envgraph.files._escaping import jinja_environment as jinja_environment, markdown as markdown
    from envgraph.files._lock import write_lock as write_lock
    from envgraph.files._open import open_input as open_input
    from envgraph.files._progress import counting as counting, telling as telling
    from envgraph.files._replace import (
        check_free as check_free,
        replace_file as replace_file,
        replacing as replacing,
    )

later(globals())
