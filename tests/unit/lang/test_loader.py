"""Reading several files: imports, whole workspaces, engines. What is said about mistakes: tests/golden/loader."""

import os
import shutil
from pathlib import Path

import pytest

import envgraph
from envgraph.errors import Diagnostic, InvalidArgument, LoadError
from envgraph.lang import (
    Bundle,
    TextFiles,
    Workspace,
    bundled_domain,
    bundled_domains,
    load,
    load_workspace,
)

METAMODEL = "metamodel m class Box { int size  contains Box[0..*] parts }"
MODEL = 'import "m.metamodel"\nmodel a : m { box : Box { size = 3 parts = [Box { }, Box { }] } }'
QUERY = 'package m\nimport "m.metamodel"\npattern big(box : Box) { Box.size(box, size); check(size > 2); }'
RULES = 'package m\nimport "m.query"\nrule shrink { lhs { find big(box); } modify { set box.size = 0; } }'
TEXTS = {"m.metamodel": METAMODEL, "a.model": MODEL, "m.query": QUERY, "m.rules": RULES}


@pytest.fixture
def directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in TEXTS.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def workspace(*roots: str, **texts: str) -> Workspace:
    return load_workspace(
        roots, files=TextFiles(TEXTS | {name.replace("_", "."): text for name, text in texts.items()})
    )


def shown(diagnostics: tuple[Diagnostic, ...]) -> list[str]:
    return [f"{one.span}: {one.message}" for one in diagnostics]


# --- engines ---


def test_open_gives_an_engine_with_everything_loaded(directory: Path) -> None:
    engine = envgraph.open("a.model", "m.rules")
    assert [match.box for match in engine.matches("big")] == [engine.model["box"]]
    assert engine.apply("shrink") is not None
    assert engine.count("big") == 0


def test_the_bundled_domain_opens_by_name() -> None:
    engine = envgraph.open("burning_forest")
    assert engine.count("burningTile") == 20
    assert engine.exists("solvable")
    assert len(engine.group("retypings")) == 6


def test_opening_a_family_directory_loads_the_model_of_its_family(tmp_path: Path) -> None:
    shutil.copytree(bundled_domain("burning_forest"), tmp_path / "mine")
    assert envgraph.open(tmp_path / "mine").model.name == "target_8x8"
    assert envgraph.open(tmp_path / "mine" / "family.toml").model.name == "target_8x8"


def test_without_a_model_the_engine_has_an_empty_one(directory: Path) -> None:
    engine = envgraph.open("m.query")
    assert len(engine.model) == 0
    engine.model.create("Box", size=5)
    assert engine.count("big") == 1


def test_an_engine_needs_a_metamodel(directory: Path) -> None:
    (directory / "empty.query").write_text("package e")
    with pytest.raises(InvalidArgument, match="none of the files is a metamodel"):
        envgraph.open("empty.query")


def test_two_models_are_too_many_for_one_engine(directory: Path) -> None:
    (directory / "b.model").write_text(MODEL.replace("model a", "model b"))
    with pytest.raises(InvalidArgument, match=r"several models: `a` in .*a\.model, `b` in .*b\.model"):
        envgraph.open("a.model", "b.model")
    both = load_workspace(["a.model", "b.model"])
    assert both.engine("b").model.name == "b"
    with pytest.raises(InvalidArgument, match="did you mean"):
        load_workspace(["a.model"]).model("aa")


def test_one_seed_gives_one_sequence_of_choices() -> None:
    def run(seed: int) -> list[object]:
        engine = envgraph.open("burning_forest", seed=seed)
        for _ in range(5):
            engine.apply("changeRoadToBurning")
        return [(node.x, node.y) for node in engine.model.nodes("BurningTile")]

    assert run(1) == run(1)
    assert run(1) != run(2)


def test_load_adds_to_an_engine(directory: Path) -> None:
    engine = envgraph.open("a.model")
    load(engine, "m.rules")
    assert engine.count("big") == 1
    assert engine.rules == ("m.shrink",)


def test_loading_twice_changes_nothing(directory: Path) -> None:
    engine = envgraph.open("a.model", "m.rules")
    load(engine, "m.rules")
    assert engine.rules == ("m.shrink",)


def test_load_refuses_another_metamodel(directory: Path) -> None:
    (directory / "n.metamodel").write_text("metamodel n class Box")
    (directory / "n.query").write_text('import "n.metamodel"\npattern p(box : Box) { Box(box); }')
    with pytest.raises(InvalidArgument, match="the files use metamodel `n`"):
        load(envgraph.open("a.model"), "n.query")


