"""The server answers the page that it started, on this machine, and nobody else."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from time import sleep
from typing import Any

import pytest
from starlette.websockets import WebSocketDisconnect

from envgraph.errors import EnvgraphError
from envgraph.page import find_target, serve
from envgraph.page._server import MAX_MESSAGE, make_app

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # newer versions of Starlette prefer another client
    from starlette.testclient import TestClient

PORT, TOKEN = 8123, "secret"
SOCKET = f"ws://127.0.0.1:{PORT}/socket"
HERE = f"http://127.0.0.1:{PORT}"
COOKIE = {"cookie": f"envgraph-{PORT}={TOKEN}"}


@pytest.fixture
def built(tmp_path: Path) -> Path:
    folder = tmp_path / "built"
    (folder / "sub").mkdir(parents=True)
    (folder / "index.html").write_text("<!doctype html>", "utf-8")
    (folder / "main.js").write_text("export {};", "utf-8")
    (folder / "viz.wasm").write_bytes(b"\0asm")
    (folder / "sub" / "deep.js").write_text("", "utf-8")
    (tmp_path / "outside.js").write_text("outside", "utf-8")
    (folder / "link.js").symlink_to(tmp_path / "outside.js")
    return folder


@pytest.fixture
def client(built: Path) -> Iterator[TestClient]:
    app = make_app(find_target("social_media", Path("no-runs")), built, TOKEN, PORT)
    with TestClient(app, HERE, follow_redirects=False) as made:
        yield made


def ask(socket: Any, method: str, **params: Any) -> Any:
    """Return the answer to a request, after the notifications before it."""
    socket.send_text(json.dumps({"jsonrpc": "2.0", "id": method, "method": method, "params": params}))
    while (found := json.loads(socket.receive_text())).get("id") != method:
        pass
    return found["result"]


def test_first_address_gives_a_cookie_and_leads_to_an_address_without_the_token(client: TestClient) -> None:
    answer = client.get(f"/?token={TOKEN}")
    assert answer.status_code == 200 and 'content="0; url=/"' in answer.text and TOKEN not in answer.text
    cookie = answer.headers["set-cookie"].lower()
    assert cookie.startswith(f"envgraph-{PORT}={TOKEN};") and "httponly" in cookie and "samesite=strict" in cookie
    page = client.get("/")  # the client keeps the cookie
    assert (page.status_code, page.text) == (200, "<!doctype html>")
    assert client.get("/main.js").headers["content-type"].startswith("text/javascript")
    assert client.get("/viz.wasm").headers["content-type"] == "application/wasm"


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", {}),
        ("/main.js", {}),
        ("/main.js?token=secret", {}),  # only the first address takes a token
        ("/?token=", COOKIE),
        ("/?token=wrong", COOKIE),
        ("/?token=secre%C3%A9", {}),
        ("/", {"cookie": f"envgraph-{PORT}=wrong"}),
        ("/", {"cookie": f"envgraph-1={TOKEN}"}),  # that of another server
        ("/", {**COOKIE, "host": "envgraph.example"}),  # a name that leads to this machine
        ("/", {**COOKIE, "host": f"envgraph.example:{PORT}"}),
        ("/", {**COOKIE, "host": "127.0.0.1:1"}),
        ("/", {**COOKIE, "origin": "http://envgraph.example"}),
        ("/", {**COOKIE, "origin": "null"}),
        ("/", {**COOKIE, "origin": "http://127.0.0.1:1"}),
        ("/", {**COOKIE, "origin": f"https://127.0.0.1:{PORT}"}),
    ],
)
def test_requests_of_others_are_refused(client: TestClient, path: str, headers: dict[str, str]) -> None:
    answer = client.get(path, headers=headers)
    assert answer.status_code == 403 and "doctype" not in answer.text
    assert "set-cookie" not in answer.headers and answer.headers["x-content-type-options"] == "nosniff"
    if not path.startswith("/?token"):
        with pytest.raises(WebSocketDisconnect), client.websocket_connect(SOCKET, headers=headers):
            pass


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost:80"])
def test_browsers_leave_out_port_80(built: Path, host: str) -> None:
    app = make_app(find_target("social_media", Path("no-runs")), built, TOKEN, 80)
    headers = {"host": host, "origin": f"http://{host}", "cookie": f"envgraph-80={TOKEN}"}
    assert TestClient(app).get("/", headers=headers).status_code == 200


@pytest.mark.parametrize(
    "host", ["127.0.0.1.", f"127.0.0.1.:{PORT}", f"[::1]:{PORT}", f"127.1:{PORT}", f"user@127.0.0.1:{PORT}", ""]
)
def test_other_names_of_this_machine_are_refused(client: TestClient, host: str) -> None:
    assert client.get("/", headers={**COOKIE, "host": host}).status_code == 403


def test_all_responses_have_headers_that_keep_others_out(client: TestClient) -> None:
    for path, status in (("/", 200), ("/main.js", 200), ("/none.js", 404), ("/?token=x", 403)):
        answer = client.get(path, headers=COOKIE)
        policy = answer.headers["content-security-policy"]
        assert answer.status_code == status
        assert "script-src 'self' 'wasm-unsafe-eval';" in policy and "frame-ancestors 'none'" in policy
        names = ("x-content-type-options", "cache-control", "referrer-policy")
        assert [answer.headers[name] for name in names] == ["nosniff", "no-store", "no-referrer"]


@pytest.mark.parametrize(
    "path", ["/none.js", "/link.js", "/sub", "/sub/deep.js", "/%2e%2e/outside.js", "/..%2foutside.js", "//etc/passwd"]
)
def test_only_files_of_the_built_page_are_served(client: TestClient, path: str) -> None:
    assert client.get(path, headers=COOKIE).status_code == 404
    assert client.post("/", headers=COOKIE).status_code == 405


def test_socket_carries_the_messages_of_the_page_and_of_the_editor(client: TestClient) -> None:
    headers = {**COOKIE, "origin": HERE}
    with (
        client.websocket_connect(SOCKET, headers=headers) as one,
        client.websocket_connect(SOCKET, headers=headers) as other,
    ):
        opened = ask(one, "page/open")
        assert opened["title"] == "social_media" and ask(other, "page/open")["files"] == opened["files"]
        assert "capabilities" in ask(one, "initialize", rootUri="file:///")
        file = next(file for file in opened["files"] if file["name"].endswith(".query"))
        document = {"uri": file["uri"], "languageId": "query", "version": 1, "text": file["text"] + "pattern"}
        opening = {"jsonrpc": "2.0", "method": "textDocument/didOpen", "params": {"textDocument": document}}
        one.send_text(json.dumps(opening))
        seen = [json.loads(one.receive_text()) for _ in range(2)]  # after a pause
        assert [message["method"] for message in seen] == ["textDocument/publishDiagnostics", "page/changed"]
        assert seen[0]["params"]["uri"] == file["uri"] and seen[1]["params"]["errors"] == 1
        assert ask(one, "page/picture")["kind"] == "boxes"
        assert ask(other, "page/open")["errors"] == 0  # another page has texts of its own


@pytest.mark.parametrize("message", ["x" * (MAX_MESSAGE + 1), b"{}"], ids=["too long", "no text"])
def test_socket_is_closed_after_a_message_that_no_page_sends(client: TestClient, message: str | bytes) -> None:
    with client.websocket_connect(SOCKET, headers=COOKIE) as socket:
        socket.send_text(message) if isinstance(message, str) else socket.send_bytes(message)
        with pytest.raises(WebSocketDisconnect):
            socket.receive_text()


def test_what_cannot_be_served_is_refused_with_a_hint(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, built: Path
) -> None:
    def reason(location: str, **given: Any) -> str:
        with pytest.raises(EnvgraphError) as error:
            serve(location, print, browser=False, **given)
        return str(error.value)

    monkeypatch.setattr("envgraph.page._serve.BUILT", tmp_path / "missing")
    assert "the page is not built; run `make page`" in reason("sokoban")
    monkeypatch.setattr("envgraph.page._serve.BUILT", built)
    assert "there is no folder, no run and no domain `nothing`; the bundled domains are " in reason("nothing")
    assert reason("sokobn", runs=tmp_path).endswith("domain `sokobn`; did you mean `sokoban`?")
    (tmp_path / "a.rules").write_text("", "utf-8")
    found = reason(f"{tmp_path}/a.rules")
    assert found == f"`{tmp_path}/a.rules` is a file; name its folder: `envgraph serve {tmp_path}`"
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    assert 'run `pip install "envgraph[web]"`' in reason("sokoban")


def test_command_prints_the_address_and_ends_with_ctrl_c(
    built: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = (
        "import pathlib, sys, envgraph.page._serve as module\n"
        f"module.BUILT = pathlib.Path({str(built)!r})\n"
        "from envgraph.cli import main\n"
        "sys.exit(main())\n"
    )
    command = [sys.executable, "-c", code, "serve", "social_media", "--no-browser"]
    started = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    assert started.stdout is not None
    address = started.stdout.readline()
    assert address.startswith("social_media: http://127.0.0.1:") and "?token=" in address
    port = address.split(":")[3].split("/")[0]
    monkeypatch.setattr("envgraph.page._serve.BUILT", built)
    with pytest.raises(EnvgraphError, match=f"port {port} cannot be used: "):
        serve("social_media", print, port=int(port), browser=False)
    started.send_signal(signal.SIGINT)
    _, errors = started.communicate(timeout=60)
    assert (started.returncode, errors) == (130, "interrupted\n")


COMBINATIONS = {
    "h.metamodel": "metamodel h\n\nclass N { int v contains N[*] ns }\n",
    "h.query": 'package h\nimport "h.metamodel"\n\npattern never(a : N, b : N, c : N, d : N, e : N) '
    "{ N.v(a, v); N.v(b, w); N.v(c, x); N.v(d, y); N.v(e, z); check v + w + x + y + z == 1; }\n",
    "h.model": f'import "h.metamodel"\nmodel m : h {{ N {{ v = 0, ns = [{", ".join(["N { v = 0 }"] * 300)}] }} }}\n',
}


@pytest.fixture
def combinations(tmp_path: Path, built: Path) -> Iterator[TestClient]:
    """A page about a pattern whose matches take hours to find."""
    for name, text in COMBINATIONS.items():
        (tmp_path / "here").mkdir(exist_ok=True)
        (tmp_path / "here" / name).write_text(text, "utf-8")
    target = find_target(str(tmp_path / "here"), Path("no-runs"))
    with TestClient(make_app(target, built, TOKEN, PORT), HERE) as made:
        yield made


def send(socket: Any, method: str, **params: Any) -> None:
    socket.send_text(json.dumps({"jsonrpc": "2.0", "id": method, "method": method, "params": params}))


def test_page_stops_a_request_that_keeps_the_others_waiting(combinations: TestClient) -> None:
    with combinations.websocket_connect(SOCKET, headers=COOKIE) as socket:
        ask(socket, "page/open")
        send(socket, "page/matches", pattern="h.never")
        sleep(0.1)
        socket.send_text('{"jsonrpc": "2.0", "method": "page/stop"}')
        assert json.loads(socket.receive_text())["error"]["message"] == "this was stopped"
        assert len(ask(socket, "page/picture")["objects"]) == 301
        send(socket, "page/matches", pattern="h.never")  # stopped when the page is closed, or this test never ends


def test_request_that_takes_too_long_is_stopped_with_a_reason(
    combinations: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("envgraph.page._server._LONGEST", 0.2)
    with combinations.websocket_connect(SOCKET, headers=COOKIE) as socket:
        ask(socket, "page/open")
        send(socket, "page/matches", pattern="h.never")
        error = json.loads(socket.receive_text())["error"]
        assert error["message"] == "this took too long, and was stopped" and "connect the variables" in error["hint"]


@pytest.mark.parametrize("message", ["[" * 100_000, '{"a":' * 100_000, "{", '{"method": "page/stop"'])
def test_broken_messages_are_answered_and_the_page_stays_open(client: TestClient, message: str) -> None:
    with client.websocket_connect(SOCKET, headers=COOKIE) as socket:
        socket.send_text(message)
        assert json.loads(socket.receive_text())["error"]["code"] == -32700
        assert ask(socket, "page/open")["title"] == "social_media"
