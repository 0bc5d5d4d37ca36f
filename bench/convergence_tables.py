"""Tables of docs/results.md: bench/results/convergence, beside what the paper prints."""

from __future__ import annotations

from tables import FOLDER, Results, circumstances, runs, table
from tables import load as load_json

from furcl import bcsdf
from furcl.fibre.double_cylinder import paper
from furcl.report.convergence import interval, number, share
from furcl.report.convergence_schema import upgraded

# The preset whose fibre, fitted to the paper's lobe shares, is in a scene.
FIBRES = {"black_hair": "human-black", "white_hair": "human-white", "raccoon": "raccoon"}


def load(name: str) -> Results:
    """A run of `furcl bench convergence` by its path in FOLDER."""
    return upgraded(load_json(name))


def scenes() -> Results:
    """The run of the paper's three scenes."""
    return load("convergence/scenes/results.json")


def ratios() -> str:
    """RMSE over that of uniform-h at the largest number of samples: ours and the paper's."""
    rows = []
    for scene in scenes()["scenes"]:
        label, theirs = paper.RMSE_RATIOS[FIBRES[scene["name"]]]
        text = ", ".join(f"{ratio} ({spp} spp)" for spp, ratio in theirs.items())
        for found in scene["comparisons"]:
            rows.append(
                [
                    scene["name"],
                    found["variant"],
                    interval(found["same_spp"][-1]["rmse_ratio"]),
                    interval(found["equal_time"][-1]["rmse_ratio"]),
                    f"{label}: {text}" if found["variant"] == "attenuation-cdf" else "",
                ]
            )
    spp = scenes()["plan"]["spp"][-1]
    columns = ["scene", "sampler", f"equal spp, {spp}", f"equal time, {spp} spp", "paper"]
    return table(columns, rows)


def overall() -> str:
    """Efficiency over all sample counts, slope, rays a path and time."""
    rows = []
    for scene in scenes()["scenes"]:
        found = {c["variant"]: c for c in scene["comparisons"]}
        for sampler in scene["variants"]:
            last = sampler["spp"][-1]
            efficiency = found[sampler["name"]]["efficiency"] if sampler["name"] in found else None
            rows.append(
                [
                    scene["name"],
                    sampler["name"],
                    number(last["seconds"]["mean"]),
                    interval(last["rmse"]),
                    interval(efficiency) if efficiency else "1",
                    interval(sampler["slope"]),
                    number(sampler["path_length"]),
                    interval(last["mse_over_variance"]),
                ]
            )
    spp = scenes()["plan"]["spp"][-1]
    return table(
        [
            "scene",
            "sampler",
            f"time [s], {spp} spp",
            f"RMSE, {spp} spp",
            "efficiency",
            "slope",
            "rays a path",
            "MSE over own variance",
        ],
        rows,
    )


def lobes() -> str:
    """Shares of the chosen lobes beside the paper's."""
    rows = []
    for scene in scenes()["scenes"]:
        ours = {s["name"]: s["lobes"]["shares"] for s in scene["variants"]}
        fibre = FIBRES[scene["name"]]
        theirs = zip(paper.CONVENTIONAL_LOBE_SHARES[fibre], paper.LOBE_SHARES[fibre], strict=True)
        for lobe, (conventional, proposed) in zip(bcsdf.LOBES, theirs, strict=True):
            rows.append(
                [
                    scene["name"],
                    lobe,
                    share(ours["uniform-h"][lobe]),
                    f"{conventional:.3g} %",
                    share(ours["attenuation-cdf"][lobe]),
                    f"{proposed:.3g} %",
                ]
            )
    columns = ["scene", "lobe", "uniform-h", "paper", "attenuation-cdf", "paper"]
    return table(columns, rows)


def others() -> str:
    """The runs in other light and of one fibre."""
    rows = []
    for folder in sorted(path.parent for path in FOLDER.glob("convergence/*/results.json")):
        if folder.name == "scenes":
            continue
        for found in load(f"convergence/{folder.name}/results.json")["scenes"][0]["comparisons"]:
            rows.append(
                [
                    folder.name,
                    found["variant"],
                    interval(found["same_spp"][-1]["rmse_ratio"]),
                    interval(found["equal_time"][-1]["rmse_ratio"]),
                    interval(found["efficiency"]),
                ]
            )
    return table(["run", "sampler", "equal spp", "equal time", "efficiency"], rows)


TABLES = {
    "circumstances": lambda: circumstances(*runs("convergence")),
    "ratios": ratios,
    "overall": overall,
    "lobes": lobes,
    "others": others,
}
