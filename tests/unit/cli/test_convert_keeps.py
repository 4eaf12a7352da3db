"""What `envgraph convert` keeps of files of other tools, and what it lists with its number."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from envgraph.cli import main
from envgraph.graph import model_to_xmi
from envgraph.lang import load_workspace, open

Run = Callable[..., tuple[int, str]]
ECORE = "http://www.eclipse.org/emf/2002/Ecore"
SHOP = f"""<?xml version="1.0" encoding="UTF-8"?>
<ecore:EPackage xmi:version="2.0" xmlns:xmi="http://www.omg.org/XMI" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xmlns:ecore="{ECORE}" name="shop" nsURI="http://x/shop" nsPrefix="s">
  <eClassifiers xsi:type="ecore:EDataType" name="Money" instanceClassName="java.math.BigDecimal"/>
  <eClassifiers xsi:type="ecore:EClass" name="Shop">
    <eAnnotations source="{ECORE}/OCL/Pivot"><details key="positive" value="self.n &gt; 0"/></eAnnotations>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="cash" eType="#//Money"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="sums" upperBound="-1" unique="false" eType="#//Money"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="weight" eType="ecore:EDataType {ECORE}#//EDouble"/>
    <eStructuralFeatures xsi:type="ecore:EAttribute" name="day" eType="ecore:EDataType {ECORE}#//EDate"/>
    <eStructuralFeatures xsi:type="ecore:EReference" name="parts" upperBound="-1" containment="true" eType="#//Shop"/>
  </eClassifiers>
