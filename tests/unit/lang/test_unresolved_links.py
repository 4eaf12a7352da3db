"""Links of EMF models to what is nowhere: mistakes with a place, or warnings where they are allowed."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import envgraph
from envgraph.cli import main
from envgraph.errors import LoadError, Source
from envgraph.lang import TextFiles, load_workspace
from tests.reading import parse_ecore, parse_xmi

DATA = Path(__file__).parents[2] / "data" / "emf"
LIBRARY = (DATA / "library.ecore").read_text("utf-8")
HEAD = (
    'xmlns:xmi="http://www.omg.org/XMI" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
    ' xmlns:lib="http://example.org/library" xmlns:people="http://example.org/library/people" name="x"'
)
MODEL = f"""<lib:Library {HEAD} director="//@members.7">
  <shelves library="other.xmi#//@a">
    <items xsi:type="lib:Book" name="b" code="1" authors="pathmap://PEOPLE/all.uml#Ada //@members.0">
      <authors href="none.library#_1"/>
      <authors xsi:type="people:Person" href="none.library#_2"/>
    </items>
  </shelves>
  <members name="p"/>
</lib:Library>
"""
WRONG = [
    "a.library:1:{}: there is no object `//@members.7`",
    "a.library:2:21: `other.xmi`: there is no such file",
    "a.library:3:59: `pathmap://PEOPLE/all.uml` is not read, since it is a URL and not the path of a file",
    "a.library:4:22: `none.library`: there is no such file",
]
FILES = TextFiles({"m.ecore": LIBRARY, "a.library": MODEL})


def expected() -> list[str]:
    return [one.format(MODEL.index('"//@members.7') + 2) for one in WRONG]


def test_each_unresolved_link_is_an_error_with_its_position() -> None:
    found = load_workspace(["m.ecore", "a.library"], files=FILES)
    assert [f"{one.span}: {one.message}" for one in found.errors] == expected()
    assert all("--allow-unresolved" in str(one.hint) for one in found.errors if "members" not in one.message)


def test_unresolved_links_are_warnings_if_allowed() -> None:
    found = load_workspace(["m.ecore", "a.library"], files=FILES, allow_unresolved=True)
    assert not found.errors
    told = [one for one in found.diagnostics if one.code != "conformance" and one.span.source.name == "a.library"]
    assert [f"{one.span}: {one.message}" for one in told] == expected()
    assert {one.hint for one in told} == {"links to it are left out"}
    (book,) = found.model().nodes("Book")
    assert [one.name for one in book.authors] == ["p"]
    assert found.model().nodes("Library")[0].director is None


def test_at_most_a_hundred_unresolved_links_are_reported() -> None:
    members = "".join(f'<members name="{n}"/>' for n in range(5_000))
    authors = " ".join(f"_{n}" for n in range(5_000))
    books = f'<shelves><items xsi:type="lib:Book" name="b" code="1" authors="{authors}"/></shelves>'
    text = f"<lib:Library {HEAD}>{books}{members}</lib:Library>"
    model = parse_xmi(Source("a.xmi", text), parse_ecore(Source("m.ecore", LIBRARY)), allow_unresolved=True)
    assert len(model.nodes("Person")) == 5_000
    found = load_workspace(
        ["m.ecore", "a.xmi"], files=TextFiles({"m.ecore": LIBRARY, "a.xmi": text}), allow_unresolved=True
    )
    codes = [one.code for one in found.diagnostics if one.code != "conformance"]
    assert codes.count("unknown-object") == 100 and codes.count("too-many-warnings") == 1


def test_open_and_the_commands_can_allow_unresolved_links(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("m.ecore").write_text(LIBRARY)
    Path("a.library").write_text(MODEL)
    Path("q.query").write_text('import "m.ecore"\npattern book(b : Book) { Book(b); }')
    with pytest.raises(LoadError):
        envgraph.open("m.ecore", "a.library")
    assert len(envgraph.open("m.ecore", "a.library", allow_unresolved=True).model) == 4
    for command in (
        "match a.library q.query book",
        "convert a.library a.xmi -m m.ecore",
        "show a.library -m m.ecore",
        "check a.library m.ecore",
    ):
        for allowed in (False, True):
            arguments = ["envgraph", *command.split(), *["--allow-unresolved"] * allowed]
            monkeypatch.setattr(sys, "argv", arguments)
            try:
                code: object = main()
            except SystemExit as stop:
                code = stop.code
            assert code == (0 if allowed else 1)
            err = capsys.readouterr().err
            assert "`none.library`: there is no such file" in err
            assert ("links to it are left out" in err) == allowed


def test_features_with_unresolved_types_are_left_out_if_allowed() -> None:
    metamodel = LIBRARY.replace(
        'eType="#//Shelf" containment', 'eType="ecore:EClass shelves.ecore#//Shelf" containment'
    )
    metamodel = metamodel.replace('name="Shelf"', 'name="Shelf" eSuperTypes="http://none#//Thing"')
    metamodel = metamodel.replace('eOpposite="#//Library/shelves"', "").replace('eOpposite="#//Shelf/library"', "")
    query = 'import "m.ecore"\npattern p(l : Library, s) {{ Library.{}(l, s); }}'
    texts = {"m.ecore": metamodel, "q.query": query.format("shelves"), "ok.query": query.format("members")}
    (first, second) = load_workspace(["m.ecore"], files=TextFiles(texts)).errors
    assert first.message == "`shelves.ecore`: there is no such file"
    assert second.message == "none of the files has the package `http://none`"
    found = load_workspace(["ok.query"], files=TextFiles(texts), allow_unresolved=True)
    assert not found.errors
    told = [one for one in found.diagnostics if one.code == "missing-file"]
    assert [one.message for one in told] == [first.message, second.message]
    (problem,) = load_workspace(["q.query"], files=TextFiles(texts), allow_unresolved=True).errors
    assert problem.hint == "its type is in a file that does not exist"


def test_objects_of_an_unknown_namespace_are_left_out_if_allowed() -> None:
    model = (
        f'<xmi:XMI {HEAD} xmlns:p="http://profile/7"><p:Library base="_1"><shelves/></p:Library>'
        '<lib:Library xmi:id="_1" name="x"><shelves><items xsi:type="p:Book"/></shelves></lib:Library></xmi:XMI>'
    )
    files = TextFiles({"m.ecore": LIBRARY, "a.xmi": model, "b.xmi": model.replace("profile/7", "example.org/libary")})
    (problem,) = load_workspace(["m.ecore", "a.xmi"], files=files).errors
    assert problem.message == "the metamodel `library` has no namespace `http://profile/7`"
    found = load_workspace(["m.ecore", "a.xmi"], files=files, allow_unresolved=True)
    assert not found.errors and len(found.model()) == 2
    assert [one.hint for one in found.diagnostics if one.code == "unknown-uri"] == ["objects of it are left out"]
    # One that is nearly right is a mistake: else a model of another version would be empty.
    near = load_workspace(["m.ecore", "b.xmi"], files=files, allow_unresolved=True).errors
    assert near[0].hint == "did you mean `http://example.org/library`?"


def test_objects_of_two_documents_may_have_the_same_id() -> None:
    text = f'<lib:Library {HEAD} director="{{}}#_1"><members xmi:id="_1" name="{{}}"/></lib:Library>'
    texts = {"m.ecore": LIBRARY, "a.xmi": text.format("b.xmi", "a"), "b.xmi": text.format("a.xmi", "b")}
    found = load_workspace(["m.ecore", "a.xmi"], files=TextFiles(texts))
    assert not found.errors
    assert [(one.director.name, one.members[0].name) for one in found.model().nodes("Library")] == [
        ("b", "a"),
        ("a", "b"),
    ]