def test_a_failed_load_adds_nothing(directory: Path) -> None:
    (directory / "bad.query").write_text(QUERY + "\npattern bad(x : Nope) { Nope(x); }")
    engine = envgraph.open("a.model")
    with pytest.raises(LoadError, match="unknown"):
        load(engine, "bad.query")
    assert engine.library.names() == ()


def test_behaviours_are_loaded_by_path() -> None:
    path = bundled_domain("burning_forest") / "burning_forest.environment"
    behaviour = load_workspace([path]).behaviour()
    assert [action.name for action in behaviour.actions] == ["left", "down", "right", "up"]
    with pytest.raises(InvalidArgument, match="their environments are `BurningForest`"):
        load_workspace([path]).behaviour("Other")


# --- imports ---


def test_imports_are_transitive_and_each_file_is_read_once() -> None:
    found = workspace("m.rules", "a.model", "m.query")
    assert not found.diagnostics
    assert list(found.sources) == ["m.rules", "m.query", "m.metamodel", "a.model"]
    assert found.roots == ("m.rules", "a.model", "m.query")
    assert [one.name for one in found.patterns] == ["big"]


def test_circular_imports_are_allowed() -> None:
    first = 'package m\nimport "b.query"\nimport "m.metamodel"\npattern one(x : Box) { find two(x); }'
    second = 'package m\nimport "a.query"\npattern two(x : Box) { Box(x); }'
    found = workspace("a.query", a_query=first, b_query=second)
    assert not found.errors
    assert [one.name for one in found.patterns] == ["one", "two"]


def test_long_chains_of_imports_are_followed() -> None:
    texts = {f"{i}.query": f'import "{i + 1}.query"' for i in range(3000)}
    texts |= {"3000.query": 'import "m.metamodel"', "m.metamodel": METAMODEL}
    assert len(load_workspace(["0.query"], files=TextFiles(texts)).sources) == 3002


def test_imports_are_relative_to_their_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "m.metamodel").write_text(METAMODEL)
    (tmp_path / "a" / "b" / "m.query").write_text(QUERY.replace("m.metamodel", "../m.metamodel"))
    monkeypatch.chdir(tmp_path)
    found = load_workspace(["a/b/m.query"])
    assert list(found.sources) == ["a/b/m.query", "a/m.metamodel"]
    assert not found.diagnostics


def test_a_file_with_several_paths_is_read_once(directory: Path) -> None:
    os.symlink(directory / "m.metamodel", directory / "link.metamodel")
    (directory / "b.query").write_text('import "link.metamodel"\nimport "./m.metamodel"')
    found = load_workspace(["b.query", str(directory / "m.metamodel"), "../" + directory.name + "/a.model"])
    assert not found.errors
    assert sorted(found.sources) == ["a.model", "b.query", "m.metamodel"]


def test_metamodels_can_be_imported_by_uri() -> None:
    metamodel = METAMODEL.replace("metamodel m", 'metamodel m uri "http://example.org/m"')
    query = QUERY.replace("m.metamodel", "http://example.org/m")
    assert not workspace("m.metamodel", "m.query", m_metamodel=metamodel, m_query=query).errors


# --- errors ---


def test_errors_of_all_files_are_reported_together_in_reading_order() -> None:
    found = workspace(
        "a.model",
        "m.rules",
        m_metamodel="metamodel m class Box { int size  contains Box[0..*] parts }",
        a_model=MODEL.replace("size = 3", "sise = 3"),
        m_query=QUERY + " pattern bad(x : Bax) { Bax(x); }",
        m_rules=RULES.replace("set box.size", "set box.sise").replace("rule shrink", "rul shrink"),
    )
    names = [one.span.source.name for one in found.errors if one.span]
    assert names == sorted(names, key=["a.model", "m.metamodel", "m.rules", "m.query"].index)
    assert set(names) == {"a.model", "m.rules", "m.query"}


def test_open_raises_all_errors_at_once(directory: Path) -> None:
    (directory / "a.model").write_text(MODEL.replace("size = 3", "sise = 3 other = 4"))
    with pytest.raises(LoadError) as caught:
        envgraph.open("a.model", "nothing.query")
    assert shown(caught.value.diagnostics) == [
        "a.model:2:27: `Box` has no feature `sise`",
        "a.model:2:36: `Box` has no feature `other`",
        "nothing.query:1:1: there is no such file",
    ]
    assert " 2 | model a : m {" in str(caught.value)


