"""Code generation: from search plans to Python functions."""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.match.generate._bindings import VariableBindings as VariableBindings
    from envgraph.match.generate._sinks import (
        COUNT as COUNT,
        EXISTENCE as EXISTENCE,
        SolutionSink as SolutionSink,
        VariableCode as VariableCode,
    )
    from envgraph.match.generate._translator import PlanTranslator as PlanTranslator

export_lazily(globals())
