"""Table of docs/results.md at the paper's numbers of samples: bench/results/paper-spp."""

from __future__ import annotations

from pathlib import Path

from convergence_tables import FIBRES
from tables import FOLDER, circumstances, driver, runs, table

from furcl.fibre.double_cylinder import paper
from furcl.report.convergence import interval, number
from furcl.report.convergence_schema import upgraded

KIND = "paper-spp"
ORDER = list(FIBRES)


def ratios(folder: Path = FOLDER) -> str:
    """RMSE over that of uniform-h at each number of samples beside the paper's, by device."""
    found = [upgraded(results) for results in runs(KIND, folder)]
    found.sort(key=lambda r: (r["device"]["platform"], ORDER.index(r["scenes"][0]["name"])))
    rows = []
    for results in found:
        (scene,) = results["scenes"]
        label, theirs = paper.RMSE_RATIOS[FIBRES[scene["name"]]]
        errors = {
            (variant["name"], at["spp"]): at["rmse"]["mean"]
            for variant in scene["variants"]
            for at in variant["spp"]
        }
        (compared,) = scene["comparisons"]
        for same, equal in zip(compared["same_spp"], compared["equal_time"], strict=True):
            spp = same["spp"]
            rows.append(
                [
                    scene["name"],
                    driver(results),
                    f"{spp}",
                    number(errors[compared["baseline"], spp]),
                    interval(same["rmse_ratio"]),
                    interval(equal["rmse_ratio"]),
                    f"{label}: {theirs[spp]}" if spp in theirs else "",
                ]
            )
    columns = ["scene", "device", "spp", "RMSE of uniform-h", "at equal spp", "at equal time"]
    return table([*columns, "paper"], rows)


TABLES = {
    "paper-spp": ratios,
    "paper-spp-circumstances": lambda: circumstances(*runs(KIND)),
}
