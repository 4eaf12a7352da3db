"""An agent's behaviour over a model, and the environment that it makes: simulated, as arrays, in Gymnasium, drawn.

`check_behaviour` says what is wrong with a behaviour; `Simulator` runs it on a live engine, and its docstring defines
what a step is; `explore` makes it a `Tabular` of all reachable states, with pictures. `EnvgraphEnv`, `EnvgraphLiveEnv`
and `EnvgraphVectorEnv` are the Gymnasium environments over them. `KeyIndex` holds the indices of objects over a family.
Importing the package registers the bundled environments (`envgraph/BurningForest-v0`).

>>> import gymnasium
>>> gymnasium.spec("envgraph/BurningForest-v0").max_episode_steps
200
"""

from gymnasium.envs.registration import EnvSpec

from envgraph.behaviour import (
    Action,
    Agent,
    Behaviour,
    Branch,
    Domain,
    DrawGraph,
    DrawGrid,
    DrawnLink,
    EachStep,
    Effect,
    Observation,
    ObserveAttribute,
    ObserveFind,
    ObserveObject,
    ObserveRange,
    OnFind,
    OnReset,
    RuleCall,
    Token,
    check_behaviour,
)
from envgraph.env._adopted import Adopted, Transition, adopt
from envgraph.env._agents import unbound
from envgraph.env._apart import RewardsApart
from envgraph.env._explore import DEFAULT_LIMIT, Explored, explore
from envgraph.env._frozen_lake import frozen_lake
from envgraph.env._gymnasium import EnvgraphEnv, EnvgraphLiveEnv, SingleEnvironment, check_render_mode
from envgraph.env._keys import KeyIndex, SameKey, indexed_classes, key_reader, spread_classes
from envgraph.env._members import About, Members, Variants
from envgraph.env._minigrid import MiniGridLevel
from envgraph.env._model_views import GraphView, ImageView, ModelView, model_view, torch_graph
from envgraph.env._reaching import REACH_LIMIT, can_end
from envgraph.env._simulator import Outcome, Simulator
from envgraph.env._table_file import read_explored, write_explored
from envgraph.env._tabular import Tabular
from envgraph.env._too_many import TooManyStates
from envgraph.env._vector import EnvgraphVectorEnv
from envgraph.env._views import OF_MODEL, ObservationKind, View, check_kind
from envgraph.env.registration import (
    Environment,
    VectorEnvironment,
    environment_spec,
    make_vec_spec,
    register,
    register_entry_point,
)
from envgraph.env.scene._pixels import scene_rgb
from envgraph.env.scene._scene import Draw, Edge, GraphScene, GridScene, Key, Mark, Scene, legend, scene_of
from envgraph.env.scene._svg import scene_svg
from envgraph.env.scene._text import scene_text, scene_title
from envgraph.errors import shorten

__all__ = [
    "DEFAULT_LIMIT",
    "OF_MODEL",
    "REACH_LIMIT",
    "About",
    "Action",
    "Adopted",
    "Agent",
    "Behaviour",
    "Branch",
    "Domain",
    "Draw",
    "DrawGraph",
    "DrawGrid",
    "DrawnLink",
    "EachStep",
    "Edge",
    "Effect",
    "EnvSpec",
    "EnvgraphEnv",
    "EnvgraphLiveEnv",
    "EnvgraphVectorEnv",
    "Environment",
    "Explored",
    "GraphScene",
    "GraphView",
    "GridScene",
    "ImageView",
    "Key",
    "KeyIndex",
    "Mark",
    "Members",
    "MiniGridLevel",
    "ModelView",
    "Observation",
    "ObservationKind",
    "ObserveAttribute",
    "ObserveFind",
    "ObserveObject",
    "ObserveRange",
    "OnFind",
    "OnReset",
    "Outcome",
    "RewardsApart",
    "RuleCall",
    "SameKey",
    "Scene",
    "Simulator",
    "SingleEnvironment",
    "Tabular",
    "Token",
    "TooManyStates",
    "Transition",
    "Variants",
    "VectorEnvironment",
    "View",
    "adopt",
    "can_end",
    "check_behaviour",
    "check_kind",
    "check_render_mode",
    "environment_spec",
    "explore",
    "frozen_lake",
    "indexed_classes",
    "key_reader",
    "legend",
    "make_vec_spec",
    "model_view",
    "read_explored",
    "register",
    "scene_of",
    "scene_rgb",
    "scene_svg",
    "scene_text",
    "scene_title",
    "spread_classes",
    "torch_graph",
    "unbound",
    "write_explored",
]

register_entry_point()

shorten(globals(), __all__)
