"""Table of docs/results.md about the paper's scenes at their size: bench/results/paper-size."""

from __future__ import annotations

from pathlib import Path

from tables import FOLDER, circumstances, driver, runs, table

from furcl.report.convergence import interval

KIND = "paper-size"


def gains(folder: Path = FOLDER) -> str:
    """Efficiency over the conventional renderer at each number of samples, by device."""
    rows = []
    for results in runs(KIND, folder):
        for scene in results["scenes"]:
            errors = {
                (variant["name"], at["spp"]): at["rmse"]["mean"]
                for variant in scene["variants"]
                for at in variant["spp"]
            }
            for found in scene["comparisons"]:
                for at in found["same_spp"]:
                    spp = at["spp"]
                    rows.append(
                        [
                            driver(results),
                            scene["name"],
                            found["variant"],
                            f"{spp}",
                            f"{errors[found['baseline'], spp]:.3g}",
                            f"{errors[found['variant'], spp]:.3g}",
                            interval(at["efficiency"]),
                            interval(at["efficiency_rays"]),
                        ]
                    )
    columns = ["device", "scene", "variant", "spp", "RMSE of the baseline", "RMSE", "efficiency"]
    return table([*columns, "by rays"], rows)


TABLES = {
    "paper-size": gains,
    "paper-size-circumstances": lambda: circumstances(*runs(KIND)),
}
