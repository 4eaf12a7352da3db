"""A session of a real editor client with `envgraph lsp`, over standard input and output."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Any

import pytest
import pytest_lsp
from lsprotocol import types
from pytest_lsp import ClientServerConfig, LanguageClient

from envgraph.lang import bundled_domains
from tests.editing import domain_texts

COMMAND = [sys.executable, "-m", "envgraph", "lsp"]


@pytest_lsp.fixture(config=ClientServerConfig(server_command=COMMAND))
async def client(lsp_client: LanguageClient, tmp_path: Path) -> AsyncGenerator[None]:
    folder = types.WorkspaceFolder(uri=tmp_path.as_uri(), name="domains")
    for domain in bundled_domains():
        for name, text in domain_texts(domain).items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(text, "utf-8")
    capabilities = types.ClientCapabilities()
    await lsp_client.initialize_session(
        types.InitializeParams(capabilities=capabilities, workspace_folders=[folder], root_uri=folder.uri)
    )
    yield
    await lsp_client.shutdown_session()


@pytest.mark.asyncio
async def test_every_bundled_domain_is_opened_and_edited(client: LanguageClient, tmp_path: Path) -> None:
    for domain in bundled_domains():
        path = tmp_path / domain / f"{domain}.query"
        text = path.read_text("utf-8")
        document = types.TextDocumentIdentifier(uri=path.as_uri())
        item = types.TextDocumentItem(uri=document.uri, language_id="envgraph-query", version=1, text=text)
        client.text_document_did_open(types.DidOpenTextDocumentParams(text_document=item))
        start = text.index("\npattern ") + len("\npattern ")
        name = text[start:].partition("(")[0]
        position = types.Position(line=text.count("\n", 0, start), character=len("pattern ") + 1)
        at: dict[str, Any] = {"text_document": document, "position": position}
        hover = await client.text_document_hover_async(types.HoverParams(**at))
        assert hover is not None and f"pattern {name}(" in str(hover.contents)
        definition = await client.text_document_definition_async(types.DefinitionParams(**at))
        assert isinstance(definition, list) and definition[0].uri == document.uri
        offered = await client.text_document_completion_async(types.CompletionParams(**at))
        assert offered is not None
        context = types.ReferenceContext(include_declaration=True)
        references = await client.text_document_references_async(types.ReferenceParams(context=context, **at))
        edit = await client.text_document_rename_async(types.RenameParams(new_name="zz", **at))
        assert references and edit is not None and edit.changes is not None
        assert sum(map(len, edit.changes.values())) == len(references)
    broken = types.TextDocumentContentChangeWholeDocument(text=text + "\npattern broken(")
    version = types.VersionedTextDocumentIdentifier(uri=document.uri, version=2)
    client.text_document_did_change(types.DidChangeTextDocumentParams(text_document=version, content_changes=[broken]))
    for _ in range(100):
        if client.diagnostics.get(document.uri):
            break
        await asyncio.sleep(0.05)
    assert client.diagnostics[document.uri]


def exchange(*messages: dict[str, Any]) -> tuple[list[dict[str, Any]], int, str]:
    """Send messages to a server and close the connection; return its messages, its exit code and its log."""
    bodies = [json.dumps({"jsonrpc": "2.0", **one}).encode() for one in messages]
    given = b"".join(b"Content-Length: %d\r\n\r\n%b" % (len(one), one) for one in bodies)
    done = subprocess.run(COMMAND, input=given, capture_output=True, timeout=60, check=False)
    found, rest = [], done.stdout
    while rest:
        head, _, rest = rest.partition(b"\r\n\r\n")
        size = int(head.removeprefix(b"Content-Length: "))
        found.append(json.loads(rest[:size]))
        rest = rest[size:]
    return found, done.returncode, done.stderr.decode()


def test_mistakes_of_the_client_are_answered_and_the_session_ends_in_order() -> None:
    found, code, log = exchange(
        {"id": 1, "method": "textDocument/hover", "params": {}},
        {"id": 2, "method": "initialize", "params": {}},
        {"method": "initialized", "params": {}},
        {"id": 3, "method": "textDocument/hover", "params": {}},
        {"id": 4, "method": "textDocument/unknown", "params": {}},
        {"id": 5, "method": "workspace/symbol", "params": {"query": ""}},
        {"method": "$/cancelRequest", "params": {"id": 6}},
        {"id": 6, "method": "workspace/symbol", "params": {"query": ""}},
        {"id": 7, "method": "shutdown"},
        {"id": 8, "method": "workspace/symbol", "params": {"query": ""}},
        {"method": "exit"},
    )
    codes = {one["id"]: one.get("error", {}).get("code") for one in found}
    assert codes == {1: -32002, 2: None, 3: -32603, 4: -32601, 5: None, 6: -32800, 7: None, 8: -32600}
    assert code == 0
    assert "KeyError" in log and "textDocument/hover failed" in log


def test_a_connection_that_is_cut_ends_the_server() -> None:
    found, code, _ = exchange({"id": 1, "method": "initialize", "params": {}})
    assert found[0]["result"]["serverInfo"]["name"] == "envgraph"
    assert code == 1


def test_without_pygls_the_command_says_what_to_install(tmp_path: Path) -> None:
    (tmp_path / "pygls").mkdir()
    (tmp_path / "pygls" / "__init__.py").write_text("raise ImportError('not installed')", "utf-8")
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": paths}
    done = subprocess.run(COMMAND, env=environment, capture_output=True, timeout=60, check=False, text=True)
    assert done.returncode == 1 and done.stdout == ""
    assert "the language server needs pygls" in done.stderr and "pip install 'envgraph[editor]'" in done.stderr
