"""What a command declares is what the function takes that runs it: names, and the types of values."""

from __future__ import annotations

import inspect
from importlib import import_module
from typing import Any

import click
import pytest

from envgraph.cli._app import app

READ_AS_INPUTS = {"metamodel", "allow_unresolved", "variant"}
"""Options that `inputs_options` hands on as one parameter."""
SCALARS = {"text": "str", "choice": "str", "path": "Path", "integer range": "int", "float": "float"}
"""Types of options, by the names that click gives them, and those of parameters."""


def function_parameters(command: click.Command) -> dict[str, str]:
    """Return the parameters of the function that a command is run by, with their types."""
    assert command.callback is not None
    function: Any = inspect.unwrap(command.callback, stop=lambda one: hasattr(one, "done_in"))
    if hasattr(function, "done_in"):
        module, name = function.done_in
        function = getattr(import_module(module), name)
    return {one.name: one.annotation for one in inspect.signature(function).parameters.values()}


def types_of(parameter: click.Parameter) -> set[str]:
    """Return the types that a parameter may have for the values of an option or argument."""
    if parameter.multiple or parameter.nargs != 1:
        return {"Sequence[str]", "Iterable[str]"}
    if getattr(parameter, "is_flag", False):
        return {"bool"}
    scalar = SCALARS[parameter.type.name]
    always = parameter.required or parameter.to_info_dict()["default"] is not None
    return {scalar if always else f"{scalar} | None"}


@pytest.mark.parametrize("name", list(app.commands))
def test_options_of_a_command_equal_the_parameters_of_its_function(name: str) -> None:
    command = app.commands[name]
    wanted = function_parameters(command)
    declared: dict[str, Any] = {one.name: one for one in command.params if one.expose_value and one.name}
    if wanted.pop("inputs", None):
        assert declared.keys() & READ_AS_INPUTS >= READ_AS_INPUTS - {"variant"}
        declared = {each: one for each, one in declared.items() if each not in READ_AS_INPUTS}
    declared.pop("cluster", None)  # `workers_options` connects to it
    assert declared.keys() == wanted.keys()
    wrong = {each: wanted[each] for each, one in declared.items() if wanted[each] not in types_of(one)}
    assert not wrong, {each: types_of(declared[each]) for each in wrong}
