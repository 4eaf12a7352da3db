"""Files with random mistakes in all readers: errors with a place, soon, in little memory; never another exception."""

from __future__ import annotations

import json
import re
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random

from envgraph.errors import Diagnostic, EnvgraphError
from envgraph.graph import model_to_json, model_to_xmi
from envgraph.lang import DiskFiles, bundled_domain, load_workspace, parse_trace, read_source
from envgraph.metamodel import metamodel_to_ecore
from envgraph.rewrite import trace_to_text
from envgraph.search import generate, open_family, write_family
from tests.reading import load_family

SECONDS = 10
"""For one file, which has at most some ten thousand characters."""
ERRORS = 11_000
"""An error for each of the files that may be imported, and some more."""

_TOKEN = re.compile(r'"""|"[^"\n]*"|\w+|\s+|[^\w\s]')
_SIGNS = '{ } ( ) [ ] < > " \' """ /* */ // # ; , = : :: .. -> - @ \\ ^ & % $ ! ? | <a/> &amp; &#0; <![CDATA[ ]]> é 🔥'
_WORDS = """null true NaN 1e999 -1 9999999999999999999999 0x 1.5 class pattern rule lhs rhs modify find neg count or
    unit derive alap model import package enum refers contains container none"""
_PIECES = (*_SIGNS.split(), *_WORDS.split(), "\x00", "\x1b[2J", "\ufeff", "\ud800", "\r")

Reader = Callable[[Path], None]


def prepare() -> None:
    """Read the corpus once, for all cases."""
    corpus()


def campaign(random: Random) -> str:
    """Change one file of the corpus, and read it with all it needs."""
    texts, readers = corpus()
    name = random.choice(sorted(readers))
    with tempfile.TemporaryDirectory() as directory:
        for other, text in texts.items():
            path = Path(directory, other)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        same = [other for other in texts if other.endswith(Path(name).suffix)]
        changed = _changed(random, texts[name], texts[random.choice(same)])
        path = Path(directory, name)
        path.write_bytes(changed.encode("utf-8", "surrogatepass"))
        read(path, readers[name])
    return path.suffix[1:]


def read(path: Path, reader: Reader) -> None:
    """Read a file; what is wrong with it is said well."""
    started = time.process_time()
    try:
        reader(path)
    except EnvgraphError as error:
        diagnostics: tuple[Diagnostic, ...] = getattr(error, "diagnostics", ())
        assert len(diagnostics) <= ERRORS, f"{len(diagnostics)} errors"
        for one in diagnostics:
            assert one.span is None or 0 <= one.span.start <= one.span.end <= len(one.span.source.text)
            assert str(one).isprintable() or "\n" in str(one)
        assert str(error).strip(), "an error without a text"
    spent = time.process_time() - started
    assert spent < SECONDS, f"{spent:.1f} s"


def _changed(random: Random, text: str, other: str) -> str:
    for _ in range(random.choice([1, 1, 2, 3, 6])):
        if random.random() < 0.3:  # letters
            start = random.randrange(len(text) + 1)
            end = min(len(text), start + random.choice([0, 0, 1, 1, 2, 10, 200]))
            text = text[:start] + random.choice([*_PIECES, text[end : end + 20]]) + text[end:]
            continue
        parts = _TOKEN.findall(text) or [""]
        at = random.randrange(len(parts))
        to = min(len(parts), at + random.choice([1, 1, 1, 3, 10, 50]))
        kind = random.randrange(7)
        if kind == 0:
            del parts[at:to]
        elif kind == 1:
            parts[at:at] = parts[at:to]
        elif kind == 2:
            place = random.randrange(len(parts))
            parts[at], parts[place] = parts[place], parts[at]
        elif kind == 3:
            parts[at] = random.choice(_PIECES)
        elif kind == 4:  # a part of another file of the language
            others = _TOKEN.findall(other) or [""]
            place = random.randrange(len(others))
            parts[at:at] = others[place : place + random.choice([1, 5, 30])]
        elif kind == 5:  # nested deeply
            depth = random.choice([3, 50, 3000])
            before, after = random.choice([("(", ")"), ("{", "}"), ("[", "]"), ("-", ""), ("<a>", "</a>"), ("!", "")])
            parts[at] = before * depth + parts[at] + after * depth
        else:  # repeated often
            parts[at:to] = parts[at:to] * random.choice([2, 20, 500])
        text = "".join(parts)[:400_000]
    return text


@cache
def corpus() -> tuple[dict[str, str], dict[str, Reader]]:
    """Texts by name, and how those that are changed are read."""
    texts: dict[str, str] = {}
    readers: dict[str, Reader] = {}

    def check(path: Path) -> None:
        load_workspace([str(path)]).raise_errors()

    def family(path: Path) -> None:
        load_family(str(path))

    for domain in ("burning_forest", "keydoor", "network", "warehouse", "railway"):
        for path in sorted(filter(Path.is_file, bundled_domain(domain).iterdir())):
            name = f"{domain}/{path.name}"
            texts[name] = path.read_text(encoding="utf-8")
            readers[name] = family if path.suffix == ".toml" else check
    workspace = load_workspace([str(bundled_domain("keydoor"))])
    model = workspace.model()
    assert workspace.metamodel is not None
    texts["keydoor.json"] = json.dumps(model_to_json(model), indent=1)
    texts["keydoor.xmi"] = model_to_xmi(model)
    texts["keydoor.ecore"] = metamodel_to_ecore(workspace.metamodel)
    for name in ("keydoor.json", "keydoor.xmi"):
        readers[name] = _model
    readers["keydoor.ecore"] = check
    engine = workspace.engine()
    with engine.recording() as trace:
        for rule in sorted(engine.rules)[:5]:
            engine.apply(rule)
    texts["keydoor.trace"] = trace_to_text(engine, trace)
    readers["keydoor.trace"] = _trace
    with tempfile.TemporaryDirectory() as directory:
        found = generate("burning_forest/paper.toml", Path(directory, "run.sqlite"), generations=0, population=2)
    texts["family.json"] = write_family(found)
    readers["family.json"] = _family
    return texts, readers


def _model(path: Path) -> None:
    load_workspace([str(path.with_suffix(".ecore")), str(path)]).model()


def _trace(path: Path) -> None:
    engine = load_workspace([str(path.parent / "keydoor")]).engine()
    engine.replay(parse_trace(read_source(DiskFiles(), str(path)), engine))


def _family(path: Path) -> None:
    family = open_family(path)
    family.diversity()
    for member in family.members:
        family.scene(member)
