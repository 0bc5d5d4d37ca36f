"""Table of docs/model.md: bench/results/near_far."""

from __future__ import annotations

from tables import circumstances, runs, table


def near_far() -> str:
    """Near and multiscale pictures over the far one, and how they were measured."""
    found = runs("near_far")
    rows = [
        [
            ", ".join([row["scene"], *row.get("changes", [])]),
            row["mode"],
            f"{100.0 * row['difference']:+.2f} +- {100.0 * row['half_interval']:.2f}",
            f"{row['blocks']:,}",
            f"{row['largest_z']:.1f}",
        ]
        for results in found
        for row in results["rows"]
    ]
    columns = ["scene", "mode", "mean over the far one, %", "pixels", "largest z"]
    return f"{circumstances(*found)}\n\n{table(columns, rows)}"


TABLES = {"near-far": near_far}
