"""Run the command line program with `python -m envgraph`."""

from envgraph.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
