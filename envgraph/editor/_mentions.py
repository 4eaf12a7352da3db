"""Find the names in a syntax tree, with what each may refer to.

The names of a part of a text are found once, without knowledge of other parts. What a name refers to is looked up
when a request needs it (see `_name_index`), so an edit does not invalidate the names of other parts.
"""

from __future__ import annotations

from functools import lru_cache

from envgraph.editor._definition_names import DEFINITION_HANDLERS
from envgraph.editor._mention_data import PartNames
from envgraph.editor._name_finder import QUERY_HANDLERS, NameFinder
from envgraph.lang import TextPart

_HANDLERS = {**QUERY_HANDLERS, **DEFINITION_HANDLERS}


def mentions_of(part: TextPart) -> PartNames:
    """Return the names in a part of a text. The result is kept as long as the text of the part stays the same."""
    return _find_names(part.language, part.text)


@lru_cache(maxsize=8192)
def _find_names(language: str, text: str) -> PartNames:
    tree = TextPart(language, 0, text).reading.tree
    return PartNames.of(NameFinder(_HANDLERS).find(tree) if tree is not None else ())
