"""Make models of levels that other tools have written, and store them as a family."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

from envgraph.behaviour import unbound_names
from envgraph.code import dataclass
from envgraph.env import DrawGrid, GridScene, scene_of, scene_text
from envgraph.errors import MAX_ERRORS, TOLERANCE, Diagnostic, EvaluationError, LoadError, Note, Severity, Source, Span
from envgraph.files import report_progress
from envgraph.graph import Model, model_to_json
from envgraph.lang import Level, LevelCell, LevelTemplate, TextFiles, conformance_warnings, load_workspace, read_levels
from envgraph.search._run_store import Generation, Individual, RunStore, dump_json
from envgraph.search.domain._constraints import OutcomeReachable, constraints_of
from envgraph.search.domain._domain import Domain
from envgraph.search.families._member_family import Family, load_stored_family, order_measure
from envgraph.search.runs._ga4cl import GridVariant, parse_ga4cl
from envgraph.search.runs._generate import stored_settings_and_texts
from envgraph.search.runs._reward_schedule import reward_schedule

_MARK = re.compile(r"(.+): column ([0-9]{1,6}), row ([0-9]{1,6})")
_WORD = re.compile(r"[^\W\d]\w*")
_Token = tuple[tuple[int, int], str]
_TOKEN = re.compile(r"\(\S\)")
_ID = re.compile(r"^(\w+) \d+(?=[,:])")
"""The id of an object without a key or name in a line about its place."""


@dataclass(frozen=True, slots=True)
class LevelModel:
    """A level as a model of a domain: its name, text, first row, model (None if it has errors), and problems.

    The name is "boxes_2" for the second level of `boxes.xsb`. Problems are at places in the file of the level.
    """

    name: str
    text: str
    span: Span
    model: Model | None
    problems: Sequence[Diagnostic]


def level_models(sources: Iterable[tuple[str, Source]], domain: Domain, legend: Mapping[str, str]) -> list[LevelModel]:
    """Return a model for each level of some files: the domain's initial model with the rows of the level as its grid.

    Args:
        sources: the files, each after the name of its models.
        domain: the domain. Its initial model has a grid.
        legend: by letter, tile class or tile number in the files: the letter of the domain's model that it means.

    Raises:
        LoadError: files cannot be read or have no level, or the initial model has no grid.
        InvalidArgument: a value of `legend` is not a letter of the grid.
    """
    template = LevelTemplate.of(domain.model_text.span.source, domain.metamodel)
    problems, levels = list[Diagnostic](), dict[str, Level]()
    for stem, source in sources:
        try:
            found = read_levels(source, {**template.letters, **legend})
            for number, level in enumerate(found, 1):
                name = f"{stem}_{number}" if len(found) > 1 else stem
                while name in levels:  # such as the second of `hall.txt` and `hall.xsb`
                    name += "_"
                levels[name] = level
        except LoadError as error:
            problems.extend(error.diagnostics)
    if problems:
        raise LoadError(problems[:MAX_ERRORS])
    return _make_models(levels, template, domain, legend)


def _make_models(
    levels: Mapping[str, Level], template: LevelTemplate, domain: Domain, legend: Mapping[str, str]
) -> list[LevelModel]:
    """Return the models of levels by their names, read together with the files of the domain."""
    wrong, texts = list[Diagnostic](), dict[str, str]()
    tokens = _drawn_tokens(domain) if any(level.picture for level in levels.values()) else {}
    for name, level in levels.items():
        try:
            texts[name] = _model_text(level, name, template, legend, tokens)
        except LoadError as error:
            wrong.extend(error.diagnostics)
    if wrong:
        raise LoadError(wrong[:MAX_ERRORS])
    bundle = domain.workspace.bundle()
    beside = Path(bundle.roots[0]).parent
    names = {(beside / f"{name}.model").as_posix(): name for name in levels}
    files = TextFiles({**bundle.texts, **{path: texts[name] for path, name in names.items()}})
    workspace = load_workspace([*bundle.roots, *names], files=files)
    problems = {name: list[Diagnostic]() for name in levels}
    for one in workspace.diagnostics:
        if one.severity is Severity.ERROR and one.span is not None:
            problems[names[one.span.source.name]].append(one)
    models = {names[one.span.source.name]: one for one in reversed(workspace.models) if one.span.source.name in names}
    for name, text in models.items():
        if text.model is not None and domain.behaviour is not None:
            for one in unbound_names(domain.behaviour, text.model, text.spans):
                last = one.notes[-1].span if one.notes else text.span
                problems[name].append(replace(one, span=last, notes=one.notes[:-1]))
            if levels[name].picture and domain.behaviour.draw is not None and not problems[name]:
                scene = scene_of(text.model, domain.behaviour.draw, domain.behaviour.parameters)
                problems[name] += _check_drawing(levels[name], scene_text(scene))
        problems[name] += [one for one in conformance_warnings(text) if one.code == "conformance"]

    def at_level(span: Span | None) -> Span | None:
        name = None if span is None else names.get(span.source.name)
        return span if span is None or name is None else template.level_span(levels[name], texts[name], span)

    def move(one: Diagnostic) -> Diagnostic:
        notes = tuple(replace(note, span=at_level(note.span)) for note in one.notes)
        return replace(one, span=at_level(one.span), notes=notes)

    return [
        LevelModel(name, texts[name], level.span, models[name].model, [*map(move, problems[name])])
        for name, level in levels.items()
    ]


def _drawn_tokens(domain: Domain) -> dict[str, _Token]:
    """Return the place of each token in the picture of the domain's model, and the letter of its cell, by its name."""
    model, draw, spans = domain.initial(), domain.behaviour and domain.behaviour.draw, domain.model_text.spans
    if domain.behaviour is None or not isinstance(draw, DrawGrid):
        return {}
    scene = scene_of(model, draw, domain.behaviour.parameters)
    assert isinstance(scene, GridScene)
    below = {(cell[draw.column], cell[draw.row]): spans[cell.id].text for cell in model.nodes(draw.cls)}
    tokens = [mark for mark in scene.marks if mark.kind.split(",")[0] not in scene.kinds and mark.place in below]
    return {mark.name.split(",")[0]: (mark.place, below[mark.place]) for mark in tokens}


