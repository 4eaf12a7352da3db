"""Answer the requests of text editors about files in envgraph's languages: the language server.

It answers with the data types of the Language Server Protocol, version 3.17, as JSON objects.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.editor._checked_files import (
        CheckResult as CheckResult,
        find_family_problems as find_family_problems,
        find_problems as find_problems,
    )
    from envgraph.editor._documents import Document as Document
    from envgraph.editor._language_service import LanguageService as LanguageService
    from envgraph.editor._match_counts import first_model as first_model
    from envgraph.editor._open_files import EditedFiles as EditedFiles
    from envgraph.editor._preview import why_not_text as why_not_text
    from envgraph.editor._stdio_server import serve_stdio as serve_stdio
    from envgraph.editor._stoppable_call import (
        StoppableCall as StoppableCall,
        StoppedError as StoppedError,
        TookTooLongError as TookTooLongError,
    )

export_lazily(globals())