def test_a_file_with_mistakes_does_not_make_its_names_unknown() -> None:
    found = workspace("m.rules", m_query=QUERY.replace("pattern big(", "pattern big(("))
    assert [one.span.source.name for one in found.errors if one.span] == ["m.query"]


def test_files_that_cannot_be_read_are_diagnosed(directory: Path) -> None:
    (directory / "latin.query").write_bytes(b"package a\n// caf\xe9\n")
    (directory / "large.query").write_bytes(b" " * (50 * 1024 * 1024))
    (directory / "dir.query").mkdir()
    found = load_workspace(["latin.query", "large.query", "dir.query", "m.qury", "nul\0l.query", "x" * 5000 + ".query"])
    messages = [one.message for one in found.errors]
    assert messages[:3] == [
        "the byte 0xe9 is not UTF-8",
        "the file has more than 1 MB",
        "the directory contains no file in a language of envgraph",
    ]
    assert shown(found.errors)[0].startswith("latin.query:2:7")
    assert shown(found.errors)[3] == "m.qury:1:1: there is no such file"
    assert found.errors[3].hint == "did you mean `m.query`?"
    assert len(messages) == 6


def test_models_and_metamodels_have_a_higher_size_limit_than_queries(directory: Path) -> None:
    for name, size in (("q.rules", 1), ("e.environment", 1), ("m.model", 16), ("n.metamodel", 16)):
        (directory / name).write_bytes(b" " * (size * 1024 * 1024 + 1))
        (error,) = load_workspace([name]).errors
        assert error.message == f"the file has more than {size} MB"
    assert error.hint == "set the environment variable ENVGRAPH_LIMITS=10 to make every limit ten times as large"


