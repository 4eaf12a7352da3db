"""Show above each pattern and rule how often it matches in the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from envgraph.editor._documents import JsonObject
from envgraph.editor._name_index import NameIndex, Place

if TYPE_CHECKING:
    from envgraph.editor._language_service import LanguageService


def code_lenses(service: LanguageService, params: JsonObject) -> list[JsonObject]:
    """Return the numbers of matches of the patterns and rules of a document, as they were last counted.

    A definition without a match gets the command `envgraph.whyNot`, with its name and the URI of the document.
    """
    document = service.document(params)
    counts = service.checked(document.source.name).counts
    if counts is None:
        return []
    index = NameIndex({document.source.name: document.source}, None)
    found = []
    for kind in ("pattern", "rule"):
        for (of, _), places in index.definitions.items():
            for place in places if of == kind else ():
                symbol = index.resolve(place)
                number = counts.numbers.get(
                    f"{symbol.within}.{symbol.name}" if symbol and symbol.within else place.mention.text
                )
                if number is not None:
                    command = _command(document.uri, place, number, counts.model)
                    found.append({"range": document.range(place.span), "command": command})
    return found


def _command(uri: str, place: Place, number: int, model: str) -> JsonObject:
    title = count_text(number, place.mention.kind)
    if number:
        return {"title": f"{title} in {model}", "command": ""}
    return {
        "title": f"{title} in {model}: why not?",
        "command": "envgraph.whyNot",
        "arguments": [place.mention.text, uri],
    }


def count_text(number: int, kind: str) -> str:
    """Return a number of matches as text.

    >>> count_text(0, "pattern"), count_text(1, "pattern"), count_text(3, "rule")
    ('no match', '1 match', 'applicable 3 times')
    """
    if kind == "rule":
        return "not applicable" if not number else "applicable once" if number == 1 else f"applicable {number} times"
    return "no match" if not number else "1 match" if number == 1 else f"{number} matches"
