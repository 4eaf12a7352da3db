"""Turn a behaviour and a model into an environment: simulated, as arrays, for Gymnasium, and drawn.

`check_behaviour` reports what is wrong with a behaviour. `Simulator` runs it on a live engine, and its docstring
defines a step. `explore` enumerates all reachable states as a `Tabular`, with pictures. `EnvgraphEnv`,
`EnvgraphLiveEnv` and `EnvgraphVectorEnv` are the Gymnasium environments over them. `KeyIndex` holds the indices of
objects over a family. Importing the package registers the bundled environments (`envgraph/BurningForest-v0`) with
Gymnasium. `Simulator` and scenes need neither Gymnasium nor NumPy, so that models can be played in a browser.

>>> import gymnasium
>>> gymnasium.spec("envgraph/BurningForest-v0").max_episode_steps
200
"""

from importlib.util import find_spec
from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec as EnvSpec
    from gymnasium.wrappers import FrameStackObservation as FrameStackObservation

    from envgraph.behaviour import (
        Action as Action,
        Agent as Agent,
        Behaviour as Behaviour,
        Branch as Branch,
        Domain as Domain,
        DrawGraph as DrawGraph,
        DrawGrid as DrawGrid,
        DrawnLink as DrawnLink,
        EachStep as EachStep,
        Effect as Effect,
        KeyIndex as KeyIndex,
        Observation as Observation,
        ObserveAround as ObserveAround,
        ObserveAttribute as ObserveAttribute,
        ObserveFind as ObserveFind,
        ObserveObject as ObserveObject,
        ObserveRange as ObserveRange,
        OnFind as OnFind,
        OnRefused as OnRefused,
        OnReset as OnReset,
        RuleCall as RuleCall,
        Token as Token,
        check_behaviour as check_behaviour,
        indexed_classes as indexed_classes,
        key_reader as key_reader,
    )
    from envgraph.env._adopted_transitions import (
        AdoptedTransitions as AdoptedTransitions,
        TransitionOutcome as TransitionOutcome,
        adopt as adopt,
    )
    from envgraph.env._end_search import can_end as can_end
    from envgraph.env._enumeration import ExploredEnvironment as ExploredEnvironment, explore as explore
    from envgraph.env._family_members import (
        MemberFacts as MemberFacts,
        SwitchableMembers as SwitchableMembers,
        VectorVariants as VectorVariants,
    )
    from envgraph.env._float_ranges import FloatRange as FloatRange
    from envgraph.env._frozen_lake import frozen_lake_arguments as frozen_lake_arguments
    from envgraph.env._gymnasium import (
        EnvgraphEnv as EnvgraphEnv,
        EnvgraphLiveEnv as EnvgraphLiveEnv,
        SingleEnvironment as SingleEnvironment,
        check_render_mode as check_render_mode,
    )
    from envgraph.env._joint_steps import AgentStepper as AgentStepper
    from envgraph.env._minigrid import MiniGridLevel as MiniGridLevel
    from envgraph.env._model_views import (
        GraphView as GraphView,
        ImageView as ImageView,
        ModelView as ModelView,
        PaddedGraphView as PaddedGraphView,
        TextView as TextView,
        model_view as model_view,
        torch_graph as torch_graph,
    )
    from envgraph.env._observation_spaces import (
        MODEL_KINDS as MODEL_KINDS,
        ComponentView as ComponentView,
        ObservationKind as ObservationKind,
        check_observation_kind as check_observation_kind,
    )
    from envgraph.env._played_episode import PlayedEpisode as PlayedEpisode, PlayedStep as PlayedStep
    from envgraph.env._recorded_episode import (
        END_NAMES as END_NAMES,
        episode_gif as episode_gif,
        episode_svg as episode_svg,
        episode_to_dict as episode_to_dict,
    )
    from envgraph.env._separate_rewards import SeparateRewards as SeparateRewards
    from envgraph.env._simulator import Simulator as Simulator, StepOutcome as StepOutcome
    from envgraph.env._size_errors import TooManyStates as TooManyStates
    from envgraph.env._table_file import read_explored as read_explored, write_explored as write_explored
    from envgraph.env._tabular import Tabular as Tabular
    from envgraph.env._vector_environments import EnvgraphVectorEnv as EnvgraphVectorEnv
    from envgraph.env.registration import (
        Environment as Environment,
        VectorEnvironment as VectorEnvironment,
        environment_spec as environment_spec,
        make_vec_spec as make_vec_spec,
        register as register,
    )
    from envgraph.env.scene._pixels import scene_rgb as scene_rgb
    from envgraph.env.scene._scene import (
        EMPTY as EMPTY,
        Draw as Draw,
        DrawnObjects as DrawnObjects,
        Edge as Edge,
        GraphScene as GraphScene,
        GridScene as GridScene,
        LegendEntry as LegendEntry,
        Mark as Mark,
        Painter as Painter,
        Scene as Scene,
        legend as legend,
        scene_of as scene_of,
    )
    from envgraph.env.scene._scene_svg import scene_svg as scene_svg
    from envgraph.env.scene._text import scene_text as scene_text
    from envgraph.env.scene._window import Window as Window

export_lazily(globals())

if find_spec("gymnasium") is not None:  # it is left out in browsers
    from envgraph.env.registration import register_bundled

    register_bundled()