def test_limits_are_raised_by_an_environment_variable(directory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = directory / "q.query"
    path.write_bytes(QUERY.encode() + b" " * (1024 * 1024))
    monkeypatch.setenv("ENVGRAPH_LIMITS", "1.5")
    assert not load_workspace([path]).errors
    path.write_bytes(b" " * (2 * 1024 * 1024))
    assert load_workspace([path]).errors[0].message == "the file has more than 1.5 MB"
    for wrong in ("many", "0", "-1", "nan", "inf"):
        monkeypatch.setenv("ENVGRAPH_LIMITS", wrong)
        with pytest.raises(InvalidArgument, match=f"ENVGRAPH_LIMITS is `{wrong}`"):
            load_workspace([path])


def test_files_of_other_kinds_are_refused(directory: Path) -> None:
    (directory / "notes.txt").write_text("hello")
    (error,) = load_workspace(["notes.txt"]).errors
    assert error.message == "`notes.txt` is not a file in a language of envgraph"


def test_a_byte_order_mark_is_skipped(directory: Path) -> None:
    (directory / "m.metamodel").write_text(METAMODEL, encoding="utf-8-sig")
    assert not load_workspace(["a.model"]).diagnostics


def test_a_mistyped_domain_gets_a_hint() -> None:
    (error,) = load_workspace(["burning_forst"]).errors
    assert error.hint == "did you mean `burning_forest`?"


def test_warnings_do_not_stop_a_load(directory: Path) -> None:
    (directory / "w.query").write_text(
        'import "m.metamodel"\npattern pairs(a : Box, b : Box) { Box(a); Box(b); Box.size(a, unused); }'
    )
    found = load_workspace(["w.query"])
    assert found.diagnostics and not found.errors
    assert envgraph.open("w.query").count("pairs") == 0


# --- texts instead of files ---


def test_bundles_load_the_same_anywhere(directory: Path) -> None:
    (directory / "sub").mkdir()
    (directory / "sub" / "b.model").write_text(MODEL.replace("m.metamodel", "../m.metamodel"))
    there = load_workspace([directory / "sub" / "b.model", "m.rules"])
    bundle = there.bundle()
    assert bundle == Bundle(
        ("sub/b.model", "m.rules"),
        {
            "m.metamodel": METAMODEL,
            "m.query": QUERY,
            "m.rules": RULES,
            "sub/b.model": there.sources["sub/b.model"],
        },
    )
    here = load_workspace(bundle.roots, files=TextFiles(bundle.texts))
    assert not here.diagnostics
    assert here.engine().model.state_hash() == there.engine().model.state_hash()
    assert here.patterns == there.patterns and here.rules == there.rules


def test_bundles_of_files_outside_the_working_directory_are_relative(
    directory: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    bundle = load_workspace([directory / "m.rules"]).bundle()
    assert bundle.roots == ("m.rules",)
    assert sorted(bundle.texts) == ["m.metamodel", "m.query", "m.rules"]


def test_workspaces_of_texts_do_not_read_the_disk() -> None:
    found = load_workspace(["burning_forest"], files=TextFiles({}))
    assert [one.code for one in found.errors] == ["missing-file"]
    found = load_workspace(["a.query"], files=TextFiles({"a.query": 'import "/elsewhere/m.query"'}))
    assert [one.code for one in found.errors] == ["missing-file"]


def test_family_files_are_part_of_a_workspace() -> None:
    found = load_workspace(["burning_forest"])
    assert not found.errors
    assert [spec.name for spec in found.families] == ["BurningForestTeaching"]
    assert sorted(text.name for text in found.models) == ["running_4x4", "target_8x8"]
    assert found.behaviour().name == "BurningForest"


def test_bundled_domains_have_no_warnings() -> None:
    for name in bundled_domains():
        assert not load_workspace([str(bundled_domain(name))]).diagnostics
        files = [str(one) for one in bundled_domain(name).glob("*.*") if one.suffix != ".toml"]
        assert not load_workspace(files).diagnostics


def test_bundled_domains_are_listed_and_found() -> None:
    assert "burning_forest" in bundled_domains()
    assert (bundled_domain("burning_forest") / "family.toml").is_file()
    with pytest.raises(InvalidArgument, match="did you mean `burning_forest`"):
        bundled_domain("burnin_forest")


# --- the sample domains ---

SAMPLES = Path(__file__).parents[2] / "golden" / "shared"


@pytest.mark.parametrize("family", ["keydoor.toml", "network/family.toml", "warehouse/family.toml"])
def test_the_sample_domains_load(family: str) -> None:
    found = load_workspace([SAMPLES / family])
    # What the engine cannot do yet it says; nothing else is wrong.
    assert {one.code for one in found.errors} <= {"not-supported"}
    assert found.models[0].model is not None
    assert found.behaviours[0].actions or found.behaviours[0].agents


def test_tables_and_grids_of_the_samples_create_the_expected_objects() -> None:
    (backbone,) = load_workspace([SAMPLES / "network" / "backbone.model"]).models
    assert backbone.model is not None
    links = [(link["from"].name, link.to.name, link.latency) for link in backbone.model["net"].links]
    assert links[0] == ("Amsterdam", "Berlin", 6.5)
    assert len(links) == 9
    assert [link.to.name for link in backbone.model["gva"].ports] == ["Amsterdam", "Lisbon", "Budapest"]
    (rooms,) = load_workspace([SAMPLES / "two_rooms.model"]).models
    assert rooms.model is not None
    assert [key.colour for key in rooms.model.nodes("Key")] == ["red"]
    assert rooms.model["hero"].at.cls == "Floor"


def test_functions_that_are_read_again_equal_those_of_the_engine() -> None:
    files = {
        "m.metamodel": "metamodel m\nclass P { string s }",
        "p.query": 'import "m.metamodel"\nfunction f(s : string) : bool;\n'
        "pattern p(x : P) { P.s(x, s); check(s.length > 1 && Util::f(s) && s.trim.equals(s)); }",
    }
    engine = load_workspace(["p.query"], files=TextFiles(files)).engine()
    engine.add(*(one for one in load_workspace(["p.query"], files=TextFiles(files)).functions))
    assert engine.definitions == load_workspace(["p.query"], files=TextFiles(files)).definitions


def test_too_many_files_are_one_error(monkeypatch: pytest.MonkeyPatch) -> None:
    texts = {f"f{n}.query": f'import "f{n + 1}.query"\n' for n in range(20)} | {"f20.query": ""}
    monkeypatch.setenv("ENVGRAPH_LIMITS", "0.002")
    (problem,) = load_workspace(["f0.query"], files=TextFiles(texts)).errors
    assert str(problem).startswith("f19.query:1:8: more than 20 files would be read together\n 1 | import")
    assert problem.hint is not None and "ENVGRAPH_LIMITS" in problem.hint
    monkeypatch.delenv("ENVGRAPH_LIMITS")
    assert not load_workspace(["f0.query"], files=TextFiles(texts)).errors


def test_declarations_of_functions_need_no_metamodel() -> None:
    files = TextFiles({"f.query": "function f(x : int) : string;\n"})
    assert not load_workspace(["f.query"], files=files).diagnostics
