"""Words, parameters of calls and options are offered where they can be written."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from envgraph.editor import LanguageService
from envgraph.editor._mentions import mentions_of
from envgraph.lang import TextFiles, bundled_domains, data_path, language_of, load_workspace, text_parts
from tests.profile import AT_NIGHT

_KEYWORD, _SNIPPET = 14, 2
SHOP = {
    "shop.metamodel": """metamodel shop

enum Size { small, large }

/** A box. */
class Box {
    Size size
    int weight
    contains Box[*] inner opposite outer
    refers Box[0..1] outer opposite inner
    refers Label[0..1] label
}

class Label {
    string text
}
""",
    "shop.query": """import "shop.metamodel"

/** One box in another. */
pattern inside(part : Box, whole : Box) {
    Box.inner(whole, part);
}

private pattern heavy(box : Box) {
    Box.weight(box, n);
    check(n > 3);
}
""",
    "shop.rules": """import "shop.query"

/** Take a box out. */
rule unpack(box : Box) {
    lhs { find inside(box, whole); }
    modify { set box.outer = none; }
}
""",
}


class Writer:
    """An editor in which one file is written; `|` in a text is the cursor."""

    def __init__(self, name: str, texts: dict[str, str]) -> None:
        self.uri = f"memory:///{name}"
        self.service = LanguageService(lambda method, params: None, TextFiles(texts))
        self.service.answer("initialize", {"workspaceFolders": [{"uri": "memory:///.", "name": "shop"}]})

    def open(self, text: str) -> None:
        document = {"uri": self.uri, "text": text, "version": 1, "languageId": ""}
        self.service.answer("textDocument/didOpen", {"textDocument": document})

    def ask(self, method: str, text: str) -> Any:
        before, cursor, after = text.partition("|")
        assert cursor
        self.open(before + after)
        position = self.service.documents[self.uri].position(len(before))
        return self.service.answer(f"textDocument/{method}", {"textDocument": {"uri": self.uri}, "position": position})

    def offers(self, text: str) -> dict[str, Any]:
        return {one["label"]: one for one in self.ask("completion", text)}

    def names(self, text: str) -> list[str]:
        """Return the offers that are no keywords."""
        return [name for name, one in self.offers(text).items() if one["kind"] != _KEYWORD]


def writing(name: str) -> Writer:
    return Writer(name, SHOP)


def body(text: str) -> str:
    """Return a query with a pattern with this body."""
    return f'import "shop.metamodel"\nimport "shop.query"\n\npattern p(box : Box, label : Label) {{\n    {text}\n}}\n'


def rule(text: str) -> str:
    return f'import "shop.query"\n\nrule r(box : Box) {{\n    {text}\n}}\n'


def test_statements_begin_with_keywords_classes_and_variables() -> None:
    offers = writing("a.query").offers(body("|"))
    assert {"find", "neg", "check", "Box", "Label", "box", "label"} <= offers.keys()
    assert offers["Box"]["documentation"]["value"] == "A box."
    ranks = [offers[one]["sortText"][0] for one in ("box", "Box", "find")]
    assert ranks == sorted(ranks)
    assert len(set(ranks)) == 3


def test_patterns_are_offered_with_places_for_their_arguments() -> None:
    offers = writing("a.query").offers(body("find ins|"))
    inside = offers["inside"]
    assert inside["textEdit"]["newText"] == "inside(${1:part}, ${2:whole})"
    assert inside["insertTextFormat"] == _SNIPPET
    assert inside["documentation"]["value"] == "One box in another."
    assert inside["textEdit"]["range"]["start"] == {"line": 4, "character": 9}
    assert "heavy" not in offers, "it is private in another file"
    written = writing("a.query").offers(body("find |(box, _);"))
    assert written["inside"]["textEdit"]["newText"] == "inside"


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("Box.|", ["size", "weight", "inner", "outer", "label"]),
        ("Box.label.|", ["text"]),
        ("find inside(|, _);", ["box"]),
        ("Label.text(|, _);", ["label"]),
        ("Box.size(box, Size::|);", ["small", "large"]),
        ("Box.size(box, ::|);", ["small", "large"]),
        ("Box.size(box, s); s == Size::|", ["small", "large"]),
    ],
)
def test_only_names_that_fit_are_offered_in_queries(text: str, names: list[str]) -> None:
    assert writing("a.query").names(body(text)) == names


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("lhs { box -|-> other; }", ["inner", "outer", "label"]),
        ("lhs { tag : Label -|-> other; }", []),
        ("lhs { box <-|- other; }", ["inner", "outer"]),
        ("lhs { box -inner-> other : Box { we| } }", ["size", "weight", "inner", "outer", "label"]),
        ("lhs { box -label-> tag; } modify { set tag.| }", ["text"]),
        ("lhs { box -label-> tag; } modify { retype |", ["box", "tag"]),
        ("lhs { box : Box; } not { box -label-> tag; } modify { retype |", ["box"]),
    ],
)
def test_only_names_that_fit_are_offered_in_rules(text: str, names: list[str]) -> None:
    assert writing("a.rules").names(rule(text)) == names


def test_variables_of_expressions_have_features_and_functions_have_signatures() -> None:
    writer = writing("a.query")
    assert writer.names(body("Box(box); check(box.|")) == ["size", "weight", "inner", "outer", "label"]
    function = writer.offers(body("check(|"))["substring"]
    assert function["detail"] == "substring(string, int[, int])"


def test_environments_offer_rules_and_their_own_variables() -> None:
    writer = writing("a.environment")
    text = 'import "shop.rules"\n\nenvironment E(box : Box) {{\n    action a(size : Size) = {}\n    {}\n}}\n'
    assert writer.names(text.format("|", "")) == ["unpack", "nothing", "box", "size"]
    assert writer.names(text.format("unpack(box)", "observe other.| for other : Box")) == [
        "size", "weight", "inner", "outer", "label",
    ]  # fmt: skip


def test_models_offer_classes_features_and_objects_that_fit() -> None:
    writer = writing("a.model")
    text = 'import "shop.metamodel"\n\nmodel m : shop {{\n    one : Box {{ {} }}\n    tag : Label {{ }}\n}}\n'
    assert writer.names(text.format("|")) == ["size", "weight", "inner", "outer", "label"]
    assert writer.names(text.format("weight = 3; l|")) == ["size", "inner", "outer", "label"]
    assert writer.names(text.format("label = |")) == ["tag"]
    assert writer.names(text.format("size = ::|")) == ["small", "large"]
    assert writer.names(text.format("inner = [x : |]")) == ["Box", "Label"]


def test_metamodels_offer_types_and_opposites() -> None:
    writer = writing("shop.metamodel")
    text = SHOP["shop.metamodel"]
    writer.open(text)
    writer.service.check()
    assert writer.names(text.replace("int weight", "| weight")) == ["int", "float", "bool", "string", "Size"]
    assert writer.names(text.replace("contains Box", "contains |")) == ["Box", "Label"]
    assert writer.names(text.replace("opposite outer", "opposite |")) == ["outer"]
    assert writer.names(text.replace("class Label", "class Label extends |")) == ["Box"]


def test_annotations_and_imported_files_are_offered() -> None:
    writer = writing("a.rules")
    assert writer.offers("@|\nrule r { }\n")["weight"]["textEdit"]["newText"] == "weight(${1:1.0})"
    assert "used-once" in writer.offers('@suppress("|")\nrule r { }\n')
    assert writer.names('import "|"\n') == ["shop.metamodel", "shop.query", "shop.rules"]
    assert writer.names('import "sh|') == ["shop.metamodel", "shop.query", "shop.rules"]


def test_nothing_is_offered_in_comments_and_texts() -> None:
    writer = writing("a.query")
    for text in ("// find |", "/* find | */", 'Label.text(label, "find |");'):
        assert writer.offers(body(text)) == {}


def family(text: str, head: str = "") -> str:
    return f'model = "shop.model"\n{head}\n{text}\n'


@pytest.mark.parametrize(
    ("text", "some"),
    [
        ("[|", {"search", "measures.", "training.epsilon"}),
        ("[search]\npop|", {"population", "survivors"}),
        ("[search]\nparents = |", {"random", "elitist"}),
        ('[search.survivors]\nname = "beam"\n|', {"width"}),
        ('[constraints]\nrequire = ["|"]', {"inside"}),
        ('[mutation]\nrules = ["|"]', {"unpack"}),
        ('[measures.a]\nkind = "count"\nof = "|"', {"inside"}),
        ('[measures.a]\nkind = "count"\n\n[diversity]\nof = "|"', {"a"}),
        ('[measures.a]\nkind = "path_complexity"\nfrom = "|"', {"Box", "Label"}),
        ("[search]\nkeep_initial = |", {"true", "false"}),
        ('environment = "|"', {"shop.environment"}),
    ],
)
def test_families_offer_keys_and_values(text: str, some: set[str]) -> None:
    writer = Writer("family.toml", SHOP | {"shop.environment": ""})
    offers = writer.offers(family(text))
    assert some <= offers.keys()
    assert "weight" not in offers


def test_options_of_families_have_their_documentation_and_default() -> None:
    offers = writing("family.toml").offers(family("[search]\n|"))
    assert offers["population"]["documentation"]["value"] == "number of members of the family."
    assert offers["population"]["detail"] == "default 6"


@pytest.mark.parametrize(
    ("name", "text", "label", "active"),
    [
        ("a.query", body("find inside(box, |"), "inside(part : Box, whole : Box)", 1),
        ("a.query", body("find inside+(|, box);"), "inside(part : Box, whole : Box)", 0),
        ("a.query", body("Box.label.text(box, |);"), "Box.label.text(object : Box, value : string)", 1),
        ("a.query", body("Box(|);"), "Box(object : Box)", 0),
        ("a.query", body("check(max(1, 2, 3, |)"), "max(number, number, ...)", 2),
        ("a.rules", "@weight(|) rule r { }", "@weight(number)", 0),
        ("a.rules", "unit u { unpack(|); }", "unpack(box : Box)", 0),
    ],
)
def test_the_parameters_of_a_call_are_shown(name: str, text: str, label: str, active: int) -> None:
    found = writing(name).ask("signatureHelp", text)
    (signature,) = found["signatures"]
    assert (signature["label"], found["activeParameter"]) == (label, active)
    start, end = signature["parameters"][0]["label"]
    assert label[start - 1] == "("
    assert label[end] in ",)"


def test_no_parameters_are_shown_outside_of_calls() -> None:
    for text in (body("|"), body("find inside(box, box); |"), "pattern p(|) { }"):
        assert writing("a.query").ask("signatureHelp", text) is None


# --- every place of the bundled domains ---


def places(path: Path) -> Iterator[tuple[int, int]]:
    """Yield start and end of all keywords, and of all names that are not defined where they are."""
    (document,) = bundled_document(path).documents.values()
    for part in text_parts(document.source):
        names = {one.start: one for one in mentions_of(part).all}
        variables = [one.text for one in names.values() if one.kind == "variable"]
        for lexeme in part.reading.lexemes:
            name = names.get(lexeme.start)
            is_new = name is not None and (name.is_definition or name.kind in ("package", "alias"))
            is_key = name is not None and name.kind == "variable" and path.suffix == ".query" and "@" in part.text
            is_letter = (
                name is None
                and path.suffix == ".model"
                and len(lexeme.value) == 1
                and part.text[lexeme.end :].startswith(" = ")
            )
            if lexeme.kind != "NAME" or is_new or is_key or is_letter or lexeme.value == "_":
                continue
            if name is None or name.kind != "variable" or variables.count(name.text) > 1:
                yield part.start + lexeme.start, part.start + lexeme.end


def bundled_document(path: Path) -> LanguageService:
    service = LanguageService(lambda method, params: None)
    service.answer("initialize", {"workspaceFolders": [{"uri": path.parent.as_uri(), "name": path.parent.name}]})
    document = {"uri": path.as_uri(), "text": path.read_text("utf-8"), "version": 1, "languageId": ""}
    service.answer("textDocument/didOpen", {"textDocument": document})
    service.check()
    return service


def missing_offers(path: Path, share: float) -> list[str]:
    """Delete single words of a file, and return those that are not among the offers in their place."""
    service, found = bundled_document(path), []
    (document,) = service.documents.values()
    text, chance = document.source.text, random.Random(path.name)
    for start, end in [one for one in places(path) if chance.random() < share]:
        position = document.position(start)
        cut = {"range": {"start": position, "end": document.position(end)}, "text": ""}
        there = {"uri": document.uri}
        service.answer("textDocument/didChange", {"textDocument": there, "contentChanges": [cut]})
        offers = service.answer("textDocument/completion", {"textDocument": there, "position": position})
        service.answer("textDocument/didChange", {"textDocument": there, "contentChanges": [{"text": text}]})
        word = text[start:end]
        if not {word, f"::{word}"} & {one["label"] for one in offers}:
            found.append(f"{path.name}: {text[max(0, start - 20) : start]}|{text[start : end + 10]}")
    return found


def files_of(domains: list[str]) -> list[Path]:
    return [one for name in domains for one in sorted(data_path("rules", name).iterdir()) if language_of(one.name)]


@pytest.mark.parametrize("path", files_of(["sokoban", "triage"]), ids=lambda path: path.name)
def test_a_deleted_word_is_among_the_offers_in_its_place(path: Path) -> None:
    assert missing_offers(path, 0.1) == []


@AT_NIGHT
@pytest.mark.parametrize("path", files_of(bundled_domains()), ids=lambda path: path.name)
def test_every_deleted_word_is_among_the_offers_in_its_place(path: Path) -> None:
    assert missing_offers(path, 1.0) == []


def wrong_offers(path: Path, share: float) -> list[str]:
    """Write each offered name in place of a name of a file; return those that are unknown or not accepted there."""
    texts = {one.name: one.read_text("utf-8") for one in path.parent.iterdir() if language_of(one.name)}
    text, chance, found = texts[path.name], random.Random(path.name), []
    writer = Writer(path.name, texts)
    writer.open(text)
    writer.service.check()
    for start, end in [one for one in places(path) if chance.random() < share]:
        for offer in writer.ask("completion", f"{text[:start]}|{text[end:]}"):
            written = offer["textEdit"]["newText"]
            if offer["kind"] == _KEYWORD or "${" in written or written.endswith("::"):
                continue
            changed = {**texts, path.name: text[:start] + written + text[end:]}
            for problem in load_workspace(["."], files=TextFiles(changed)).errors:
                span = problem.span
                is_here = span and span.source.name == path.name and start <= span.start <= start + len(written)
                if is_here and problem.code.startswith(("unknown-", "unexpected-")):
                    found.append(f"{path.name}: {text[max(0, start - 20) : start]}{written}: {problem.message}")
    return found


@pytest.mark.parametrize("path", files_of(["jobshop"])[:1] + files_of(["sokoban"])[-2:], ids=lambda path: path.name)
def test_offered_names_are_known_in_their_place(path: Path) -> None:
    assert wrong_offers(path, 0.04) == []


@AT_NIGHT
@pytest.mark.parametrize("path", files_of(["sokoban", "jobshop", "keydoor"]), ids=lambda path: path.name)
def test_all_offered_names_are_known_in_their_place(path: Path) -> None:
    assert wrong_offers(path, 0.3) == []


_PIECES = ("", "{", "}", "(", ")", '"', ";", ":", "::", ".", "-", "<-", "/*", "[", "@", "\N{GRINNING FACE}", "\r\n")


def check_damaged_texts(number: int, seed: int) -> None:
    """Ask all requests about bundled files that are cut off or damaged at random places."""
    chance = random.Random(seed)
    paths = [one for name in bundled_domains() for one in sorted(data_path("rules", name).glob("*.*"))]
    for _ in range(number):
        path = chance.choice(paths)
        text = path.read_text("utf-8")
        for _ in range(chance.randrange(1, 4)):
            place = chance.randrange(len(text))
            text = text[:place] + chance.choice(_PIECES) + text[place + chance.choice((0, 1, 20)) :]
        text = text[: chance.randrange(len(text))] if chance.random() < 0.5 else text
        writer = Writer(path.name, {})
        for _ in range(5):
            place = chance.randrange(len(text) + 1)
            for method in ("completion", "signatureHelp"):
                writer.ask(method, text[:place].replace("|", "") + "|" + text[place:])
        everything = {"start": {"line": 0, "character": 0}, "end": {"line": 9999, "character": 0}}
        for method in ("semanticTokens/full", "foldingRange", "formatting", "documentLink", "codeAction"):
            params = {"textDocument": {"uri": writer.uri}, "range": everything, "context": {"diagnostics": []}}
            writer.service.answer(f"textDocument/{method}", params)


def test_damaged_texts_raise_no_exception() -> None:
    check_damaged_texts(12, seed=1)


@AT_NIGHT
def test_many_damaged_texts_raise_no_exception() -> None:
    check_damaged_texts(1000, seed=2)


@pytest.mark.parametrize(
    ("name", "text", "offered"),
    [
        ("a.query", body("Box.inner(box, other);") + "\npattern q(box : Box) {\n    Box(box);\n    find |", "p"),
        ("a.rules", rule("lhs { box : Box; }") + "\nrule s {\n    lhs { x : Box; }\n    modify { set |", "x"),
    ],
)
def test_definitions_before_an_unfinished_end_of_the_file_are_offered(name: str, text: str, offered: str) -> None:
    assert offered in writing(name).names(text)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("class C extends |", ["B", "D"]),
        ("class C {\n    contains |", ["B", "D", "C"]),
        ("class C {\n    |", ["E", "bool", "float", "int", "string"]),
    ],
)
def test_types_of_an_unfinished_metamodel_are_offered(text: str, names: list[str]) -> None:
    begin = "metamodel a\n\nenum E { one }\n\nclass B { refers Later[*] later }\n\nabstract class D\n\n"
    assert sorted(writing("a.metamodel").names(begin + text)) == sorted(names)


@pytest.mark.parametrize(
    ("name", "text", "keywords"),
    [
        ("a.query", body("Box.inner(box, |"), {"none"}),
        ("a.query", body("Box.size(box, |"), {"none"}),
        ("a.query", body("Box.weight(box, n); n == |"), {"none", "count", "sum"}),
        ("a.query", body("check(|"), {"true", "false", "none"}),
        ("a.metamodel", "metamodel a\nclass B {\n    int n = |", set()),
        ("a.metamodel", "metamodel a\nclass B {\n    bool n = |", {"true", "false"}),
        ("a.metamodel", "metamodel a\n@key(|", set()),
        ("a.model", 'import "shop.metamodel"\nmodel a : shop {\n    b : Box { size = |', {"none"}),
        ("a.model", 'import "shop.metamodel"\nmodel a : shop {\n    b : Box { label = |', {"none"}),
        ("a.model", 'import "shop.metamodel"\nmodel a : shop {\n    b : Box { inner = |', {"none", "grid", "table"}),
    ],
)
def test_values_of_other_types_are_not_offered(name: str, text: str, keywords: set[str]) -> None:
    values = {"true", "false", "none", "grid", "table", "count", "sum"}
    assert keywords == {label for label, one in writing(name).offers(text).items() if one["kind"] == _KEYWORD} & values


@pytest.mark.parametrize(
    ("text", "word"), [(body("f|"), "find"), (body("n|"), "neg"), (body("c|"), "check"), ("p|", "pattern")]
)
def test_keywords_that_begin_statements_are_first(text: str, word: str) -> None:
    offers = [one for one in writing("a.query").offers(text).values() if one["label"].startswith(word[0])]
    assert min(offers, key=lambda one: one["sortText"])["label"] == word


def test_uris_of_ecore_packages_are_offered_in_imports() -> None:
    """The URI is that of the package, as VIATRA imports it."""
    source = Path(__file__).parents[2] / "golden" / "shared" / "library.ecore"
    texts = {"library.ecore": source.read_text(encoding="utf-8"), "old.vql": 'import "library.ecore"\n'}
    labels = [*Writer("a.vql", texts).offers('import "|"\n')]
    assert "library.ecore" in labels
    assert any("://" in one for one in labels)
