"""The table of docs/view.md: from a change to the first picture."""

from __future__ import annotations

import numpy as np
from tables import circumstances, load, table

RESULTS = "view_latency.json"


def seconds() -> str:
    """Median and 95th percentile of each kind of change, by scene."""
    scenes = load(RESULTS)["scenes"]
    rows = []
    for kind in scenes[0]["seconds"]:
        spans = [np.quantile(scene["seconds"][kind], (0.5, 0.95)) for scene in scenes]
        rows.append([kind, *(f"{middle:.2f} ({high:.2f})" for middle, high in spans)])
    return table(["change", *(scene["scene"] for scene in scenes)], rows)


def source() -> str:
    """The command behind it, and what it measured."""
    found = load(RESULTS)
    return f"{circumstances(found)}\n\n{found['changes']} changes of each kind."


TABLES = {"view-latency": seconds, "view-latency-source": source}
