"""`envgraph convert`."""

from __future__ import annotations

import json
from pathlib import Path

import envgraph.lang
from envgraph.cli._kinds import A_METAMODEL, A_MODEL, METAMODELS, MODELS, take
from envgraph.cli._output import print_line
from envgraph.errors import InvalidArgument, did_you_mean
from envgraph.files import replace_file
from envgraph.graph import Model, model_to_json, model_to_xmi
from envgraph.metamodel import metamodel_to_ecore

_FORMATS = (".ecore", ".xmi", ".json")


def convert_file(file: str, output: Path, metamodels: list[str] | None) -> None:
    """Write the metamodel or model of a file in the format that the name of another one asks for."""
    if output.suffix not in _FORMATS:
        hint = did_you_mean(output.suffix, _FORMATS) or f"there are {', '.join(_FORMATS)}"
        raise InvalidArgument(f"`{output}` is of no format that can be written; {hint}")
    if output.suffix == ".ecore":
        text = _metamodel(file, metamodels)
    else:
        text = model_text(read_model(file, metamodels), output)
    replace_file(output, text)
    print_line(f"wrote {output}")


def read_model(file: str, metamodels: list[str] | None) -> Model:
    """The model of a file, or of a family."""
    take(file, (*MODELS, "toml"), A_MODEL)
    workspace = envgraph.lang.load_workspace([*metamodel_paths(metamodels), file])
    workspace.raise_errors()
    if not workspace.models:
        raise InvalidArgument(f"`{file}` has no model")
    return workspace.model()


def metamodel_paths(metamodels: list[str] | None) -> list[str]:
    """The values of `--metamodel`, if any were given."""
    for one in metamodels or ():
        take(one, METAMODELS, A_METAMODEL)
    return metamodels or []


def model_text(model: Model, output: Path) -> str:
    """A model in the format that the name of a file asks for."""
    if output.suffix == ".xmi":
        return model_to_xmi(model)
    return json.dumps(model_to_json(model), ensure_ascii=False, indent=1) + "\n"


def _metamodel(file: str, metamodels: list[str] | None) -> str:
    workspace = envgraph.lang.load_workspace([file, *metamodel_paths(metamodels)])
    workspace.raise_errors()
    if workspace.metamodel is None:
        raise InvalidArgument(f"`{file}` is no metamodel, and imports none")
    return metamodel_to_ecore(workspace.metamodel)
