"""Pages are made anew from the results that are kept."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from furcl.bench import stability, stability_steps, stability_subjects
from furcl.bench.stability_compare import BARS, Comparison
from furcl.cli.bench import app
from furcl.errors import BenchError
from furcl.report.pages import write_pages
from furcl.report.stability import write_report

RESULTS = Path(__file__).parents[1] / "bench" / "results"


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    """Results of three benchmarks, two of which have pages."""
    if not RESULTS.is_dir():
        pytest.skip("bench/ is not in a source distribution")
    for name in ("stability", "convergence/single-fibre-raccoon", "start/portable"):
        (tmp_path / name).mkdir(parents=True)
        shutil.copy(RESULTS / name / "results.json", tmp_path / name)
    return tmp_path


def test_pages_of_all_results_in_a_folder(kept):
    pages = write_pages(kept)
    folders = ("convergence/single-fibre-raccoon", "stability")
    assert pages == [kept / folder / "index.html" for folder in folders]
    assert not (kept / "start" / "portable" / "index.html").exists()
    text = pages[0].read_text()
    assert "attenuation-cdf" in text
    assert text.count("data:image/svg+xml;base64,") == 1
    assert "data:image/png" not in text  # no crops without the images of the run
    assert pages[1].read_text().count("<svg") == 1


def test_the_command_names_the_pages(kept):
    result = CliRunner().invoke(app, ["report", str(kept / "stability")])
    assert result.stdout.split() == [str(kept / "stability" / "index.html")]


def test_runs_without_the_scene_are_passed_over(kept):
    there = kept / "convergence" / "single-fibre-raccoon"
    other = kept / "convergence" / "other"
    other.mkdir()
    text = (there / "results.json").read_text()
    (name,) = {scene["name"] for scene in json.loads(text)["scenes"]}
    (other / "results.json").write_text(text.replace(f'"{name}"', '"another"'))
    command = ["report", str(other), str(there), "--scene", name]
    said = CliRunner().invoke(app, command)
    assert said.stdout.split() == [str(there / "index.html")]
    with pytest.raises(BenchError, match="scene 'none': not in the results; allowed are another"):
        write_pages(other, there, scenes=["none"])


@pytest.mark.parametrize("text", [None, '{"schema": "other-1"}'])
def test_nothing_to_make_a_page_of_is_an_error(tmp_path, text):
    if text:
        (tmp_path / "results.json").write_text(text)
    with pytest.raises(BenchError, match="holds no results of `furcl bench convergence`"):
        write_pages(tmp_path)


@pytest.mark.parametrize("text", ["{", "[]"])
def test_damaged_results_are_an_error(tmp_path, text):
    (tmp_path / "results.json").write_text(text)
    with pytest.raises(BenchError, match=r"results\.json: cannot be read"):
        write_pages(tmp_path)


@pytest.mark.parametrize("model", stability_subjects.names())
def test_every_parameter_of_a_model_is_on_its_page(tmp_path, monkeypatch, model):
    """Numbers, colours, switches and text: all that the grid of a sweep moves to its edges."""

    def nothing_found(self, *_, **__):
        for quantity in BARS:
            self.row(quantity, "R")

    monkeypatch.setattr(Comparison, "add", nothing_found)
    monkeypatch.setattr(stability_steps, "OWN_ROWS", {})
    subject = stability_subjects.find(model)
    stability.run(tmp_path, n_points=1, renders=False, subject=subject)
    page = write_report(tmp_path).read_text()
    for name, value, _ in subject.grid():
        assert f"<!-- {name} -->" in page
        if isinstance(value, str | bool):
            assert f"<!-- {value} -->" in page
