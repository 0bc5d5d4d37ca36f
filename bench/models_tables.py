"""Table of docs/models/index.md: bench/results/models."""

from __future__ import annotations

from tables import circumstances, load, table

KEPT = ("R", "TT", "TRT")


def side_by_side() -> str:
    """Cost, energy and shares of every model, and how they were measured."""
    results = load("models/results.json")
    rows = []
    least = min(row["ns_a_hit"] for row in results["models"].values())
    for name, row in results["models"].items():
        shares = row["shares"]
        rest = sum(share for lobe, share in shares.items() if lobe not in KEPT)
        rows.append(
            [
                f"`{name}`",
                f"{row['ns_a_hit']:.0f}",
                f"{row['ns_a_hit'] / least:.2f}",
                *(f"{albedo:.3f}" for albedo in row["albedos"]),
                *(f"{shares[lobe]:.1%}" for lobe in KEPT),
                f"{rest:.1%}",
            ]
        )
    columns = ["model", "ns a hit", "over the least", "white at 0 deg", "white at 60 deg"]
    return f"{circumstances(results)}\n\n{table([*columns, *KEPT, 'others'], rows)}"


TABLES = {"models": side_by_side}
