"""The command `envgraph replay`: repeat recorded rule applications."""

from __future__ import annotations

from pathlib import Path

import envgraph.lang
from envgraph.cli._convert_command import check_format
from envgraph.cli._inputs import Inputs, check_file_format
from envgraph.cli._match_and_apply import open_engine, write_model
from envgraph.cli._output import print_json, print_line
from envgraph.graph import model_to_json


def replay_trace(model: str, rules: str, trace: Path, inputs: Inputs, output: Path | None) -> None:
    """Repeat the applications of a trace; raise an error if a state differs from the state recorded in the trace."""
    if output is not None:
        check_format(output)
    check_file_format(str(trace), ("trace",), "a trace, which `envgraph apply --trace` writes")
    engine = open_engine(model, rules, inputs)
    source = envgraph.lang.read_source(envgraph.lang.DiskFiles(), str(trace))
    read = envgraph.lang.parse_trace(source, engine)
    engine.replay(read)
    state = f"{engine.model.state_hash():016x}"
    print_json(lambda: {"applications": len(read), "state": state, "model": model_to_json(engine.model)})
    checked = len(read.states)
    print_line(
        f"{len(read)} application{'s' * (len(read) != 1)}; state {state}; "
        f"{checked} state{'s' * (checked != 1)} compared"
    )
    if output is not None:
        write_model(engine, output)
