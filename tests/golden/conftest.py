"""`pytest tests/golden --update-golden` writes what is said now to the `.expected` files."""

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-golden", action="store_true", help="write the .expected files anew")
    parser.addoption("--generated", metavar="DIRECTORY", help="write all generated functions to a directory")
