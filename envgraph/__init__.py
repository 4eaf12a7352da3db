"""Graph rewriting, and families of reinforcement-learning environments derived from one environment.

The public names are imported lazily, on first use. So importing the engine does not import the parser, NumPy or
Gymnasium.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.errors import EnvgraphError as EnvgraphError, LoadError as LoadError
    from envgraph.graph import Model as Model, Node as Node
    from envgraph.lang import Pattern as Pattern, Rule as Rule, Unit as Unit, load as load, open as open
    from envgraph.metamodel import Metamodel as Metamodel
    from envgraph.pattern import Derivation as Derivation
    from envgraph.rewrite import Engine as Engine
    from envgraph.search import (
        make as make,
        make_aec as make_aec,
        make_parallel as make_parallel,
        make_vec as make_vec,
        optimise as optimise,
        register as register,
    )

export_lazily(globals())

__version__ = "0.2.0"
