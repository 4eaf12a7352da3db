"""Random slips of the keyboard in real files: whatever is wrong is said with a position, soon, and nothing else."""

from __future__ import annotations

import re
from pathlib import PurePosixPath
from time import process_time

from hypothesis import given, settings, strategies as st

from envgraph.errors import Diagnostic, InvalidArgument, LoadError
from envgraph.lang import Bundle, TextFiles, bundled_domain, load_workspace
from envgraph.search import Domain
from tests.profile import examples
from tests.reading import load_family

DIRECTORY = bundled_domain("burning_forest")
TEXTS = {path.name: path.read_text(encoding="utf-8") for path in sorted(DIRECTORY.glob("*.*"))}
LANGUAGES = [name for name in TEXTS if PurePosixPath(name).suffix != ".toml"]
FAMILY = "paper.toml"
SECONDS = 5.0

_LINE = re.compile(r"[^\n]*\n?")
_TOKEN = re.compile(r'"""|"[^"\n]*"|\w+|\s+|[^\w\s]')
Slip = tuple[bool, str, float, float]


def slipped(text: str, slips: list[Slip]) -> str:
    """Each slip deletes, doubles or swaps tokens or lines, at places that are shares of the text."""
    for lines, kind, first, second in slips:
        parts = [part for part in (_LINE if lines else _TOKEN).findall(text) if part]
        if not parts:
            break
        one, other = int(first * (len(parts) - 1)), int(second * (len(parts) - 1))
        match kind:
            case "delete":
                del parts[one]
            case "double":
                parts.insert(other, parts[one])
            case _:
                parts[one], parts[other] = parts[other], parts[one]
        text = "".join(parts)
    return text


SHARE = st.floats(0, 1)
SLIPS = st.lists(
    st.tuples(st.booleans(), st.sampled_from(["delete", "double", "swap"]), SHARE, SHARE),
    min_size=1,
    max_size=4,
)


def assert_placed(diagnostics: tuple[Diagnostic, ...]) -> None:
    for one in diagnostics:
        assert one.span is not None, one
        assert 0 <= one.span.start <= one.span.end <= len(one.span.source.text)
        assert str(one).startswith(f"{one.span.source.name}:{one.span.line}:{one.span.column}: ")
    assert len(set(map(str, diagnostics))) == len(diagnostics)


@given(st.sampled_from(LANGUAGES), SLIPS)
def test_random_typos_in_a_file_are_reported_with_positions(name: str, slips: list[Slip]) -> None:
    texts = TEXTS | {name: slipped(TEXTS[name], slips)}
    started = process_time()
    assert_placed(load_workspace([name], files=TextFiles(texts)).diagnostics)
    assert process_time() - started < SECONDS


@given(SLIPS)
def test_random_typos_in_a_family_file_are_reported_with_positions(slips: list[Slip]) -> None:
    files = TextFiles(TEXTS | {FAMILY: slipped(TEXTS[FAMILY], slips)})
    started = process_time()
    try:
        load_family(FAMILY, files)
    except LoadError as error:
        assert error.diagnostics
        assert_placed(error.diagnostics)
    assert_placed(load_workspace([FAMILY], files=files).diagnostics)
    assert process_time() - started < SECONDS


@settings(max_examples=examples(30))
@given(st.sampled_from([*TEXTS]), SLIPS)
def test_domain_with_random_typos_is_loaded_or_refused_with_a_reason(name: str, slips: list[Slip]) -> None:
    texts = TEXTS | {name: slipped(TEXTS[name], slips)}
    started = process_time()
    try:
        Domain.from_bundle(Bundle((FAMILY,), texts))
    except LoadError as error:
        assert error.diagnostics
        assert_placed(error.diagnostics)
    except InvalidArgument as error:
        assert str(error)
    assert process_time() - started < SECONDS


@given(st.sampled_from([*TEXTS]), st.floats(0, 1))
def test_a_text_that_ends_too_early_is_reported_with_positions(name: str, share: float) -> None:
    texts = TEXTS | {name: TEXTS[name][: int(share * len(TEXTS[name]))]}
    assert_placed(load_workspace([FAMILY], files=TextFiles(texts)).diagnostics)
