"""The command `envgraph show`: print families, models and metamodels."""

from __future__ import annotations

from pathlib import Path

from envgraph.cli._inputs import DEFINITIONS, METAMODELS, MODELS, Inputs
from envgraph.cli._output import output_to_file, print_json, print_lines, print_table
from envgraph.errors import InvalidArgument
from envgraph.graph import Model, model_to_json
from envgraph.lang import DiskFiles, file_format
from envgraph.metamodel import Attribute, Class, Metamodel


def show(
    run: str,
    lineage: str | None,
    rejections: bool,
    classes: str | None,
    directory: Path,
    inputs: Inputs,
    format: str,
    output: Path | None,
) -> None:
    """Print a family, a model or a metamodel, or write it into a file; `classes` are those of the objects to draw.

    Raises:
        InvalidArgument: the file is something else, or cannot be printed in that format.
    """
    if output is not None and format == "text" and output.suffix in (".json", ".dot", ".svg"):
        format = output.suffix[1:]
    shown = file_format(DiskFiles(), run)
    if classes is not None and not (shown in MODELS and format in ("dot", "svg")):
        raise InvalidArgument("`--classes` is allowed only for a picture of a model: add `--format svg`")
    if shown in (*MODELS, *METAMODELS):
        with output_to_file(output, format):
            _show_file(run, inputs, format, classes)
        return
    if shown in DEFINITIONS:
        raise InvalidArgument(f"`{run}` is not a run, model or metamodel; use `envgraph check {run}` to check it")
    from envgraph.cli._family_actions import (  # models do not need it
        show_family,
        show_lineage,
        show_rejections,
    )

    if format in ("dot", "svg"):
        raise InvalidArgument(
            f"`show` draws only models and metamodels; use `envgraph export {run} --format svg` for a run"
        )
    with output_to_file(output, format):
        if lineage is not None:
            show_lineage(run, directory, lineage)
        elif rejections:
            show_rejections(run, directory)
        else:
            show_family(run, directory, inputs.variant)


def _show_file(path: str, inputs: Inputs, format: str, classes: str | None) -> None:
    """Print a model or a metamodel: as a table, as JSON, or as a picture."""
    if inputs.variant is not None:
        raise InvalidArgument("`--variant` is allowed only with a run or family")
    of_model = file_format(DiskFiles(), path) in MODELS
    workspace = inputs.load(path, own=not of_model)
    shown = workspace.model() if of_model else workspace.metamodel
    if shown is None:
        raise InvalidArgument(f"there is no metamodel in {path}")
    if format in ("dot", "svg"):
        drawn = shown.picture(classes=_split_names(classes)) if isinstance(shown, Model) else shown.picture()
        print_lines(drawn.to_dot().removesuffix("\n") if format == "dot" else drawn.to_svg())
    elif isinstance(shown, Metamodel):
        if format == "json":
            raise InvalidArgument("a metamodel cannot be printed as JSON: choose text, dot or svg")
        print_table(shown.name, ("class", "extends", "features"), [_class_row(cls) for cls in shown.class_list])
    elif not print_json(lambda: model_to_json(shown)):
        _print_model(shown)


def _split_names(names: str | None) -> list[str] | None:
    """Return the names of a list with commas, or None for None."""
    return None if names is None else [name.strip() for name in names.split(",")]


def _class_row(cls: Class) -> tuple[str, ...]:
    features = ", ".join(
        one.name if isinstance(one, Attribute) and not one.many else f"{one.name} [{one.multiplicity}]"
        for one in cls.features
    )
    return f"{'abstract ' if cls.abstract else ''}{cls.name}", ", ".join(cls.supertypes), features


def _print_model(model: Model) -> None:
    counts = {cls.name: len(model.graph.exact_extent(cls.name)) for cls in model.metamodel.class_list}
    rows = [(name, str(count)) for name, count in counts.items() if count]
    print_table(
        f"{model.name}: {len(model)} objects of {model.metamodel.name}",
        ("class", "objects"),
        rows,
        right=(1,),
    )
