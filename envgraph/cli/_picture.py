"""`envgraph show` for models and metamodels."""

from __future__ import annotations

from envgraph.cli._inputs import MODELS, Inputs
from envgraph.cli._output import ShowFormat, print_json, print_lines, print_table
from envgraph.errors import InvalidArgument
from envgraph.graph import Model, model_to_json
from envgraph.lang import DiskFiles, file_format
from envgraph.metamodel import Attribute, Class, Metamodel


def show_file(path: str, variant: str | None, inputs: Inputs, format: ShowFormat) -> None:
    """Print a model or a metamodel: as a table, as JSON, or as a picture."""
    if variant is not None:
        raise InvalidArgument("`--variant` chooses from a run; a file has no variants")
    of_model = file_format(DiskFiles(), path) in MODELS
    workspace = inputs.load(path, own=not of_model)
    shown = workspace.model() if of_model else workspace.metamodel
    if shown is None:
        raise InvalidArgument(f"there is no metamodel in {path}")
    if format is ShowFormat.DOT:
        print_lines(shown.to_dot().removesuffix("\n"))
    elif format is ShowFormat.SVG:
        print_lines(shown.to_svg())
    elif isinstance(shown, Metamodel):
        if format is ShowFormat.JSON:
            raise InvalidArgument("a metamodel has no form in JSON; there are text, dot and svg")
        print_table(
            shown.name, ("class", "extends", "features"), [_class_row(cls) for cls in shown.class_list]
        )
    elif format is ShowFormat.JSON:
        print_json(model_to_json(shown))
    else:
        _print_model(shown)


def _class_row(cls: Class) -> tuple[str, ...]:
    features = ", ".join(
        one.name if isinstance(one, Attribute) and not one.many else f"{one.name} [{one.multiplicity}]"
        for one in cls.features
    )
    return f"{'abstract ' if cls.abstract else ''}{cls.name}", ", ".join(cls.supertypes), features


def _print_model(model: Model) -> None:
    counts = {cls.name: len(model.exact_extent(cls.name)) for cls in model.metamodel.class_list}
    rows = [(name, str(count)) for name, count in counts.items() if count]
    print_table(
        f"{model.name}: {len(model)} objects of {model.metamodel.name}",
        ("class", "objects"),
        rows,
        right=(1,),
    )
