"""Each benchmark runs with tiny sizes; `python -m benchmarks` names those that fail and lists those that exist."""

import gc
import sys

import pytest

from benchmarks import bench_philosophers
from benchmarks.__main__ import available, main
from tests.profile import NIGHTLY


@pytest.fixture(autouse=True)
def _frozen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Freeze what is alive, and let no benchmark unfreeze it: they collect garbage often."""
    gc.freeze()
    monkeypatch.setattr(gc, "unfreeze", lambda: None)


@pytest.mark.parametrize("name", available())
def test_each_benchmark_runs_in_its_quick_form(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    if name in ("compiled", "growth", "samples", "train") and not NIGHTLY:
        pytest.skip("takes long: `make nightly`")
    assert main(["--quick", name]) == 0, capfd.readouterr().err
    assert capfd.readouterr().out.count("\n") > 4


@pytest.mark.parametrize("error", [TypeError("no measure"), SystemExit("no measure")])
def test_failed_benchmarks_are_named_at_the_end_and_other_benchmarks_run(
    error: BaseException, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_: object) -> None:
        raise error

    monkeypatch.setattr(bench_philosophers, "main", fail)
    assert main(["--quick", "philosophers", "sierpinski"]) == 1
    out, err = capsys.readouterr()
    assert "prepared/CLIPS" in out.partition("== sierpinski")[2]
    assert err.endswith(f"\nphilosophers failed: {type(error).__name__}: no measure\n")


@pytest.mark.parametrize("name, package", [("mutation", "clipspy"), ("teaching", "numba")])
def test_a_benchmark_says_which_package_is_not_installed(
    name: str, package: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, {"clipspy": "clips"}.get(package, package), None)
    assert main(["--quick", name]) == 0
    assert f"not installed, so left out: {package} (pip install {package})\n" in capsys.readouterr().out


def test_help_describes_each_benchmark(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    assert all(line and f"  {name:14}{line}\n" in text for name, line in available().items())


def test_a_wrong_name_gets_a_hint_and_the_list(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["match", "sampels", "xyz"])
    assert stop.value.code == 2
    err = capsys.readouterr().err
    assert err.startswith(
        "there is no benchmark `sampels`; did you mean `samples`?\nthere is no benchmark `xyz`\nbenchmarks:\n"
    )
    assert all(f"  {name} " in err for name in available())
