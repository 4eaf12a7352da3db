"""Write what the playground needs of envgraph: its Python files, the bundled domains, and a page that lists them.

python editors/playground/pack.py FOLDER
"""

from __future__ import annotations

import gzip
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from html import escape
from importlib.metadata import files
from pathlib import Path
from tempfile import TemporaryDirectory

import lark

from envgraph.lang import LANGUAGES, bundled_domains, data_path

ROOT = Path(__file__).resolve().parents[2]
UNUSABLE = ("cli", "env/compiled", "notebook", "report", "sb3.py")
"""The parts of envgraph that a page never imports."""
SUFFIXES = (*LANGUAGES, "toml")
LICENSES = """Pyodide 314.0.7, MPL-2.0: source and license at https://github.com/pyodide/pyodide/tree/314.0.7
It contains Python, PSF-2.0: https://docs.python.org/3.14/license.html

---

Lark, MIT

"""
FIRST = "maze"
"""The domain that `envgraph new` writes."""


def python_files() -> Iterator[tuple[str, str]]:
    """Yield the path and text of each file that Python imports or reads in the browser."""
    package = ROOT / "envgraph"
    for path in sorted(package.rglob("*.py")):
        if not path.relative_to(package).as_posix().startswith(UNUSABLE):
            yield path.relative_to(ROOT).as_posix(), path.read_text("utf-8")
    for path in sorted(data_path("grammars").glob("*.lark")):
        yield f"envgraph/_data/grammars/{path.name}", path.read_text("utf-8")
    parser = Path(lark.__file__).parent
    for path in sorted([*parser.glob("*.py"), *parser.glob("parsers/*.py"), *parser.glob("grammars/*.lark")]):
        yield f"lark/{path.relative_to(parser).as_posix()}", path.read_text("utf-8")


def domain_texts(folder: Path) -> list[dict[str, str]]:
    """Return the names and texts of the files of a domain, as `page/open` takes them."""
    paths = sorted(path for path in folder.rglob("*") if path.suffix[1:] in SUFFIXES)
    return [{"name": path.relative_to(folder).as_posix(), "text": path.read_text("utf-8")} for path in paths]


def write_list(folder: Path, domains: dict[str, list[dict[str, str]]]) -> None:
    """Write the first page, which lists the domains in the order of the gallery; its pictures contain their titles."""
    gallery = (ROOT / "docs/gallery/index.md").read_text("utf-8")
    told = {
        FIRST: "Maze: the first example",
        **{name: text for text, name in re.findall(r"!\[(.+?)\].*\((\w+)\.md\)", gallery)},
    }
    items = []
    for name in sorted(domains, key=[*told].index):
        picture = "docs/tutorials/maze-world.svg" if name == FIRST else f"docs/gallery/pictures/{name}.svg"
        shutil.copyfile(ROOT / picture, folder / "domains" / f"{name}.svg")
        text = escape(told[name])
        shown = (
            f'<img src="domains/{name}.svg" alt="{text}">'
            if name != FIRST
            else f'<img src="domains/{name}.svg" alt="">{text}'
        )
        items.append(f'      <li><a href="page.html?domain={name}">{shown}</a></li>')
    page = Path(__file__).with_name("start.html").read_text("utf-8")
    (folder / "index.html").write_text(page.replace("DOMAINS", "\n".join(items)), "utf-8")


def main(folder: Path) -> None:
    """Write the files into a folder, which is created."""
    (folder / "domains").mkdir(parents=True, exist_ok=True)
    texts = json.dumps(dict(python_files()))
    (terms,) = (one for one in files("lark") or () if one.name == "LICENSE")
    (folder / "licenses.txt").write_text(f"{LICENSES}{terms.read_text()}\n---\n\n", "utf-8")
    (folder / "envgraph.bin").write_bytes(gzip.compress(texts.encode(), mtime=0))
    domains = {name: domain_texts(data_path("rules", name)) for name in bundled_domains()}
    with TemporaryDirectory() as place:
        subprocess.run(
            [sys.executable, "-m", "envgraph", "new", FIRST], cwd=place, check=True, stdout=subprocess.DEVNULL
        )
        domains[FIRST] = domain_texts(Path(place, FIRST))
    for name, listed in domains.items():
        (folder / "domains" / f"{name}.json").write_text(json.dumps({"files": listed}), "utf-8")
    write_list(folder, domains)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
