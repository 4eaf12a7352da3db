"""Files in other encodings, with imports in circles, with links that lead elsewhere: read, or refused with a place."""

from __future__ import annotations

import tempfile
from pathlib import Path
from random import Random

from envgraph.lang import load_workspace
from tests.campaigns.readers import corpus, read
from tests.reading import load_family

_KINDS = ("utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1", "cr", "crlf", "surrogate", "nul", "bytes")
_IMPORTS = ("cycle", "wide", "chain", "link", "broken link", "itself", "missing")


def prepare() -> None:
    """Read the corpus once, for all cases."""
    corpus()


def campaign(random: Random) -> str:
    """One file in an unusual encoding, or some that import each other."""
    with tempfile.TemporaryDirectory() as directory:
        if random.random() < 0.6:
            return _encoded(random, Path(directory))
        return _importing(random, Path(directory))


def _encoded(random: Random, directory: Path) -> str:
    texts, readers = corpus()
    name = random.choice(sorted(readers))
    kind = random.choice(_KINDS)
    for other, text in texts.items():
        path = directory / other
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    text, at = texts[name], random.randrange(len(texts[name]))
    path = directory / name
    if kind in ("cr", "crlf"):
        path.write_bytes(text.replace("\n", "\r" if kind == "cr" else "\r\n").encode())
    elif kind == "surrogate":
        path.write_bytes((text[:at] + random.choice("\ud800\udfff") + text[at:]).encode("utf-8", "surrogatepass"))
    elif kind == "nul":
        path.write_text(text[:at] + "\0" * random.choice([1, 1000]) + text[at:], encoding="utf-8")
    elif kind == "bytes":
        path.write_bytes(text[:at].encode() + random.randbytes(random.choice([1, 5, 100])) + text[at:].encode())
    else:
        path.write_bytes((text[:at] + "é" + text[at:]).encode(kind, "replace"))
    read(path, readers[name])
    return kind


def _importing(random: Random, directory: Path) -> str:
    kind = random.choice(_IMPORTS)
    root = directory / "root.query"
    count = random.choice([2, 10, 300])
    if kind == "cycle":
        for number in range(count):
            (directory / f"f{number}.query").write_text(f'import "f{(number + 1) % count}.query"\n')
        root.write_text('import "f0.query"\n')
    elif kind == "chain":
        for number in range(count):
            (directory / f"f{number}.query").write_text(f'import "f{number + 1}.query"\n')
        root.write_text('import "f0.query"\n')
    elif kind == "wide":
        root.write_text("".join(f'import "f{number}.query"\n' for number in range(random.choice([100, 100_000]))))
    elif kind == "itself":
        root.write_text('import "root.query"\nimport "./../' + directory.name + '/root.query"\n')
    elif kind == "missing":
        root.write_text('import "nothing.query"\nimport ""\nimport "/"\nimport "a\0b"\n')
    else:
        outside = directory / "outside"
        outside.mkdir()
        inside = directory / "inside"
        inside.mkdir()
        for name, text in corpus()[0].items():
            if name.startswith("network/"):
                (outside / Path(name).name).write_text(text)
        for path in sorted(outside.iterdir()):
            (inside / path.name).symlink_to(path)
        if kind == "link":
            load_family(str(inside / "family.toml"))
            assert not load_workspace([str(path) for path in inside.iterdir() if path.suffix != ".toml"]).errors
            return kind
        (outside / "network.query").unlink()
        root = inside / "network.rules"
    read(root, lambda path: load_workspace([str(path)]).raise_errors())
    return kind