def _model_text(
    level: Level, name: str, template: LevelTemplate, legend: Mapping[str, str], tokens: Mapping[str, _Token]
) -> str:
    """Return the text of the model of a level.

    In a picture, the cell below a mark gets the letter whose entry in the legend has all words of the mark's name, else
    the letter below this token in the domain's model. References to cells of tokens (`cell[1, 2]`) are replaced.
    """
    lines = [span.text for span in level.picture]
    marks = [(mark[1], int(mark[2]), int(mark[3])) for line in lines if (mark := _MARK.fullmatch(line))]
    if lines and not marks and len(tokens) == 1:
        found = ((mark.start() // 3, row) for row, line in enumerate(lines) for mark in _TOKEN.finditer(line))
        marks = [(name, *place) for name, place in zip(tokens, found, strict=False)]
    rows, moved = [[*row] for row in level.rows], dict[str, str]()
    for said, x, y in reversed(marks):  # marks of cells are the first
        words, (place, below) = {*_WORD.findall(said)}, tokens.get(said.split(",")[0], ((-1, -1), ""))
        fitting = [letter for letter, known in template.letters.items() if words <= {*known}]
        if (letter := min(fitting, key=lambda one: len(template.letters[one]), default=below)) and y < len(rows):
            rows[y][x : x + 1] = [replace(cell, names=(letter,)) for cell in rows[y][x : x + 1]]
        moved["[{}, {}]".format(*place)] = f"[{x}, {y}]"
    text = template.model_text(replace(level, rows=tuple(map(tuple, rows))), name, legend)
    return re.sub(r"(?<=\w)\[\d+, \d+\]", lambda found: moved.get(found[0], found[0]), text)


def _check_drawing(level: Level, drawn: str) -> Iterator[Diagnostic]:
    """Yield an error at the first line of a picture that differs from the picture of the model read from it."""
    for span, line in zip_longest(level.picture, drawn.split("\n")):
        if span is None or line is None or _ID.sub(r"\1", span.text) != _ID.sub(r"\1", line):
            message = f"this line cannot be read: the model would be drawn with `{line or ''}`"
            hint = "of objects outside of the grid only cells are read, for references such as `at = cell[1, 1]`"
            yield Diagnostic("bad-picture", message, span or level.picture[-1], hint)
            return


def import_levels(
    levels: Sequence[LevelModel],
    domain: Domain,
    store_path: Path,
    *,
    overwrite: bool = False,
    constrained: bool = True,
) -> tuple[Family, tuple[Diagnostic, ...]]:
    """Store levels as a family, in the order of the measure that orders the domain's families.

    The `individual` of a member is the place of its level, from 0.

    Args:
        levels: the levels as models of the domain.
        domain: the domain.
        store_path: path of the new run store.
        overwrite: True if an existing run is to be replaced.
        constrained: True if each level has to satisfy the constraints of the domain.

    Returns:
        The family, and a warning for each level that is left out: it violates a constraint, or equals another one.

    Raises:
        LoadError: all levels are left out; it contains the reasons.
        InvalidArgument: the store exists already.
    """
    first, left_out, reasons = domain.problem(domain.engine()), list[Diagnostic](), Counter[str]()
    plans = [one.plan for one in first.constraints if isinstance(one, OutcomeReachable)]  # and their compiled programs
    found: dict[str, Individual] = {}
    with report_progress() as tell:
        for place, level in enumerate(levels):
            tell(f"levels: {place:,} of {len(levels):,}")
            wrong = [one for one in level.problems if one.severity is Severity.ERROR]
            notes, state = tuple[Note, ...](), ""
            if wrong or level.model is None:
                result: Mapping[str, float] | str = wrong[0].message
            elif (state := f"{level.model.state_hash():016x}") in found:
                notes = (Note("the other level is here", levels[found[state].id].span),)
                result = "it equals another one"
            else:
                engine = domain.engine(level.model)
                rules = constraints_of(domain, engine, [*first.measures.values(), *plans]) if constrained else ()
                try:
                    result = replace(first, engine=engine, constraints=rules).measures_or_rejection()
                except EvaluationError as error:  # such as too many states for a table
                    result = error.message
            if isinstance(result, str) or level.model is None:
                message, hint = f"the level is left out: {result}", wrong[0].hint if wrong else None
                left_out.append(Diagnostic("left-out", message, level.span, hint, Severity.WARNING, notes))
                reasons[str(result)] += 1
            else:
                model = dump_json(model_to_json(level.model))
                found[state] = Individual(place, 0, place, None, (), result, state, model)
    if not found:
        raise LoadError([replace(one, severity=Severity.ERROR) for one in left_out[:MAX_ERRORS]])
    score = first.diversity.score([one.measures[first.diversity_measure_name] for one in found.values()])
    ids = tuple(one.id for one in sorted(found.values(), key=lambda one: one.measures[order_measure(domain)]))
    settings, texts = stored_settings_and_texts(domain)
    settings["imported"] = levels[0].span.source.name
    with RunStore.create(store_path, settings, texts, overwrite=overwrite) as store:
        store.write_generation(Generation(0, ids, score, len(ids), dict(sorted(reasons.items()))), found.values())
        return load_stored_family(store, domain), tuple(left_out)


def import_ga4cl(
    source: Source,
    location: str,
    store_path: Path,
    *,
    overwrite: bool = False,
    overrides: Sequence[str] = (),
) -> tuple[Family, tuple[Diagnostic, ...]]:
    """Read a family in the ga4cl format into a run store, and return the family and warnings.

    Each map is a level whose letters are the glyphs of classes. Constraints are not checked. There are warnings if a
    published complexity differs by more than 1e-9 from the measure that orders the curriculum, and if rewards differ
    from those of the behaviour.

    Args:
        source: text of the file.
        location: the domain: a family file, its directory, or a bundled domain.
        store_path: path of the new run store.
        overwrite: True if an existing run is to be replaced.
        overrides: settings that replace those of the family file.

    Raises:
        LoadError: the file or the domain's files have errors; it contains all of them.
        InvalidArgument: the store exists already.
    """
    domain, variants = Domain.load(location, None, overrides), parse_ga4cl(source)
    levels = {f"map_{n}": _variant_level(one) for n, one in enumerate(variants, 1)}
    found = _make_models(levels, LevelTemplate.of(domain.model_text.span.source, domain.metamodel), domain, {})
    family, left_out = import_levels(found, domain, store_path, overwrite=overwrite, constrained=False)
    return family, (*left_out, *_import_warnings(family, variants))


def _variant_level(variant: GridVariant) -> Level:
    rows = [
        [LevelCell((letter,), span.source.span_between(at, at + 1)) for at, letter in enumerate(row, span.start + 1)]
        for row, span in zip(variant.rows, variant.row_spans, strict=True)
    ]
    return Level(variant.name, variant.row_spans[0], tuple(map(tuple, rows)))


def _import_warnings(family: Family, variants: Sequence[GridVariant]) -> Iterator[Diagnostic]:
    order = family.domain.spec.curriculum.order or family.domain.spec.diversity.options["of"]
    schedule = reward_schedule(family) if any(variant.rewards for variant in variants) else ()
    for member in sorted(family.members, key=lambda one: one.individual or 0):
        variant = variants[member.individual or 0]
        span = variant.row_spans[0] if variant.row_spans else None
        measured = member.measures[str(order)]
        if variant.complexity is not None and abs(variant.complexity - measured) > TOLERANCE:
            message = f"`{variant.name}`: `{order}` is {measured!r}, but the file has {variant.complexity!r}"
            hint = "check the measure: the computed value is used, and the file may come from another measure"
            yield Diagnostic("different-measure", message, span, hint, Severity.WARNING)
        if variant.rewards and variant.rewards != schedule:
            said = list(variant.rewards)
            message = f"`{variant.name}`: the behaviour's rewards are {list(schedule)}, but the file has {said}"
            hint = "change the behaviour to use other rewards: those of the file are ignored"
            yield Diagnostic("different-rewards", message, span, hint, Severity.WARNING)
