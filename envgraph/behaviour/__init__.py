"""Behaviours of agents as data: actions, observations, rewards and drawing, and their checks.

`check_behaviour` reports errors in a behaviour; `envgraph.env` runs it. All other names serve both.
"""

from typing import TYPE_CHECKING

from envgraph.code import later

if TYPE_CHECKING:
    from envgraph.behaviour._binding import (
        Reader as Reader,
        bind_parameter as bind_parameter,
        bind_parameters as bind_parameters,
        follow as follow,
        reader as reader,
        unbound as unbound,
    )
    from envgraph.behaviour._check import check_behaviour as check_behaviour
    from envgraph.behaviour._clauses import (
        Question as Question,
        condition_question as condition_question,
        count_question as count_question,
    )
    from envgraph.behaviour._data import (
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
        End as End,
        Observation as Observation,
        ObserveAttribute as ObserveAttribute,
        ObserveFind as ObserveFind,
        ObserveObject as ObserveObject,
        ObservePath as ObservePath,
        ObserveRange as ObserveRange,
        OnFind as OnFind,
        OnReset as OnReset,
        RuleCall as RuleCall,
        Token as Token,
    )
    from envgraph.behaviour._domains import domain_type as domain_type
    from envgraph.behaviour._edges import edge_ends as edge_ends
    from envgraph.behaviour._keys import (
        KeyIndex as KeyIndex,
        SameKey as SameKey,
        expanded as expanded,
        indexed_classes as indexed_classes,
        key_attributes as key_attributes,
        key_reader as key_reader,
        ordered_objects as ordered_objects,
        spread_classes as spread_classes,
    )
    from envgraph.behaviour._losing import (
        Reading as Reading,
        is_gone as is_gone,
        lost as lost,
        readings as readings,
        root_of as root_of,
        roots as roots,
    )
    from envgraph.behaviour._rewards import paying as paying, reward_names as reward_names

later(globals())
