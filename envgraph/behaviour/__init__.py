"""Behaviours of agents as data: actions, observations, rewards and drawing, and their checks.

`check_behaviour` reports errors in a behaviour; `envgraph.env` runs it. All other names serve both.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.behaviour._behaviour import (
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
        ObserveAround as ObserveAround,
        ObserveAttribute as ObserveAttribute,
        ObserveFind as ObserveFind,
        ObserveObject as ObserveObject,
        ObservePath as ObservePath,
        ObserveRange as ObserveRange,
        OnFind as OnFind,
        OnRefused as OnRefused,
        OnReset as OnReset,
        RuleCall as RuleCall,
        Token as Token,
    )
    from envgraph.behaviour._behaviour_check import check_behaviour as check_behaviour
    from envgraph.behaviour._drawn_edges import edge_ends as edge_ends
    from envgraph.behaviour._helper_patterns import (
        HelperPattern as HelperPattern,
        ObservedWindow as ObservedWindow,
        condition_helper as condition_helper,
        find_helper as find_helper,
        key_helper as key_helper,
    )
    from envgraph.behaviour._key_bindings import (
        NAMED_KEYS as NAMED_KEYS,
        PLAY_COMMANDS as PLAY_COMMANDS,
        action_keys as action_keys,
        key_bindings as key_bindings,
        key_code as key_code,
        normal_key as normal_key,
    )
    from envgraph.behaviour._key_index import (
        DuplicateKeyError as DuplicateKeyError,
        KeyIndex as KeyIndex,
        expand_action as expand_action,
        indexed_classes as indexed_classes,
        key_attributes as key_attributes,
        key_reader as key_reader,
        ordered_objects as ordered_objects,
        ranged_classes as ranged_classes,
    )
    from envgraph.behaviour._lost_objects import (
        ObjectRead as ObjectRead,
        is_lost as is_lost,
        lost_object_error as lost_object_error,
        object_reads as object_reads,
        path_root as path_root,
        read_variables as read_variables,
    )
    from envgraph.behaviour._parameter_binding import (
        FeatureReader as FeatureReader,
        bind_parameter as bind_parameter,
        bind_parameters as bind_parameters,
        feature_reader as feature_reader,
        follow_path as follow_path,
        unbound_names as unbound_names,
    )
    from envgraph.behaviour._parameter_domains import domain_type as domain_type
    from envgraph.behaviour._reward_split import (
        clause_name as clause_name,
        reward_names as reward_names,
        with_only_reward as with_only_reward,
    )

export_lazily(globals())
