"""The wheel works on its own, and every version is pinned."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from datetime import date
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from docs.release import (
    FIRST_TUTORIAL,
    VERSIONED,
    NotReleasable,
    check_has_page,
    check_version,
    run_page,
    set_version,
)
from envgraph.search import generate
from envgraph.search.export import write_package

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CONSTRAINTS = (ROOT / "constraints.txt").read_text(encoding="utf-8")
PINS = {
    canonicalize_name(name): version
    for name, version in re.findall(r"^([\w.-]+)==([^\s;]+)", CONSTRAINTS, flags=re.MULTILINE)
}


FAMILIES = ("burning_forest/paper.toml", "keydoor/diverse.toml", "network/diverse.toml")
COMMANDS = f"""
import sys
import envgraph.env, gymnasium
from envgraph.cli import main
from envgraph.lang import bundled_domain
domain = bundled_domain("burning_forest")
for words in [
    ["check", *map(str, sorted(domain.glob("*.query")))],
    ["help", "unknown-class"],
    *(
        ["generate", name, "--generations", "1", "--population", "2", "--seed", "1", "--name", name.partition("/")[0]]
        for name in {FAMILIES}
    ),
]:
    sys.argv = ["envgraph", *words]
    assert main() == 0, words
print(gymnasium.make("envgraph/Warehouse-v0").reset(seed=0)[1])
print(domain)
"""
"""Several commands in one process, which imports everything once."""


def run(*command: str | Path, cwd: Path) -> str:
    """Standard output of a command that must succeed, run without the checkout on any path."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from the checkout."""
    out = tmp_path_factory.mktemp("wheel")
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", out, cwd=ROOT)
    (built,) = out.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def scripts(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scripts directory of a fresh environment with the wheel in it."""
    return environment_with_wheel(tmp_path_factory.mktemp("fresh"), wheel).parent


def environment_with_wheel(home: Path, wheel: Path) -> Path:
    """The Python of a new environment with a wheel in it."""
    run(sys.executable, "-m", "venv", "--without-pip", home, cwd=wheel.parent)
    python = home / "bin" / "python"
    run(sys.executable, "-m", "pip", "--python", python, "install", "--no-index", "--no-deps", wheel, cwd=home)
    # Dependencies are borrowed from this environment, to install nothing twice. A path file inside a borrowed
    # directory is not read, so an editable envgraph there stays invisible. Written last: pip would see it.
    site = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=home).strip())
    borrowed = dict.fromkeys(sysconfig.get_path(kind) for kind in ("purelib", "platlib"))
    (site / "borrowed.pth").write_text("\n".join(borrowed), encoding="utf-8")
    return python


def installed_package(scripts: Path, cwd: Path) -> Path:
    """Where the fresh environment imports envgraph from."""
    found = "import envgraph.errors as e, pathlib; print(pathlib.Path(e.__file__).parents[1])"
    return Path(run(scripts / "python", "-c", found, cwd=cwd).strip())


def test_wheel_ships_package_grammars_and_rules(wheel: Path) -> None:
    expected = {"envgraph/py.typed"}
    for top, pattern in (("grammars", "*.lark"), ("rules", "*")):
        for path in (ROOT / top).rglob(pattern):
            if path.is_file() and "__pycache__" not in path.parts:
                expected.add(f"envgraph/_data/{path.relative_to(ROOT).as_posix()}")
    names = set(zipfile.ZipFile(wheel).namelist())
    assert expected <= names
    assert not {name for name in names if not name.startswith(("envgraph/", "envgraph-"))}


def test_source_distribution_ships_all_files_needed_to_build_a_wheel(tmp_path: Path) -> None:
    run(sys.executable, "-m", "build", "--sdist", "--no-isolation", "--outdir", tmp_path, cwd=ROOT)
    (built,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(built) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    expected = {"pyproject.toml", "LICENSE", "README.md"}
    for top in ("envgraph", "grammars", "rules"):
        files = [path for path in (ROOT / top).rglob("*") if path.is_file() and path.suffix != ".pyc"]
        expected |= {path.relative_to(ROOT).as_posix() for path in files}
    assert expected <= names


def test_fresh_environment_imports_the_wheel(scripts: Path, tmp_path: Path) -> None:
    package = installed_package(scripts, tmp_path)
    assert package.is_relative_to(scripts.parent)
    assert not package.is_relative_to(ROOT)


def test_wheel_checks_and_generates_from_an_empty_directory(scripts: Path, tmp_path: Path) -> None:
    *_, reset, domain = run(scripts / "python", "-c", COMMANDS, cwd=tmp_path).splitlines()
    assert "'agent': 'left'" in reset
    assert Path(domain).is_relative_to(installed_package(scripts, tmp_path))
    run(scripts / "envgraph", "check", domain, "keydoor", "network", "warehouse", cwd=tmp_path)
    for name in FAMILIES:
        assert (tmp_path / "runs" / name.partition("/")[0] / "run.sqlite").is_file()


def test_wheel_runs_the_first_tutorial(scripts: Path) -> None:
    run_page(scripts / "python", FIRST_TUTORIAL)


def test_text_for_the_package_index_has_no_relative_links(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        head, _, text = archive.read(name).decode().partition("\n\n")
    assert "Description-Content-Type: text/markdown" in head
    assert text.startswith("envgraph makes a family")
    assert [link for link in re.findall(r"\]\(([^)]*)\)", text) if not link.startswith("https://")] == []


def test_all_files_have_the_same_version() -> None:
    found = {re.search(line, (ROOT / name).read_text("utf-8"), re.MULTILINE)[1] for name, line in VERSIONED.items()}
    assert found == {PYPROJECT["project"]["version"]}


def test_a_wheel_has_the_built_page_if_there_is_one_and_is_not_released_without(wheel: Path, tmp_path: Path) -> None:
    if (ROOT / "envgraph" / "page" / "built" / "index.html").exists():
        check_has_page(wheel)
    with zipfile.ZipFile(tmp_path / "bare.whl", "w") as bare:
        bare.writestr("envgraph/__init__.py", "")
    with pytest.raises(NotReleasable, match="run `make page` first"):
        check_has_page(tmp_path / "bare.whl")


def test_a_release_sets_the_version_in_all_files(tmp_path: Path) -> None:
    for name in VERSIONED:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    set_version(tmp_path, "12.3.4", date(2031, 5, 6))
    for name, line in VERSIONED.items():
        before, after = ((root / name).read_text("utf-8").splitlines() for root in (ROOT, tmp_path))
        changed = [new for old, new in zip(before, after, strict=True) if old != new]
        assert re.search(line, changed[0])[1] == "12.3.4"
        assert changed[1:] == (["date-released: 2031-05-06"] if name == "CITATION.cff" else [])


@pytest.mark.parametrize("version", ["0.1.9", PYPROJECT["project"]["version"], "1.0", "v9.0.0", "9.0.0rc1"])
def test_a_release_refuses_versions_that_are_not_later_or_not_three_numbers(version: str) -> None:
    with pytest.raises(NotReleasable, match=f"the version is '?{version}'?, but must be"):
        check_version(version)


def test_an_exported_package_works_without_envgraph_installed(tmp_path: Path) -> None:
    small = ["search.generations=1", "search.population=2"]
    write_package(generate("burning_forest/paper.toml", tmp_path / "run.sqlite", overrides=small), tmp_path / "fires")
    build = (sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", tmp_path)
    run(*build, tmp_path / "fires", cwd=tmp_path)
    (built,) = tmp_path.glob("*.whl")
    names = {name for name in zipfile.ZipFile(built).namelist() if not name.startswith("fires-")}
    assert names == {"fires/__init__.py", "fires/environment.py", "fires/tables.npz"}
    python = environment_with_wheel(tmp_path / "fresh", built)
    tests = run(python, "-m", "pytest", "-q", "-p", "no:cacheprovider", tmp_path / "fires" / "tests", cwd=tmp_path)
    assert "8 passed" in tests
    run(
        python,
        "-c",
        "import fires, importlib.util; assert not importlib.util.find_spec('envgraph')",
        cwd=tmp_path,
    )


def test_constraints_are_names_and_versions_only() -> None:
    for line in CONSTRAINTS.splitlines():
        assert re.fullmatch(r"#.*|[\w.-]+==[\w.]+( ; [^/@]+)?", line), line
    assert "://" not in CONSTRAINTS


def declared() -> list[Requirement]:
    """Everything that pyproject.toml asks for: at run time, in each extra, and to build."""
    extras = PYPROJECT["project"]["optional-dependencies"].values()
    groups = [PYPROJECT["project"]["dependencies"], PYPROJECT["build-system"]["requires"], *extras]
    return [Requirement(line) for group in groups for line in group]


def test_every_declared_dependency_is_pinned_within_its_range() -> None:
    for requirement in declared():
        assert PINS[canonicalize_name(requirement.name)] in requirement.specifier, requirement.name


def test_every_transitive_dependency_is_pinned() -> None:
    todo, seen = declared(), set()
    while todo:
        name = canonicalize_name(todo.pop().name)
        if name in seen:
            continue
        seen.add(name)
        assert name in PINS
        try:
            needs = distribution(name).requires or []
        except PackageNotFoundError:  # an extra that is not installed here
            continue
        for requirement in map(Requirement, needs):
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                todo.append(requirement)
    # What the benchmarks compare with is not installed by `make test`, so nobody knows here what it needs; some
    # Pythons bring setuptools, which PyTorch asks for.
    unknown = {name for name in PINS if not installed(name)} | {"setuptools"}
    assert set(PINS) - unknown <= seen, "pinned, but nothing needs it"


def installed(name: str) -> bool:
    try:
        distribution(name)
    except PackageNotFoundError:
        return False
    return True


def test_the_top_level_contains_only_expected_files() -> None:
    git = ("git", "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard")
    top = {line.split("/")[0] for line in run(*git, cwd=ROOT).splitlines()}
    folders = {".ci", ".github", "benchmarks", "docs", "editors", "envgraph", "grammars", "rules", "tests"}
    files = {
        "CHANGELOG.md",
        "CITATION.cff",
        "CONTRIBUTING.md",
        "LICENSE",
        "Makefile",
        "README.md",
        "constraints.txt",
        "pyproject.toml",
    }
    assert top <= folders | files | {".gitignore", ".gitattributes"}
