"""Figures and tables for papers, and what the page marks."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from typer.testing import CliRunner

from furcl.bench.convergence_statistics import Curve, compare_curves, mean_interval
from furcl.cli.bench import app
from furcl.errors import BenchError
from furcl.report import convergence_plots as plots
from furcl.report.convergence import skewed, write_report
from furcl.report.convergence_figure import WIDTHS, paper_figure
from furcl.report.convergence_latex import escaped, latex_table

KEPT = Path(__file__).parents[1] / "bench" / "results" / "convergence" / "scenes" / "results.json"
SPP, RUNS = (16, 64), 5
NAMES = ("uniform-h", "a sampler with quite a long name", "b_2 & 50 % of $c$")


def made_scene(name: str, rng: np.random.Generator, bright: bool = False) -> dict:
    """Errors of three variants; of the last one run in five is ten times as bright."""
    curves = {}
    for index, variant in enumerate(NAMES):
        spp = np.array(SPP, float)
        noise = np.exp(rng.normal(0.0, 0.01, (RUNS, len(SPP))))
        rmse = (1.0 + index) / np.sqrt(spp) * noise
        if bright and index == 2:
            rmse[0] *= 10.0
        curves[variant] = Curve(spp, 0.01 * spp * noise, rmse, 1e6 * spp * noise)
    variants = [
        {
            "name": variant,
            "spp": [
                {
                    "spp": spp,
                    "runs": RUNS,
                    "seconds": mean_interval(curve.seconds[:, k]).as_dict(),
                    "rmse": mean_interval(curve.rmse[:, k]).as_dict(),
                    "relmse": mean_interval(curve.rmse[:, k] ** 2).as_dict(),
                    "flip": mean_interval(0.1 * curve.rmse[:, k]).as_dict(),
                }
                for k, spp in enumerate(SPP)
            ],
        }
        for variant, curve in curves.items()
    ]
    base = NAMES[0]
    comparisons = [
        {"variant": n, "baseline": base, **compare_curves(curves[n], curves[base])}
        for n in NAMES[1:]
    ]
    return {"name": name, "variants": variants, "comparisons": comparisons}


@pytest.mark.parametrize(
    ("metric", "width", "n_scenes"),
    [("rmse", "column", 2), ("flip", "full", 1), ("rmse", "full", 4)],
)
def test_nothing_of_a_figure_is_cut_off(rng, metric, width, n_scenes):
    """All letters that are drawn lie on the figure, which has the width of the column or page."""
    scenes = [made_scene(f"scene {i}", rng) for i in range(n_scenes)]
    figure = paper_figure(scenes, metric, width)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    assert figure.get_size_inches()[0] == WIDTHS[width]
    inside = figure.bbox.padded(1.0)
    texts = [t for t in figure.findobj(plots.Text) if t.get_text() and t.get_visible()]
    assert len(texts) > 10
    for text in texts:
        box = text.get_window_extent(canvas.get_renderer())
        assert inside.contains(box.x0, box.y0), text
        assert inside.contains(box.x1, box.y1), text


@pytest.mark.parametrize(("metric", "slope"), [("rmse", -0.5), ("relmse", -1.0), ("flip", None)])
def test_the_guide_has_the_slope_of_independent_samples(rng, metric, slope):
    scene = made_scene("scene", rng)
    axes = paper_figure([scene], metric, "column").axes[0]
    dotted: list[Any] = [line for line in axes.lines if line.get_linestyle() == ":"]
    if slope is None:
        assert not dotted
        return
    (x0, y0), (x1, y1) = dotted[0].get_xydata()
    assert np.log(y1 / y0) / np.log(x1 / x0) == pytest.approx(slope)
    curves = [cell[metric]["mean"] for v in scene["variants"] for cell in v["spp"]]
    assert y0 > max(curves)  # it crosses no curve


@pytest.mark.parametrize("bright", [False, True])
def test_medians_are_drawn_where_one_run_lifts_the_mean(rng, bright):
    scene = made_scene("scene", rng, bright)
    axes = paper_figure([scene], "rmse", "column").axes[0]
    hollow = [line for line in axes.lines if line.get_markerfacecolor() == "none"]
    points = np.concatenate([np.asarray(line.get_ydata(), float) for line in hollow])
    assert len(points) == (len(SPP) if bright else 0)
    assert skewed(scene) == ([NAMES[2]] if bright else [])
    if bright:
        assert points == pytest.approx(3.0 / np.sqrt(SPP), rel=0.05)


def test_the_table_is_latex(rng):
    """Of as many columns in every row, letters escaped, with what the results say."""
    scenes = [made_scene("a_1", rng), made_scene("b", rng)]
    table = latex_table(scenes, {("a_1", NAMES[1]): ["mean"]})
    rows = [line for line in table.splitlines() if line.endswith(r"\\")]
    assert len(rows) == 1 + 2 * len(NAMES)
    assert {len(re.findall(r"(?<!\\)&", row)) for row in rows} == {7}
    assert r"a\_1 & uniform-h & 64 & 0.6" in table
    assert r"b\_2 \& 50 \% of \$c\$" in table
    assert table.count("(another picture)") == 1
    assert f"{scenes[0]['variants'][1]['spp'][-1]['rmse']['mean']:.3g}" in rows[2]
    assert escaped("\\~^") == r"\textbackslash{}\textasciitilde{}\textasciicircum{}"


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    """A folder of kept results, one variant of which loses 4 % of the light."""
    if not KEPT.exists():
        pytest.skip("bench/ is not in a source distribution")
    results = json.loads(KEPT.read_text())
    scene = results["scenes"][0]
    for cell in scene["samplers"][1]["spp"]:
        for end in ("mean", "low", "high"):
            cell["mean_over_reference"][end] -= 0.04
    (tmp_path / "results.json").write_text(json.dumps(results))
    return tmp_path


def test_the_row_of_a_sampler_that_loses_light_is_red(kept):
    page = write_report(kept, metrics=("relmse",), scenes=("raccoon",)).read_text()
    summary = page[page.index("<h2>Summary</h2>") : page.index("</table>")]
    rows = re.findall(r'<tr class="wrong" title="([^"]*)"><td>(\w+)</td><td>([\w-]+)', summary)
    assert [row[1:] for row in rows] == [("black_hair", "attenuation-cdf")]
    assert rows[0][0].startswith("mean radiance over that of the reference 0.96")
    written = {path.name for path in (kept / "plots").iterdir()}
    paper = {f"relmse-{w}{s}" for w in WIDTHS for s in (".pdf", ".svg", ".png")}
    assert written == paper | {"table.tex"} | {
        f"{scene}-relmse{s}"
        for scene in ("black_hair", "white_hair", "raccoon")
        for s in (".pdf", ".svg", ".png")
    }  # fmt: skip
    table = (kept / "plots" / "table.tex").read_text()
    assert "raccoon" in table
    assert "white" not in table


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"metrics": ("mse",)}, "metric 'mse': not in the results; allowed are rmse, relmse, flip"),
        ({"scenes": ("hair",)}, "scene 'hair': not in the results; allowed are black_hair"),
        ({"metrics": ()}, "metric ''"),
    ],
)
def test_what_is_not_in_the_results_is_refused(kept, options, message):
    with pytest.raises(BenchError, match=message):
        write_report(kept, **options)
    assert not (kept / "plots").exists()


def test_the_terminal_prints_the_row_red(kept, monkeypatch):
    """Of a run that is replaced by kept results; typer's colours are on for the test."""
    from furcl.bench import convergence
    from furcl.report.convergence_schema import upgraded

    results = upgraded(json.loads((kept / "results.json").read_text()))
    monkeypatch.setattr(convergence, "run", lambda *_, **__: results)
    monkeypatch.setattr("furcl.report.convergence.write_report", lambda *_, **__: kept)
    command = ["convergence", "black_hair", "-o", str(kept)]
    output = CliRunner().invoke(app, command, color=True).output
    red = re.findall("\x1b\\[31m([^\x1b]*)\x1b", output)
    assert len(red) == 2
    assert red[0].startswith("black_hair: RMSE of attenuation-cdf at equal time")
    assert red[1].startswith("black_hair: attenuation-cdf makes another picture")
