"""Parse the five languages and family files into data, and write data as text.

Most programs need only `open` and `load`. `load_workspace` raises no exception for mistakes in files, but returns all
data together with all diagnostics.
"""

from typing import TYPE_CHECKING

from envgraph.code import export_lazily

if TYPE_CHECKING:
    from envgraph.graph import JsonPath as JsonPath
    from envgraph.lang._constructors import Pattern as Pattern, Rule as Rule, Unit as Unit
    from envgraph.lang.family._component_options import (
        LARGEST_NUMBER as LARGEST_NUMBER,
        ComponentOptions as ComponentOptions,
    )
    from envgraph.lang.family._family_reader import TABLES as TABLES, find_family as find_family
    from envgraph.lang.family._family_spec import (
        EXPRESSION_KIND as EXPRESSION_KIND,
        FamilySpec as FamilySpec,
        OptimiseSpec as OptimiseSpec,
        Strength as Strength,
    )
    from envgraph.lang.family._table_reader import (
        ComponentSpec as ComponentSpec,
        LocatedName as LocatedName,
        key as key,
    )
    from envgraph.lang.format._format_text import format_text as format_text
    from envgraph.lang.interchange._json_reader import (
        check_json as check_json,
        model_at as model_at,
        parse_json as parse_json,
        parse_model as parse_model,
    )
    from envgraph.lang.interchange._level_files import (
        Level as Level,
        LevelCell as LevelCell,
        read_levels as read_levels,
    )
    from envgraph.lang.interchange._level_template import LevelTemplate as LevelTemplate
    from envgraph.lang.interchange._pyecore import (
        metamodel_from_pyecore as metamodel_from_pyecore,
        metamodel_to_pyecore as metamodel_to_pyecore,
        model_from_pyecore as model_from_pyecore,
        model_to_pyecore as model_to_pyecore,
    )
    from envgraph.lang.interchange._trace_reader import parse_trace as parse_trace
    from envgraph.lang.loading._family_check import (
        COMPONENTS as COMPONENTS,
        MEASURE_OPTIONS as MEASURE_OPTIONS,
        NEED_ENVIRONMENT as NEED_ENVIRONMENT,
        check_family as check_family,
        numeric_parameters as numeric_parameters,
    )
    from envgraph.lang.loading._import_check import LANGUAGES as LANGUAGES
    from envgraph.lang.loading._load import (
        load as load,
        load_workspace as load_workspace,
        open as open,
        open_workspace as open_workspace,
    )
    from envgraph.lang.loading._reading_cache import ReadingCache as ReadingCache
    from envgraph.lang.loading._workspace import Workspace as Workspace
    from envgraph.lang.loading._workspace_check import (
        check_start as check_start,
        conformance_warnings as conformance_warnings,
    )
    from envgraph.lang.read._from_text import from_text as from_text
    from envgraph.lang.read._model_reader import ModelText as ModelText
    from envgraph.lang.syntax._bundled_data import (
        bundled_domain as bundled_domain,
        bundled_domains as bundled_domains,
        data_path as data_path,
    )
    from envgraph.lang.syntax._file_formats import FORMATS as FORMATS
    from envgraph.lang.syntax._grammar import language_of as language_of, reserved_words as reserved_words
    from envgraph.lang.syntax._lexer import END as END, PUNCTUATION as PUNCTUATION, Lexeme as Lexeme
    from envgraph.lang.syntax._source_files import (
        Bundle as Bundle,
        DiskFiles as DiskFiles,
        Files as Files,
        TextFiles as TextFiles,
        file_format as file_format,
        read_source as read_source,
    )
    from envgraph.lang.syntax._text_parts import (
        PartReading as PartReading,
        TextPart as TextPart,
        name_roles as name_roles,
        part_at as part_at,
        text_parts as text_parts,
    )
    from envgraph.lang.write._expressible_derived import spelled_out as spelled_out
    from envgraph.lang.write._model_to_text import model_to_text as model_to_text
    from envgraph.lang.write._to_text import to_text as to_text

export_lazily(globals())
