"""Turn a behaviour and a model into an environment: simulated, as arrays, for Gymnasium, and drawn.

`check_behaviour` reports what is wrong with a behaviour. `Simulator` runs it on a live engine, and its docstring
defines a step. `explore` enumerates all reachable states as a `Tabular`, with pictures. `EnvgraphEnv`,
`EnvgraphLiveEnv` and `EnvgraphVectorEnv` are the Gymnasium environments over them. `KeyIndex` holds the indices of
objects over a family. Importing the package registers the bundled environments (`envgraph/BurningForest-v0`).

>>> import gymnasium
>>> gymnasium.spec("envgraph/BurningForest-v0").max_episode_steps
200
"""

from typing import TYPE_CHECKING

from envgraph.code import later
from envgraph.env.registration import register_entry_point

if TYPE_CHECKING:
    from gymnasium.envs.registration import EnvSpec as EnvSpec

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
        ObserveAttribute as ObserveAttribute,
        ObserveFind as ObserveFind,
        ObserveObject as ObserveObject,
        ObserveRange as ObserveRange,
        OnFind as OnFind,
        OnReset as OnReset,
        RuleCall as RuleCall,
        SameKey as SameKey,
        Token as Token,
        check_behaviour as check_behaviour,
        indexed_classes as indexed_classes,
        key_reader as key_reader,
    )
    from envgraph.env._adopted import Adopted as Adopted, Transition as Transition, adopt as adopt
    from envgraph.env._apart import RewardsApart as RewardsApart
    from envgraph.env._explore import Explored as Explored, explore as explore
    from envgraph.env._frozen_lake import frozen_lake as frozen_lake
    from envgraph.env._gymnasium import (
        EnvgraphEnv as EnvgraphEnv,
        EnvgraphLiveEnv as EnvgraphLiveEnv,
        SingleEnvironment as SingleEnvironment,
        check_render_mode as check_render_mode,
    )
    from envgraph.env._members import About as About, Members as Members, Variants as Variants
    from envgraph.env._minigrid import MiniGridLevel as MiniGridLevel
    from envgraph.env._model_views import (
        GraphView as GraphView,
        ImageView as ImageView,
        ModelView as ModelView,
        model_view as model_view,
        torch_graph as torch_graph,
    )
    from envgraph.env._reaching import can_end as can_end
    from envgraph.env._simulator import Outcome as Outcome, Simulator as Simulator
    from envgraph.env._table_file import read_explored as read_explored, write_explored as write_explored
    from envgraph.env._tabular import Tabular as Tabular
    from envgraph.env._too_many import TooManyStates as TooManyStates
    from envgraph.env._vector import EnvgraphVectorEnv as EnvgraphVectorEnv
    from envgraph.env._views import (
        OF_MODEL as OF_MODEL,
        ObservationKind as ObservationKind,
        View as View,
        check_kind as check_kind,
    )
    from envgraph.env.registration import (
        Environment as Environment,
        VectorEnvironment as VectorEnvironment,
        environment_spec as environment_spec,
        make_vec_spec as make_vec_spec,
        register as register,
    )
    from envgraph.env.scene._pixels import scene_rgb as scene_rgb
    from envgraph.env.scene._scene import (
        Draw as Draw,
        Edge as Edge,
        GraphScene as GraphScene,
        GridScene as GridScene,
        Key as Key,
        Mark as Mark,
        Scene as Scene,
        legend as legend,
        scene_of as scene_of,
    )
    from envgraph.env.scene._svg import scene_svg as scene_svg
    from envgraph.env.scene._text import scene_text as scene_text

later(globals())

register_entry_point()
