"""Read and replace files safely, lock and cache them, escape text in templates, and show progress on standard error.

A file is replaced as a whole, so that a failure never destroys its former content.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.files._atomic_replace import (
        check_empty_folder as check_empty_folder,
        check_replaceable as check_replaceable,
        replace_file as replace_file,
        replacement_draft as replacement_draft,
    )
    from envgraph.files._cache import (
        CACHE_VARIABLE as CACHE_VARIABLE,
        cache_directory as cache_directory,
        is_private_file as is_private_file,
        read_cached as read_cached,
        read_facts as read_facts,
        write_cached as write_cached,
        write_facts as write_facts,
    )
    from envgraph.files._escaping import (
        escape_markdown as escape_markdown,
        jinja_environment as jinja_environment,
    )
    from envgraph.files._input_files import open_input as open_input
    from envgraph.files._progress import (
        report_counting as report_counting,
        report_progress as report_progress,
    )
    from envgraph.files._workers import (
        cluster_workers as cluster_workers,
        ordered_starmap as ordered_starmap,
        run_in_workers as run_in_workers,
    )
    from envgraph.files._write_lock import write_lock as write_lock

export_lazily(globals())
