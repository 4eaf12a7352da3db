"""The command line program `envgraph`."""

from envgraph.cli import _domain_commands, _family_commands  # noqa: F401, they add the commands
from envgraph.cli._app import main as main
