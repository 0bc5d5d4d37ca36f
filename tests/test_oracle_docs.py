"""The examples of docs/oracle.md, run as they stand: outputs as printed, in one session."""

import doctest
from importlib import import_module
from pathlib import Path

import pytest
from model_checks import check_reference

from furcl.device.choice import Device
from furcl.fibre import model

PAGE = Path(__file__).parents[1] / "docs" / "oracle.md"


def _examples(text: str) -> doctest.DocTest:
    """All blocks of Python, with blank lines where other text stands, so that lines keep their
    numbers."""
    kept, inside = [], False
    for line in text.splitlines():
        inside = line == "```python" or (inside and line != "```")
        kept.append(line if inside and not line.startswith("```") else "")
    return doctest.DocTestParser().get_doctest("\n".join(kept), {}, PAGE.name, str(PAGE), 0)


def _failures(text: str) -> tuple[int, list[str]]:
    """How many examples failed, and what was reported."""
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS, verbose=False)
    report: list[str] = []
    return runner.run(_examples(text), out=report.append).failed, report


def test_examples(device: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every output is as printed; with one digit changed it is not."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("furcl.rendering.probe.open_device", lambda _: device)
    text = PAGE.read_text()
    failed, report = _failures(text)
    assert failed == 0, "".join(report)
    assert (tmp_path / "raccoon.npz").exists()
    assert text.count("0.76\n") == 1
    assert _failures(text.replace("0.76\n", "0.77\n"))[0] == 1


@pytest.mark.parametrize("name", model.names())
def test_signatures(name: str) -> None:
    """The functions of every model's reference have the arguments that the page lists."""
    check_reference(import_module(model.find(name).reference))
