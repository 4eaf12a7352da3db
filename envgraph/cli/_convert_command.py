"""The command `envgraph convert`: write metamodels and models in other formats."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

from envgraph.cli._inputs import MODEL_PHRASE, MODELS, Inputs, check_file_format
from envgraph.cli._output import print_line
from envgraph.errors import InvalidArgument, check_known
from envgraph.files import replace_file
from envgraph.graph import Model, model_to_json, model_to_xmi
from envgraph.lang import model_to_text
from envgraph.metamodel import metamodel_to_ecore

_FORMATS = (".ecore", ".model", ".xmi", ".json")
_MODEL_FORMATS = _FORMATS[1:]
"""The formats of models."""
_LOSS_CODES = {".ecore": ("left-out", "generic-type"), ".xmi": ("values-left-out",)}
"""The codes of warnings about lost content, by output format; `_LOST_VALUES` holds those of all other formats."""
_VALUE_LOSS_CODES = ("values-left-out", "values-rounded")


def convert_file(file: str, output: Path, inputs: Inputs, *, lossy: bool) -> None:
    """Write the metamodel or model of a file in the format of the output's suffix.

    Raises:
        InvalidArgument: the format is unknown, or the format cannot hold all of the content and `lossy` is False.
    """
    if output.suffix == ".metamodel":
        raise InvalidArgument("`.metamodel` files are written by hand; a metamodel is converted to `.ecore`")
    check_format(output, _FORMATS)
    whole = output.suffix == ".ecore"
    if not whole:
        check_file_format(file, (*MODELS, "toml"), MODEL_PHRASE)
    workspace = inputs.load(file, own=whole)
    if not (workspace.metamodel if whole else workspace.models):
        lacks = "is not a metamodel and imports none" if whole else "has no model"
        raise InvalidArgument(f"`{file}` {lacks}")
    codes = _LOSS_CODES.get(output.suffix, _VALUE_LOSS_CODES)
    losses = sum(one.code in codes for one in workspace.diagnostics)
    if losses and not lossy:
        said = "the warning says" if losses == 1 else f"{losses} warnings say"
        raise InvalidArgument(f"{said} what `{file}` would lose; add `--lossy` to write the rest")
    if whole and workspace.metamodel:
        replace_file(output, metamodel_to_ecore(workspace.metamodel))
    else:
        replace_file(output, model_text(workspace.model(), output))
    print_line(f"wrote {output}")


def check_format(output: Path, formats: Sequence[str] = _MODEL_FORMATS) -> None:
    """Raise InvalidArgument if the suffix of a file is not one of `formats`, by default the formats of models."""
    check_known(output.suffix, formats, f"the format of `{output}` cannot be written")


def model_text(model: Model, output: Path) -> str:
    """Return a model as text in the format of the file's suffix: `.xmi`, `.model`, or JSON for any other suffix."""
    if output.suffix == ".xmi":
        return model_to_xmi(model, output.parent)
    if output.suffix == ".model":
        files = sorted({cls.span.source.name for cls in model.metamodel.classes.values() if cls.span})
        return model_to_text(model, [Path(os.path.relpath(file, output.parent)).as_posix() for file in files])
    return json.dumps(model_to_json(model), ensure_ascii=False, indent=1) + "\n"
