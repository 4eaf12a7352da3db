"""Prepare a release: `make release VERSION=0.3.0`, in a clone without changes.

The script moves the entries of `docs/changes` to the changelog, sets the version, builds the wheel and the source
distribution, and tries the wheel alone in a fresh environment. At the end it prints the commands that publish the
release. It never commits, pushes or uploads.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Mapping
from datetime import date
from pathlib import Path

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
FIRST_TUTORIAL = "tutorials/maze.md"

VERSIONED = {
    "pyproject.toml": r'^version = "(.*)"$',
    "envgraph/__init__.py": r'^__version__ = "(.*)"$',
    "CITATION.cff": r"^version: (.*)$",
    "editors/vscode/package.json": r'^  "version": "(.*)",$',
}
"""The files that contain the version, and the line of each."""


class NotReleasable(Exception):
    """A reason why the release cannot be prepared."""


def main() -> None:
    """Prepare the release that the command line names, and print what to type next."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("version", help="the new version, such as 0.3.0")
    version = parser.parse_args().version
    try:
        check_version(version)
        check_clone(version)
        run("towncrier", "build", "--yes", "--version", version)
        set_version(ROOT, version, date.today())
        wheel = build()
        with tempfile.TemporaryDirectory() as folder:
            run_page(install(wheel, Path(folder)), FIRST_TUTORIAL)
    except (NotReleasable, subprocess.CalledProcessError) as error:
        sys.exit(f"not released: {error}\n`git reset --hard` takes back the changes of this script")
    print(
        f"\n{wheel.name} is built, and the first tutorial runs with the wheel alone. Look at the changes, then type:\n"
        f"    git add -A && git commit -m 'Release {version}'\n"
        f"    git tag -a v{version} -m 'envgraph {version}'\n"
        f"    git push --follow-tags\n"
        f"    {os.path.relpath(sys.executable, ROOT)} -m twine upload dist/*"
    )


def check_version(version: str) -> None:
    """Raise an error unless a version has three numbers and is later than the present one."""
    if not re.fullmatch(r"\d+\.\d+\.\d+", version):
        raise NotReleasable(f"the version is {version!r}, but must be three numbers, such as 0.3.0")
    with (ROOT / "pyproject.toml").open("rb") as file:
        present = tomllib.load(file)["project"]["version"]
    if [int(part) for part in version.split(".")] <= [int(part) for part in present.split(".")]:
        raise NotReleasable(f"the version is {version}, but must be later than {present}")


def check_clone(version: str) -> None:
    """Raise an error if the clone has changes, if there is nothing to release, or if the version has a tag."""
    if output("git", "status", "--porcelain"):
        raise NotReleasable("the clone has changes: commit them, or use another clone")
    if output("git", "tag", "--list", f"v{version}"):
        raise NotReleasable(f"the tag v{version} exists already")
    if not [*(ROOT / "docs" / "changes").glob("*.*.md")]:
        raise NotReleasable("docs/changes has no entries: nothing has changed")


def set_version(root: Path, version: str, day: date) -> None:
    """Write a version into all files that contain it, and the day into the citation."""
    for name, line in VERSIONED.items():
        replace_line(root / name, line, version)
    replace_line(root / "CITATION.cff", r"^date-released: (.*)$", day.isoformat())


def replace_line(path: Path, line: str, value: str) -> None:
    """Replace the group of a regular expression that matches one line of a file."""
    text = path.read_text("utf-8")
    found = [*re.finditer(line, text, re.MULTILINE)]
    if len(found) != 1:
        raise NotReleasable(f"{path.name} has {len(found)} lines like `{line}`, but must have one")
    path.write_text(text[: found[0].start(1)] + value + text[found[0].end(1) :], "utf-8")


def build() -> Path:
    """Build the source distribution and the wheel into an empty `dist`, check both, and return the wheel."""
    shutil.rmtree(DIST, ignore_errors=True)
    run("build", "--no-isolation", "--outdir", DIST)
    files = sorted(DIST.iterdir())
    run("twine", "check", "--strict", *files)
    (wheel,) = (path for path in files if path.suffix == ".whl")
    check_has_page(wheel)
    return wheel


def check_has_page(wheel: Path) -> None:
    """Raise an error unless a wheel contains the page of `envgraph serve`."""
    with zipfile.ZipFile(wheel) as content:
        if "envgraph/page/built/index.html" not in content.namelist():
            raise NotReleasable("the wheel has no page for `envgraph serve`: run `make page` first")


def install(wheel: Path, folder: Path) -> Path:
    """Install a wheel with the pinned versions into a new environment, and return its Python."""
    python = folder / "fresh" / "bin" / "python"
    run("venv", folder / "fresh")
    pip = (python, "-m", "pip", "--disable-pip-version-check", "install", "--quiet")
    subprocess.run([*pip, "-c", ROOT / "constraints.txt", f"{wheel}[fast]", "pytest"], check=True, cwd=folder)
    return python


def run_page(python: Path, page: str) -> None:
    """Run the examples of a page of the documentation with the package that another Python has installed.

    The tests of pages run in a copy of the documentation, in which the package of this clone is not visible.
    """
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        shutil.copytree(ROOT / "docs", copy / "docs", ignore=shutil.ignore_patterns("*.py", "*.svg"))
        shutil.copy(ROOT / "README.md", copy)
        (copy / "tests" / "unit").mkdir(parents=True)
        shutil.copy(ROOT / "tests" / "unit" / "test_docs.py", copy / "tests" / "unit")
        test = "test_code_of_a_page_runs_and_prints_what_it_shows"
        options = ("-q", "-p", "no:cacheprovider", "--import-mode=importlib", "--rootdir", copy)
        subprocess.run(
            [python, "-m", "pytest", *options, f"tests/unit/test_docs.py::{test}[{page}]"],
            check=True,
            cwd=copy,
            env=without_python_settings(os.environ),
        )


def without_python_settings(environment: Mapping[str, str]) -> dict[str, str]:
    """Return environment variables without those by which a Python finds other packages."""
    return {name: value for name, value in environment.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}


def run(module: str, *arguments: str | Path) -> None:
    """Run a module of this Python in the clone; it must succeed."""
    print("$ python -m", module, *arguments, flush=True)
    subprocess.run([sys.executable, "-m", module, *arguments], check=True, cwd=ROOT)


def output(*command: str) -> str:
    """Return what a command prints in the clone."""
    return subprocess.run(command, check=True, cwd=ROOT, capture_output=True, text=True).stdout


if __name__ == "__main__":
    main()
