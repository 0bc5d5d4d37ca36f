"""Tables of bench/overhead.py (docs/performance.md) and bench/unbiased.py (docs/results.md)."""

from __future__ import annotations

import json
from pathlib import Path

from overhead import ALL, PARTS, shown
from tables import FOLDER, Results, circumstances, driver, table


def files(kind: str, folder: Path = FOLDER) -> list[Results]:
    """The results of all runs of a script, by the names of their files."""
    return [json.loads(path.read_text()) for path in sorted((folder / kind).glob("*.json"))]


def overhead(folder: Path = FOLDER) -> str:
    """Processor seconds beyond those of a plain render, in percent."""
    names = [*PARTS, ALL]
    rows = [
        [driver(results), scene["scene"], f"{scene['seconds']:.2f}"]
        + [shown(scene["ratios"][name]) for name in names]
        for results in files("overhead", folder)
        for scene in results["scenes"]
    ]
    columns = ["driver", "scene", "plain render, s", *(f"{name}, %" for name in names)]
    return table(columns, rows)


def unbiased(folder: Path = FOLDER) -> str:
    """Of every light and scene the largest |z| of all variants, and how far they are off."""
    rows = []
    for results in files("unbiased", folder):
        found: dict[tuple[str, str], list[Results]] = {}
        for row in results["results"]:
            found.setdefault((row["light"], row["scene"]), []).append(row)
        for (light, scene), variants in found.items():
            worst = max(variants, key=lambda row: abs(row["whole"]))
            rows.append(
                [
                    light,
                    scene,
                    f"{len(variants)}",
                    f"{max(row['blocks'] for row in variants):.2f}",
                    f"{worst['whole']:.2f}",
                    f"{100.0 * worst['relative']:+.2f} +- {100.0 * worst['error']:.2f}",
                    f"{results['bound']:.2f}",
                ]
            )
    columns = [
        "light",
        "scene",
        "variants",
        "largest z of blocks",
        "of wholes",
        "of it, %",
        "bound",
    ]
    return table(columns, rows)


PERFORMANCE = {
    "overhead": overhead,
    "overhead-circumstances": lambda: circumstances(*files("overhead")),
}
RESULTS = {
    "unbiased": unbiased,
    "unbiased-circumstances": lambda: circumstances(*files("unbiased")),
}