</ecore:EPackage>
"""
LARGE = "12345678901234567890.12"
HEAD = (
    '<s:Shop xmi:version="2.0" xmlns:xmi="http://www.omg.org/XMI" xmlns:s="http://x/shop" '
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs a command in a directory with the metamodel of the shop: exit code and messages."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    Path("shop.ecore").write_text(SHOP)

    def run_it(*arguments: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["envgraph", *arguments])
        try:
            code = main()
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 0
        err = capsys.readouterr().err
        assert "Traceback" not in err
        return code, err

    return run_it


def test_types_annotations_and_dates_of_a_metamodel_are_no_loss(run: Run) -> None:
    assert run("convert", "shop.ecore", "again.ecore") == (0, "")
    assert run("convert", "again.ecore", "third.ecore") == (0, "")
    text = Path("again.ecore").read_text()
    assert text == Path("third.ecore").read_text()
    assert 'value="self.n &gt; 0"' in text and f"{ECORE}#//EDate" in text
    assert 'name="cash" eType="#//Money"' in text


def test_digits_of_decimals_are_kept_and_their_values_compared_as_numbers(run: Run) -> None:
    tags = f"<sums>{LARGE}</sums><sums>0.10</sums>"
    Path("a.xmi").write_text(f'{HEAD} cash="{LARGE}" weight="1.50">{tags}<parts cash="12.10"/></s:Shop>')
    code, err = run("convert", "a.xmi", "b.xmi", "-m", "shop.ecore")
    assert code == 0
    assert re.findall("rounded: .*`", err) == [
        "rounded: 1 value of `Shop.cash`",
        "rounded: 1 value of `Shop.sums`",
    ]
    text = Path("b.xmi").read_text()
    assert re.findall('cash="(.*?)"', text) == [LARGE, "12.10"]
    assert re.findall("<sums>(.*?)</sums>", text) == [LARGE, "0.10"]
    assert 'weight="1.5"' in text  # a double
    Path("q.query").write_text(
        'import "http://x/shop"\npattern rich(s : Shop, c : float) { Shop.cash(s, c); check(c > 12.0); }'
    )
    found = open("shop.ecore", "b.xmi", "q.query")
    assert len(list(found.matches("rich"))) == 2


def test_digits_of_decimals_are_a_loss_where_they_cannot_be_written(run: Run) -> None:
    Path("a.xmi").write_text(f'{HEAD} cash="{LARGE}"/>')
    Path("short.xmi").write_text(f'{HEAD} cash="12.10"/>')
    for format in ("json", "model"):
        code, err = run("convert", "a.xmi", f"a.{format}", "-m", "shop.ecore")
        assert code == 1 and "the warning says what `a.xmi` would lose" in err
        assert not Path(f"a.{format}").exists()
        assert run("convert", "a.xmi", f"a.{format}", "-m", "shop.ecore", "--lossy")[0] == 0
        assert run("convert", "short.xmi", f"short.{format}", "-m", "shop.ecore") == (0, "")
    assert json.loads(Path("short.json").read_text())["objects"][0]["features"]["cash"] == 12.1


def test_two_decimals_of_an_object_that_are_one_float_are_a_loss(run: Run) -> None:
    for one, other in ((LARGE, f"{LARGE[:-1]}3"), ("0.1", f"0.1{'0' * 20}1"), (f"0.1{'0' * 20}1", "0.1")):
        Path("a.xmi").write_text(f"{HEAD}><sums>{one}</sums><sums>{other}</sums></s:Shop>")
        code, err = run("convert", "a.xmi", "b.xmi", "-m", "shop.ecore")
        assert code == 1 and "left out: 1 value of `Shop.sums`" in err
    Path("a.xmi").write_text(f"{HEAD}><sums>0.1</sums><sums>0.10</sums></s:Shop>")
    assert run("convert", "a.xmi", "b.xmi", "-m", "shop.ecore") == (0, "")


def test_kept_digits_are_written_only_for_an_unchanged_value(run: Run) -> None:
    Path("a.xmi").write_text(f'{HEAD} cash="{LARGE}"><parts cash="0.50"/></s:Shop>')
    model = load_workspace(["shop.ecore", "a.xmi"]).model()
    shop, part = model.nodes("Shop")
    shop.cash, part.cash = 2.5, 7.0
    assert 'cash="2.5"' in model_to_xmi(model) and 'cash="7.0"' in model_to_xmi(model)
    part.cash = 0.5
    assert 'cash="0.50"' in model_to_xmi(model.copy())


def test_applying_a_rule_keeps_the_digits_that_it_does_not_change(run: Run) -> None:
    Path("a.xmi").write_text(f'{HEAD} cash="{LARGE}" weight="1.0"/>')
    Path("r.rules").write_text(
        'package r\nimport "http://x/shop"\nrule heavy { lhs { s : Shop; } modify { set s.weight = 2.0; } }'
    )
    code, err = run("apply", "a.xmi", "r.rules", "heavy", "-m", "shop.ecore", "-o", "b.xmi")
    assert code == 0 and "rounded: 1 value of `Shop.cash`" in err
    assert f'cash="{LARGE}" weight="2.0"' in Path("b.xmi").read_text()


def test_skipped_extensions_of_other_tools_are_counted(run: Run) -> None:
    extension = "<xmi:Extension><a/></xmi:Extension>"
    Path("a.xmi").write_text(
        f'{HEAD} xmlns:o="http://other" xsi:schemaLocation="http://x/shop shop.ecore" xmi:uuid="1" o:x="1">'
        f'{extension}<parts xmi:uuid="2" xmi:id="p" xsi:type="s:Shop">{extension}</parts></s:Shop>'
    )
    code, err = run("convert", "a.xmi", "b.xmi", "-m", "shop.ecore")
    assert code == 1 and not Path("b.xmi").exists()
    assert re.findall("left out: .*tools", err) == [
        "left out: 2 attributes `xmi:uuid` of other tools",
        "left out: 1 attribute `o:x` of other tools",
        "left out: 2 tags `xmi:Extension` of other tools",
    ]
    assert "3 warnings say what `a.xmi` would lose; add `--lossy` to write the rest" in err
    assert run("convert", "a.xmi", "b.xmi", "-m", "shop.ecore", "--lossy")[0] == 0


def test_annotations_of_a_metamodel_file_are_written(run: Run) -> None:
    Path("m.metamodel").write_text(
        '@annotation("top", a = "b")\n@datatype("Money", instanceClassName = "java.math.BigDecimal")\n'
        "metamodel bank\n"
        '@annotation("kinds") enum Kind { one }\n'
        '@annotation("source", "odd key", "1") @annotation("other") @ecore(instanceClassName = "my.A")\n'
        'class A { @ecore(changeable = "false", eType = "#//Money") float sum @range(0, 9, step = 3) int n }\n'
    )
    assert run("convert", "m.metamodel", "m.ecore") == (0, "")
    before, after = (load_workspace([name]).metamodel for name in ("m.metamodel", "m.ecore"))
    assert before is not None and after is not None
    assert after.class_list == before.class_list
    assert after.enum_types == before.enum_types
    assert after.packages == before.packages
