"""`envgraph convert`."""

from __future__ import annotations

import json
from pathlib import Path

from envgraph.cli._inputs import A_MODEL, MODELS, Inputs, take
from envgraph.cli._output import print_line
from envgraph.errors import InvalidArgument, did_you_mean
from envgraph.files import replace_file
from envgraph.graph import Model, model_to_json, model_to_xmi
from envgraph.metamodel import metamodel_to_ecore

_FORMATS = (".ecore", ".xmi", ".json")


def convert_file(file: str, output: Path, inputs: Inputs) -> None:
    """Write the metamodel or model of a file in the format that the name of another one asks for."""
    if output.suffix not in _FORMATS:
        hint = did_you_mean(output.suffix, _FORMATS) or f"there are {', '.join(_FORMATS)}"
        raise InvalidArgument(f"`{output}` is of no format that can be written; {hint}")
    if output.suffix == ".ecore":
        text = _metamodel(file, inputs)
    else:
        text = model_text(_model(file, inputs), output)
    replace_file(output, text)
    print_line(f"wrote {output}")


def _model(file: str, inputs: Inputs) -> Model:
    """The model of a file, or of a family."""
    take(file, (*MODELS, "toml"), A_MODEL)
    workspace = inputs.load(file)
    if not workspace.models:
        raise InvalidArgument(f"`{file}` has no model")
    return workspace.model()


def model_text(model: Model, output: Path) -> str:
    """A model in the format that the name of a file asks for."""
    if output.suffix == ".xmi":
        return model_to_xmi(model)
    return json.dumps(model_to_json(model), ensure_ascii=False, indent=1) + "\n"


def _metamodel(file: str, inputs: Inputs) -> str:
    workspace = inputs.load(file, own=True)
    if workspace.metamodel is None:
        raise InvalidArgument(f"`{file}` is no metamodel, and imports none")
    return metamodel_to_ecore(workspace.metamodel)
