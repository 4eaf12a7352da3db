"""Limit the sizes that a file may ask for. The environment variable `ENVGRAPH_LIMITS` multiplies all limits."""

from __future__ import annotations

import os
from typing import Final

from envgraph.errors._exceptions import InvalidArgument
from envgraph.errors._numbers import LARGEST_INT, parse_float, parse_int

_VARIABLE = "ENVGRAPH_LIMITS"

MAX_ERRORS: Final = 100
"""Number of errors after which the rest of a file is not read or checked: nobody reads more at once."""
MAX_NESTING: Final = 100
"""Maximal nesting of brackets, expressions, blocks of rules, steps of units, packages and closures.

Checks are recursive, and generated source is nested in the same way. Python allows 1,000 nested calls, 200 nested
parentheses and 100 levels of indentation.
"""
LIMITS: Final[dict[str, int]] = {
    # Files, raised by `ENVGRAPH_LIMITS`
    "file bytes": 16 * 2**20,  # of any file but the next two kinds
    "model bytes": 256 * 2**20,  # of files that programs write: traces, and models as XMI or JSON
    "query bytes": 2**20,  # of files whose definitions are checked together: about 10 seconds for each MB
    "files": 10_000,  # read together, with all imports
    "tags": 100_000,  # of an `.ecore` file; the metamodel of UML has 10,000
    "open tags": 100_000,  # of an `.xmi` file, inside each other
    "nesting of TOML": 50,  # parts of a key, and brackets on a line
    "levels": 5_000,  # of a file for `envgraph import`
    "cells": 100_000,  # of all levels of a file; as a model they take 4 s and 240 MB
    # Numbers in files and on the command line, raised
    "members": 100_000,  # of a family; bins of a measure, agents for a curriculum, levels of an audit
    "width": 100_000,  # and branching, length and runs of a strategy or selection; seeds and controls
    "rounds": 1_000,  # of a tournament; lanes of the search for a curriculum
    "applications": 10_000,  # of rules to a first model
    "attempts": 1_000_000,  # of a mutation; steps of an episode, rounds of annealing, steps of n-step learning
    "episodes": 100_000_000,  # of an evaluation, and steps of an objective
    "steps": 1_000_000_000,  # generations or attempts in all; Ctrl-C stops them earlier
    "hidden units": 4_096,  # of the students of an audit
    "workers": 256,  # processes
    "seed": LARGEST_INT,  # of random numbers
    # Matches and rules, raised
    "matches": 1_000_000,  # of unconnected or recursive patterns: a second and, with a dozen variables, 200 MB
    "instances": 100_000,  # of blocks in one application, against a `forall` that enlarges the model each time
    "steps of a run": 100_000,  # calls and rounds of loops
    "derived rules": 10_000,  # of one `derive`: the ordered pairs of 100 classes, which take 4 s and 100 MB
    # Patterns and rules, not raised
    "constraints": 1_000,  # and path steps of a body: planning takes a few seconds
    "operands": 50_000,  # and operators of an expression, because exact ints grow with every product
    "characters": 1_000_000,  # of a string that is the value of a whole expression
    "nested steps": 200,  # of a run, called units included; more would exhaust the stack of Python
    "rounds of callbacks": 1_000,  # in which callbacks for matches change the model again
    "operators": 8,  # that create one class or retype one class to another, unless `@cap` changes it
    "new objects": 4,  # of one derived operator
    "new links": 12,  # of one derived operator
    "creation plans": 400,  # complete or not, that are considered for one class
    "keys": 64,  # of enum literals and truth values that are tried
    "Ecore files": 1_000,  # searched for names; those of further files are reported as missing
    # Environments, not raised
    "actions": 100_000,  # of one agent, and joint actions of all agents
    "states": 250_000,  # of a table by default: about 30 s and 0.5 GB until the error that there are too many
    "searched states": 50_000,  # by default, where thousands of models are tried
    "level states": 20_000,  # of a level of MiniGrid, which take half a minute, and of an audit
    "planned states": 200_000,  # after which a search for a plan ends: 80 ms with numba, 20 s in Python
    "all outcomes": 10_000_000,  # of actions in all states together, by default; they need time and memory, too
    "outcomes": 10_000,  # of one action in one state, equal ones included: some seconds. Units may have millions
    "start states": 10_000,  # of an adopted environment, equally likely
    "random choices": 1_000,  # in one step
    "created objects": 1_024,  # in a state: environments small enough for a table do not need more
    "table entries": 50_000_000,  # states, times actions, times the most outcomes of one; 21 bytes each
    "table bytes": 2**31,  # of all arrays of a file, unpacked; the largest that are written have a fifth of it
    "cached bytes": 2**31,  # of tables, and of the arrays of a million members; the least recently used are removed
    "pixels": 64_000_000,  # of a picture
    "drawn cells": 1_000_000,  # of a grid
    "action values": 10**8,  # of Q-learning: 800 megabytes
    "sweeps": 1_000_000,  # of value iteration
    "curriculum": 100,  # members of a family to train on, since each adds a curriculum and a stage
}
"""The usual value of each limit on input: what a person or a file may ask for at most."""


def scaled_limit(name: str) -> int:
    """Return a limit: its value in `LIMITS` times the factor in the environment variable `ENVGRAPH_LIMITS`, at least 1.

    One factor changes all limits, also in worker processes. A message about a limit ends with `RAISE_LIMIT_HINT`.

    Raises:
        InvalidArgument: the variable is not a number above 0 and at most a million.

    >>> scaled_limit("rounds")
    1000
    """
    text = os.environ.get(_VARIABLE, "1")
    factor = parse_float(text)
    if factor is None or not 0 < factor <= 1_000_000:
        message = f"the variable {_VARIABLE} is `{text[:20]}`, but must be a number above 0 and at most 1,000,000"
        raise InvalidArgument(message, "set it to a number such as 10, or unset it")
    return max(int(LIMITS[name] * factor), 1)


def parse_int_within(text: str, low: int, high: str) -> int:
    """Parse a whole number from `low` to the limit named `high`, (times the factor in `ENVGRAPH_LIMITS`).

    Raises:
        InvalidArgument: the text is not a whole number in this range.
    """
    highest, number = min(scaled_limit(high), LARGEST_INT), parse_int(text)
    if number is None or not low <= number <= highest:
        shown = text[:20] + "..." * (len(text) > 20)
        hint = RAISE_LIMIT_HINT if text.isdecimal() and number != 0 and highest < LARGEST_INT else None
        raise InvalidArgument(f"`{shown}` is not a whole number from {low:,} to {highest:,}", hint)
    return number


RAISE_LIMIT_HINT = f"set the environment variable {_VARIABLE}=10 to make every limit ten times as large"
"""Hint of every message about a limit."""
