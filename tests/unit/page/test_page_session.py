"""The page shows every bundled domain: its texts, pictures, matches, applications, and what is edited."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from envgraph.lang import TextFiles, bundled_domain, bundled_domains
from envgraph.page import Target
from tests.unit.page.browser import Page, Refused

METAMODEL = "metamodel rooms\nclass Room {\n    int size\n    refers Room[*] doors\n}\n"
MODEL = 'import "a.metamodel"\nmodel home : rooms {\n'
MODEL += "    hall : Room { size = 3 }\n    attic : Room { size = 1; doors = [hall] }\n}\n"
RULES = (
    'import "a.query"\n\n'
    "rule grow {\n    lhs { room : Room; }\n    modify { set room.size += 1; }\n}\n\n"
    "rule resize(n : int) {\n    lhs { room : Room; }\n    modify { set room.size = n; }\n}\n\n"
    "rule close {\n    lhs { room : Room; find large(room); }\n    modify { delete room; }\n}\n\n"
    "@semantics(spo)\nrule vanish {\n    lhs { room : Room; }\n    modify { delete room; }\n}\n\n"
    "unit twice { grow; grow; }\n\n"
    "unit never { grow; close; }\n"
)
QUERY = 'import "a.metamodel"\n\npattern large(room : Room) {\n    Room.size(room, n);\n    check n > 9;\n}\n'
TEXTS = {"a.metamodel": METAMODEL, "a.model": MODEL, "a.rules": RULES, "a.query": QUERY}


def rooms(**more: str) -> Page:
    return Page(Target("rooms", TextFiles(TEXTS | {name.replace("_", "."): text for name, text in more.items()}), "."))


def folder(tmp_path: Path) -> Page:
    for name, text in TEXTS.items():
        (tmp_path / name).write_text(text, "utf-8")
    return Page(str(tmp_path))


@pytest.mark.parametrize("domain", bundled_domains())
def test_every_bundled_domain_is_shown_matched_and_rewritten(domain: str) -> None:
    page = Page(domain)
    opened = page.ask("page/open")
    assert opened["errors"] == 0 and not opened["writable"]
    assert {one["name"] for one in opened["files"]} >= {one.name for one in bundled_domain(domain).glob("*.model")}
    before = page.ask("page/picture")
    ids = {one["id"] for one in before["objects"]}
    drawn = {int(one) for one in re.findall(r'data-object="(\d+)"', before["svg"])}
    assert drawn and drawn <= ids and before["text"]
    assert before["kind"] == "boxes" or "dot" not in before
    for pattern in opened["patterns"]:
        found = page.ask("page/matches", pattern=pattern["name"], limit=5)
        assert len(found["matches"]) == min(found["count"], 5) and found["more"] == (found["count"] > 5)
        for match in found["matches"]:
            assert set(match["objects"]) <= ids
    applied = 0
    for rule in opened["rules"]:
        found = page.ask("page/applicable", rule=rule["name"], limit=3)
        if found["matches"]:
            done = page.ask("page/apply", rule=rule["name"], index=0, version=found["version"])
            assert len(done["picture"]["steps"]) == 1
            undone = page.ask("page/undo")
            assert (undone["svg"], undone["objects"], undone["steps"]) == (before["svg"], before["objects"], [])
            assert page.ask("page/redo")["svg"] == done["picture"]["svg"]
            page.ask("page/reset")
            applied += 1
    assert applied or not opened["rules"]


def test_rules_and_units_are_applied_with_values_and_their_changes_are_told() -> None:
    page = rooms()
    page.ask("page/open")
    done = page.ask("page/apply", rule="grow", values={"room": "hall"})
    assert done["changes"] == ["hall.size = 4 (was 3)"]
    assert done["picture"]["steps"] == ["grow(room=Room hall)"]
    with pytest.raises(Refused, match="`resize` needs a value for `n`"):
        page.ask("page/applicable", rule="resize")
    found = page.ask("page/applicable", rule="resize", bound={"n": 7})
    assert [one["values"] for one in found["matches"]] == [
        {"n": "7", "room": "Room hall"},
        {"n": "7", "room": "Room attic"},
    ]
    page.ask("page/apply", rule="resize", index=1, version=found["version"])
    assert page.ask("page/applicable", rule="twice")["matches"] == [{"index": 0, "values": {}, "objects": []}]
    done = page.ask("page/apply", rule="twice", index=0)
    assert len(done["picture"]["steps"]) == 3 and done["picture"]["canUndo"] and not done["picture"]["canRedo"]
    picture = done["picture"]["svg"]
    with pytest.raises(Refused, match="`never` failed"):
        page.ask("page/apply", rule="never", index=0)
    assert page.ask("page/picture")["svg"] == picture  # what it had done is undone


def test_a_match_of_another_state_is_refused() -> None:
    page = rooms()
    page.ask("page/open")
    found = page.ask("page/applicable", rule="grow")
    page.ask("page/apply", rule="grow", index=0, version=found["version"])
    with pytest.raises(Refused, match="the model has changed since the matches were listed"):
        page.ask("page/apply", rule="grow", index=0, version=found["version"])


def test_missing_matches_are_explained_with_their_place() -> None:
    page = rooms()
    page.ask("page/open")
    found = page.ask("page/whyNot", name="large", bound={"room": "hall"})
    assert "fails check n > 9 (a.query:5:5)" in found["text"]
    assert [one["place"] for one in found["spans"]] == ["a.query:5:5"]
    assert found["spans"][0]["range"]["start"] == {"line": 4, "character": 4}
    with pytest.raises(Refused, match="there is no variable `rom`") as error:
        page.ask("page/whyNot", name="large", bound={"rom": "hall"})
    assert error.value.data["hint"] == "did you mean `room`?"


def test_edits_count_and_with_mistakes_the_last_state_stays(tmp_path: Path) -> None:
    page = folder(tmp_path)
    page.ask("page/open")
    page.ask("page/apply", rule="grow", values={"room": "hall"})
    before = page.ask("page/picture")
    page.edit("a.rules", "+= 1", "+= one")
    assert page.notifications("page/changed") == [{"version": 2, "errors": 1}]
    assert page.ask("page/picture")["svg"] == before["svg"] and page.ask("page/open")["errors"] == 1
    page.edit("a.rules", "+= one", "+= 10")
    assert page.notifications("page/changed")[-1] == {"version": 3, "errors": 0}
    after = page.ask("page/picture")
    assert after["steps"] == ["grow(room=Room hall)"] and "size = 13" in after["svg"]  # the new rule is applied
    page.edit("a.model", "hall : Room { size = 3", "hall : Room { size = 5")
    assert page.ask("page/picture")["steps"] == []  # another model begins anew


def test_texts_are_saved_in_the_folder_only(tmp_path: Path) -> None:
    place, outside = tmp_path / "here", tmp_path / "outside.rules"
    place.mkdir()
    outside.write_text("", "utf-8")
    page = folder(place)
    (place / "link.rules").symlink_to(outside)
    uri = (place / "a.rules").as_uri()
    page.ask("page/open")
    page.ask("page/save", uri=uri, text="// mine\n")
    assert (place / "a.rules").read_text("utf-8") == "// mine\n"
    wrong = [outside.as_uri(), (place / "link.rules").as_uri(), f"{place.as_uri()}/../outside.rules", "/etc/x.rules"]
    for one in wrong:
        with pytest.raises(Refused, match="is not in the folder that is open"):
            page.ask("page/save", uri=one, text="x")
        with pytest.raises(Refused, match="is not in the folder that is open"):
            page.ask("textDocument/hover", textDocument={"uri": one}, position={"line": 0, "character": 0})
    with pytest.raises(Refused, match="is not a file in a language of envgraph"):
        page.ask("page/save", uri=(place / "a.py").as_uri(), text="x")
    assert outside.read_text("utf-8") == ""
    bundled = Page("sokoban")
    opened = bundled.ask("page/open")
    with pytest.raises(Refused, match="these files are read-only") as error:
        bundled.ask("page/save", uri=opened["files"][0]["uri"], text="x")
    assert "envgraph new my_copy --domain sokoban" in error.value.data["hint"]


def test_a_file_that_another_program_changed_is_not_replaced(tmp_path: Path) -> None:
    page, file = folder(tmp_path), tmp_path / "a.rules"
    page.ask("page/open")
    uri = file.as_uri()
    file.write_text("// theirs\n", "utf-8")
    assert page.ask("page/save", uri=uri, text="// mine\n", was=RULES) == {"changed": "// theirs\n"}
    assert file.read_text("utf-8") == "// theirs\n"
    assert page.ask("page/save", uri=uri, text="// mine\n", was="// theirs\n") == {"saved": uri}
    assert file.read_text("utf-8") == "// mine\n"
    file.unlink()
    assert page.ask("page/save", uri=uri, text="// again\n", was="// mine\n") == {"saved": uri}
    with pytest.raises(Refused, match="`text` must be a text"):
        page.ask("page/save", uri=uri)
    assert file.read_text("utf-8") == "// again\n"


def test_line_ends_of_a_file_are_kept(tmp_path: Path) -> None:
    page, file = folder(tmp_path), tmp_path / "a.rules"
    file.write_bytes(b"// one\r\n// two\r\n")
    page.ask("page/open")
    page.ask("page/save", uri=file.as_uri(), text="// one\n// 2\n", was="// one\n// two\n")
    assert file.read_bytes() == b"// one\r\n// 2\r\n"


def test_files_that_the_page_cannot_read_or_write_stay_as_they_are(tmp_path: Path) -> None:
    page = folder(tmp_path)
    page.ask("page/open")
    latin = tmp_path / "b.ecore"
    text = '<?xml version="1.0" encoding="ISO-8859-1"?>\n<!-- \u00e4 -->\n'
    latin.write_text(text, "latin-1")
    (tmp_path / "c.rules").write_bytes(b"\xff")
    (tmp_path / "d.rules").mkdir()
    (tmp_path / "e.rules").symlink_to(tmp_path / "e.rules")
    os.mkfifo(tmp_path / "f.rules")
    for name, reason in (
        ("b.ecore", "declares another encoding than UTF-8"),
        ("c.rules", "is not UTF-8"),
        ("d.rules", "is a directory"),
        ("e.rules", "Too many levels of symbolic links"),
        ("f.rules", "this is a pipe, not a file"),
        ("a.rules/b.rules", "ot a directory"),
        (f"{'x' * 300}.rules", "File name too long"),
        ("%00.rules", "is not in the folder that is open"),
    ):
        with pytest.raises(Refused, match=reason):
            page.ask("page/save", uri=f"{tmp_path.as_uri()}/{name}", text=text)
    with pytest.raises(Refused, match="is not the address of a file"):
        page.ask("page/save", uri="file://[", text="")
    with pytest.raises(Refused, match="half of a surrogate pair"):
        page.ask("page/save", uri=(tmp_path / "a.rules").as_uri(), text="\ud800")
    assert latin.read_text("latin-1") == text and (tmp_path / "c.rules").read_bytes() == b"\xff"


def test_texts_of_a_link_replace_those_in_memory_but_not_those_on_the_disk(tmp_path: Path) -> None:
    page = rooms()
    opened = page.ask("page/open", files=[{"name": "b.metamodel", "text": METAMODEL}])
    assert [one["name"] for one in opened["files"]] == ["b.metamodel"]
    assert page.ask("page/picture")["objects"] == []
    with pytest.raises(Refused, match=r"wrong names: `\.\./b\.rules`"):
        page.ask("page/open", files=[{"name": "../b.rules", "text": ""}])
    with pytest.raises(Refused, match="a link with files cannot be opened"):
        folder(tmp_path).ask("page/open", files=[])


def test_the_model_of_the_family_file_is_shown_first_in_a_folder_below_others() -> None:
    texts = {f"a/{file.name}": file.read_text("utf-8") for file in bundled_domain("sokoban").iterdir()}
    texts["a/before.model"] = texts["a/small.model"].replace("model small", "model before")
    page = Page(Target("sokoban", TextFiles(texts), "a"))
    page.ask("page/open")
    assert page.ask("page/picture")["model"] == "small"


def test_a_folder_without_a_metamodel_says_what_is_missing() -> None:
    page = Page(Target("empty", TextFiles({}), "."))
    assert page.ask("page/open")["errors"] == 1
    with pytest.raises(Refused, match="there is no model to show") as error:
        page.ask("page/picture")
    assert error.value.data["hint"] == "correct the errors in the texts"


def test_messages_that_are_no_requests_are_refused(caplog: pytest.LogCaptureFixture) -> None:
    page = rooms()
    page.ask("page/open")
    for text, code in (("{", -32700), ("[]", -32600), ('{"id": 1}', -32600), ('{"id": "x", "method": "run"}', -32601)):
        page.receive(text)
        assert page.sent[-1]["error"]["code"] == code
    page.receive('{"id": 5, "result": null}')  # the answer to a request is no request
    page.receive('{"method": "page/picture"}')  # a notification gets no answer, not even an error
    assert page.sent[-1]["id"] == "x"
    with pytest.raises(Refused, match="`pattern` must be a text"):
        page.ask("page/matches", pattern=5)
    with pytest.raises(Refused, match="`limit` must be a whole number, 0 or more"):
        page.ask("page/matches", pattern="large", limit=-1)
    page.connection.session.shown = 7  # type: ignore[assignment]
    with pytest.raises(Refused, match="internal error: AttributeError") as error:
        page.ask("page/undo")
    assert error.value.data["code"] == -32603 and "Traceback" not in str(error.value.data)
    assert "a request of the page failed" in caplog.text


def test_files_that_the_folder_imports_are_listed_too() -> None:
    opened = Page("network").ask("page/open")
    assert {"family.toml", "audit/audit.query"} <= {one["name"] for one in opened["files"]}
    files = [{"name": one["name"], "text": one["text"]} for one in opened["files"]]
    assert rooms().ask("page/open", files=files)["errors"] == 0


def test_models_of_one_name_and_models_that_cannot_be_drawn_are_shown() -> None:
    model = "model home : rooms {\n    attic : Room { size = 1 }\n}\n"
    environment = (
        'import "a.rules"\n\nenvironment Walk(hall : Room) {\n    action grow = grow()\n'
        "    draw graph Room label size with hall at hall.next\n}\n"
    )
    metamodel = METAMODEL.replace("    refers", "    refers Room[0..1] next\n    refers")
    page = rooms(a_metamodel=metamodel, b_model='import "a.metamodel"\n' + model, a_environment=environment)
    opened = page.ask("page/open")
    assert opened["errors"] == 0 and [one["name"] for one in opened["models"]] == ["home", "home"]
    assert len(page.ask("page/picture")["objects"]) == 2 and page.ask("page/picture")["kind"] == "graph"
    for _ in range(2):
        page.ask("page/apply", rule="vanish", index=0)
    assert page.ask("page/picture")["kind"] == "boxes" and "hall" in page.ask("page/picture")["note"]
