"""Measure how long an editor waits for the diagnostics of bundled domains, and for answers about a large file."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from statistics import median
from time import perf_counter
from typing import Any, NamedTuple

from envgraph.editor import LanguageService
from envgraph.lang import TextFiles, bundled_domains, data_path

_FOLDER = "memory:///"
_QUESTIONS = (
    "definition", "references", "documentHighlight", "hover", "documentSymbol", "prepareRename", "rename", "completion",
    "signatureHelp", "semanticTokens/full", "foldingRange", "formatting", "codeAction",
)  # fmt: skip
_AT_FIRST = (
    "semanticTokens/range",
    "semanticTokens/full",
    "documentLink",
    "foldingRange",
    "documentSymbol",
    "formatting",
)
_IN_CALLS = ("completion", "signatureHelp")


class Sizes(NamedTuple):
    """The number of repetitions, of patterns in the large file, and of domains."""

    repeats: int
    patterns: int
    domains: int


FULL = Sizes(5, 1_000, 100)
QUICK = Sizes(1, 20, 2)


def _open(texts: dict[str, str], name: str, check: bool = True) -> LanguageService:
    service = LanguageService(lambda method, params: None, TextFiles(texts))
    able = {"workspace": {"semanticTokens": {"refreshSupport": True}}}
    folders = [{"uri": f"{_FOLDER}.", "name": "folder"}]
    service.answer("initialize", {"workspaceFolders": folders, "capabilities": able})
    document = {"uri": _FOLDER + name, "text": texts[name], "version": 1, "languageId": ""}
    service.answer("textDocument/didOpen", {"textDocument": document})
    if check:
        service.check()
    return service


def _type_blank(service: LanguageService, name: str, offset: int) -> None:
    position = service.documents[_FOLDER + name].position(offset)
    change = {"range": {"start": position, "end": position}, "text": " "}
    params = {"textDocument": {"uri": _FOLDER + name, "version": 2}, "contentChanges": [change]}
    service.answer("textDocument/didChange", params)


def _milliseconds(start: float) -> float:
    return 1000 * (perf_counter() - start)


def _check_times(domain: str, repeats: int) -> list[float]:
    """Return the milliseconds from a keystroke in the queries of a domain to its diagnostics."""
    folder = data_path("rules", domain)
    texts = {one.name: one.read_text("utf-8") for one in folder.iterdir() if one.is_file()}
    name = f"{domain}.query"
    service, found = _open(texts, name), []
    for _ in range(repeats):
        start = perf_counter()
        _type_blank(service, name, len(texts[name]))
        job = service.next_job()
        assert job is not None
        service.record(job, job.run())
        found.append(_milliseconds(start))
    return found


def large_texts(patterns: int) -> dict[str, str]:
    """Return a file with many patterns that call each other, and its metamodel."""
    metamodel = data_path("rules", "sokoban", "sokoban.metamodel").read_text("utf-8")
    body = "Cell.west(spot, middle);\n    Cell.south(middle, there);"
    made = ['import "sokoban.metamodel"\n\npattern p0(spot : Floor, there : Floor) {\n    Cell.west(spot, there);\n}\n']
    for number in range(1, patterns):
        head = f"pattern p{number}(spot : Floor, there : Floor)"
        call = f"find p{max(number - 1 - number % 7, 0)}(middle, there);"
        made.append(
            f"/** Pattern {number}. */\n{head} {{\n    Cell.west(spot, there);\n}} or {{\n    {body}\n    {call}\n}}\n"
        )
    return {"sokoban.metamodel": metamodel, "big.query": "\n".join(made)}


def _answer_times(patterns: int, repeats: int) -> tuple[float, dict[str, list[float]]]:
    """Return the milliseconds of the check of a large file, and of each request after a keystroke in its middle."""
    texts = large_texts(patterns)
    service, name = _open(texts, "big.query"), "big.query"
    offset = texts[name].index(f"pattern p{patterns // 2}(") + len("pattern p")
    found: dict[str, list[float]] = {one: [] for one in _QUESTIONS}
    for method in ("semanticTokens/full", "formatting"):  # editors ask about the whole text when it is opened
        service.answer(f"textDocument/{method}", {"textDocument": {"uri": _FOLDER + name}})
    for _ in range(repeats):
        _type_blank(service, name, texts[name].index("{", offset) + 1)
        for method, times in found.items():
            at: dict[str, Any] = {"textDocument": {"uri": _FOLDER + name}, "newName": "renamed"}
            text = service.documents[_FOLDER + name].source.text
            place = text.index("find p", offset) + len("find p") if method in _IN_CALLS else offset
            at["position"] = service.documents[_FOLDER + name].position(place)
            at["range"] = {"start": at["position"], "end": at["position"]}
            start = perf_counter()
            service.answer(f"textDocument/{method}", at)
            times.append(_milliseconds(start))
    start, job = perf_counter(), service.next_job()
    assert job is not None
    job.run()
    return _milliseconds(start), found


def _first_times(patterns: int) -> Iterator[tuple[str, float]]:
    """Yield the milliseconds of each request that editors send at once for a large file that was just opened."""
    texts = large_texts(patterns)
    for method in _AT_FIRST:
        changed = texts["big.query"].replace("spot", f"spot_{method[:6]}")  # no part of it is in a cache
        service = _open(texts | {"big.query": changed}, "big.query", check=False)
        view = {"start": {"line": 0, "character": 0}, "end": {"line": 60, "character": 0}}
        start = perf_counter()
        service.answer(f"textDocument/{method}", {"textDocument": {"uri": f"{_FOLDER}big.query"}, "range": view})
        yield method, _milliseconds(start)


def main(sizes: Sizes) -> None:
    """Print the medians and the longest times."""
    gc.set_threshold(100_000)  # as `envgraph lsp` and `envgraph serve` do
    print("from a keystroke to the diagnostics")
    for domain in bundled_domains()[: sizes.domains]:
        times = _check_times(domain, sizes.repeats)
        print(f"  {domain:20}{median(times):6.0f} ms, longest {max(times):.0f} ms")
    check, found = _answer_times(sizes.patterns, sizes.repeats)
    print(f"a file of {sizes.patterns:,} patterns, after a keystroke in its middle")
    for method, times in found.items():
        print(f"  {method:20}{median(times):6.0f} ms, longest {max(times):.0f} ms")
    print(f"  {'check of all files':20}{check:6.0f} ms, in another thread")
    print("the same file, just opened, before its first check")
    for method, time in _first_times(sizes.patterns):
        print(f"  {method:20}{time:6.0f} ms")
