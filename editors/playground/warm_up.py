"""Answer messages of a page, so that the memory that `build.mjs` stores contains what pages need first."""

import json
from typing import Any

INTERNAL_ERROR = -32603
"""The code of JSON-RPC for an error that nobody expected."""


def ask(playground: Any, answers: list[str], method: str, **params: object) -> Any:
    """Return the result of a request, or its error; raise RuntimeError if this is a mistake of the program."""
    answers.clear()
    playground.receive(json.dumps({"jsonrpc": "2.0", "id": 0, "method": method, "params": params}))
    found = next((one for one in map(json.loads, answers) if "id" in one), {})
    while playground.work():
        pass
    error = found.get("error", {})
    if error.get("code") == INTERNAL_ERROR:
        raise RuntimeError(f"{method}: {error['message']}")
    return found.get("result", error)


def warm_up(name: str, domain: str) -> None:
    """Open a domain, and send requests of all kinds, so that the code and grammars for them are loaded."""
    answers: list[str] = []
    playground = Playground(answers.append, name, domain)  # type: ignore[name-defined]  # noqa: F821  # of start.py

    def page(method: str, **params: object) -> Any:
        return ask(playground, answers, f"page/{method}", **params)

    def editor(method: str, **params: object) -> Any:
        return ask(playground, answers, f"textDocument/{method}", **params)

    contents = page("open")
    page("picture")
    for pattern in contents["patterns"]:
        page("matches", pattern=pattern["name"])
        page("whyNot", name=pattern["name"])
    for rule in contents["rules"]:
        page("applicable", rule=rule["name"], limit=10)
    page("apply", rule=contents["rules"][0]["name"], index=0)
    page("undo")
    state = page("play/start", seed=1)
    page("play/step", action=next(place for place, one in enumerate(state["actions"]) if one["allowed"]))
    page("play/policy", policy="random")
    page("play/undo")
    page("certificate")
    ask(playground, answers, "initialize", capabilities={}, rootUri=contents["rootUri"])
    for file in contents["files"]:
        document = {"uri": file["uri"]}
        editor("didOpen", textDocument={**document, "languageId": file["language"], "version": 1, "text": file["text"]})
        broken = [{"text": f"{file['text']}\nwrong"}]
        editor("didChange", textDocument={**document, "version": 2}, contentChanges=broken)
        editor("didChange", textDocument={**document, "version": 3}, contentChanges=[{"text": file["text"]}])
        start = {"line": 0, "character": 0}
        for method in ("completion", "hover", "definition", "signatureHelp", "prepareRename"):
            editor(method, textDocument=document, position=start)
        for method in ("semanticTokens/full", "foldingRange", "documentSymbol", "codeLens"):
            editor(method, textDocument=document)
        editor("formatting", textDocument=document, options={"tabSize": 4, "insertSpaces": True})
