"""Templates: which files they make, and what is said of mistakes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from envgraph.errors import EvaluationError, InvalidArgument, LoadError
from envgraph.search.export import TemplateDirectory

KNOWN = ("package", "actions")


class Level:
    """What `member` stands for here."""

    def __init__(self, name: str) -> None:
        self.name = name


def written(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def made(folder: Path, files: dict[str, str], *members: str, **values: Any) -> dict[str, str | bytes]:
    """What templates make."""
    given = {"package": "levels", "actions": ("left", "right"), **values}
    return TemplateDirectory(written(folder, files), KNOWN).render_files(given, [Level(name) for name in members])


def test_text_and_paths_are_rendered_and_other_files_copied(tmp_path: Path) -> None:
    files = {
        "src/{{package}}/actions.txt.j2": "{% for one in actions %}\n{{ one | python }}\n{% endfor %}\n",
        "{{package}}.json": "{{ not rendered }}",
        "empty.txt.j2": "{% if not actions %}something{% endif %}\n",
        "{% if not actions %}unnamed.txt{% endif %}.j2": "text",
    }
    assert made(tmp_path, files) == {
        "levels.json": b"{{ not rendered }}",
        "src/levels/actions.txt": '"left"\n"right"\n',
    }


ODD = 'a "b" {c}\\\n<d> [e](f) \u202e'


@pytest.mark.parametrize(
    ("file", "template", "text"),
    [
        ("a.py", '"{{ package[:9] }}"', r'"a \u0022b\u0022 \u007bc\u007d"'),
        ("a.py", '"{{ package[9:] }}"', r'"\u005c\u000a\u003cd\u003e \u005be\u005d\u0028f\u0029 \u202e"'),
        ("a.py", "{{ package | python }}", r'"a \"b\" {c}\\\n<d> [e](f) \u202e"'),
        ("a.PY", "{{ package | json }}", r'"a \"b\" {c}\\\n\u003cd\u003e [e](f) \u202e"'),
        ("a.json", "{{ [1, package[:2]] | json }}", '[1, "a "]'),
        ("a.md", "{{ package }}", 'a "b" {c}\\\n&lt;d> [e]&#40;f) \\u202e'),
        ("a.md", "{{ package | markdown }}", r'a "b" {c}\\\\n\<d\> \[e\](f) \\u202e'),
        ("a.html", "{{ package[-8:] | python }}", "&quot;&#91;e&#93;&#40;f&#41; &#92;u202e&quot;"),
        ("a.svg", "{{ package[:3] }}{{ actions[:1] }}", "a &quot;&#40;&#39;left&#39;,&#41;"),
        ("a.txt", "{{ package }}{{ package[:4] | python }}", ODD + r'"a \"b"'),
        ("a.py", '{% for one in actions %}{{ one }} = -{{ 1 / 8 }}, {{ 10 ** 20.0 }}, {{ none }}{% endfor %}',
         "left = -0.125, 1e+20, Noneright = -0.125, 1e+20, None"),
        ("a.py", '{% macro call(x) %}f("{{ x }}"){% endmacro %}{{ call(actions[0]) | indent }}', 'f("left")'),
        ("a.py", '[{{ actions | map("python") | join(", ") }}]', '["left", "right"]'),
        ("a.py", "{{ '\"' }}{{ '\"' | safe }}", r'\u0022"'),
    ],
)  # fmt: skip
def test_values_are_escaped_for_the_language_of_the_file(file: str, template: str, text: str, tmp_path: Path) -> None:
    files = {f"{file}.j2": '{% include "included.j2" %}', "included.j2": template}
    assert made(tmp_path, files, package=ODD)[file] == text


def test_member_in_a_path_creates_one_file_per_member(tmp_path: Path) -> None:
    files = {"maps/{{member.name}}.txt.j2": "this is {{ member.name }}"}
    assert made(tmp_path, files, "E1", "E2") == {"maps/E1.txt": "this is E1", "maps/E2.txt": "this is E2"}


def test_templates_include_each_other(tmp_path: Path) -> None:
    files = {"a.j2": '{% include "b.j2" %}!', "b.j2": "{{ package }}"}
    assert made(tmp_path, files) == {"a": "levels!", "b": "levels"}


def test_all_mistakes_of_all_templates_are_reported_with_positions(tmp_path: Path) -> None:
    files = {
        "a.j2": "fine\n  {{ pakage }} {{ actions }} {{ other }}\n",
        "b.j2": "\n{% for one in actions %}\n",
        "c.j2": "{{ package | nothing }}",
        "d.j2": "{{ member.name }}",
        "{{nobody}}/e.j2": "",
    }
    with pytest.raises(LoadError) as error:
        made(tmp_path, files)
    told = str(error.value).replace(str(tmp_path), "")
    assert "/a.j2:2:33: unknown name `other`\n 2 |   {{ pakage }} {{ actions }} {{ other }}\n" in told
    assert "/a.j2:2:6: unknown name `pakage`" in told and "hint: did you mean `package`?" in told
    assert "/b.j2:2:1: unexpected end of template" in told
    assert "/c.j2:1:1: no filter named 'nothing'" in told
    assert "/d.j2:1:4: unknown name `member`" in told and "write `{{member.name}}` in the path" in told
    assert "path of {{nobody}}/e.j2:1:3: unknown name `nobody`" in told
    assert len(error.value.diagnostics) == 6


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("\n{{ actions.first }}", ":2:1: 'tuple object' has no attribute 'first'"),
        ("{{ actions.__class__.__mro__ }}", "access to attribute '__class__' of 'tuple' object is unsafe"),
        ("{{ 1 // 0 }}", "integer division or modulo by zero"),
        ("{{ package.encode('ascii', 3) }}", "encode() argument 'errors' must be str"),
        ('{% include "none.j2" %}', ":1:1: 'none.j2' not found"),
        ("{% for n in range(10 ** 9) %}{% endfor %}", "range too big"),
    ],
)
def test_runtime_error_of_a_template_is_reported_with_its_position(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(EvaluationError) as error:
        made(tmp_path, {"a.j2": text})
    assert str(error.value).startswith(f"{tmp_path}/a.j2:") and told in str(error.value)


def test_mistake_in_an_included_template_is_reported_in_that_template(tmp_path: Path) -> None:
    with pytest.raises(EvaluationError, match=r"b\.j2:2:1: ") as error:
        made(tmp_path, {"a.j2": '{% include "b.j2" %}', "b.j2": "\n{{ package.none }}"})
    assert error.value.span is not None


@pytest.mark.parametrize("name", ["../up", "/etc/up", "a/../../up", "a\nb", "..\\up", "a//b"])
def test_template_paths_outside_the_folder_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidArgument, match="which is not a valid path"):
        made(tmp_path, {"{{package}}.txt.j2": "text"}, package=f"{name}/x")


def test_two_templates_that_render_the_same_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgument, match="two templates render `levels"):
        made(tmp_path, {"levels.txt": "", "{{package}}.txt.j2": "text"})


def test_missing_or_empty_template_directory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgument, match="there is no directory"):
        TemplateDirectory(tmp_path / "none", KNOWN)
    with pytest.raises(InvalidArgument, match="has no templates in it"):
        TemplateDirectory(tmp_path, KNOWN)


def test_template_that_is_not_valid_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.j2").write_bytes(b"\xff")
    with pytest.raises(LoadError, match=r"a\.j2"):
        TemplateDirectory(tmp_path, KNOWN)
