"""Tables of docs/model.md about simulated scattering: beside brute force, and in a furnace."""

from __future__ import annotations

from tables import circumstances, load, table

TRUTH = "simulated_truth.json"
WAYS = ("model", "simulated")


def truth() -> str:
    """Albedos and distances of both ways by preset and inclination."""
    rows = []
    for name, found in load(TRUTH)["results"].items():
        for row in found["rows"]:
            true, own = row["truth_albedo"], row["simulated"]
            rows.append(
                [
                    name,
                    f"{row['theta_deg']:g}",
                    f"{true:.4f} +- {row['truth_error']:.4f}",
                    f"{own['albedo']:.4f} ({100 * (own['albedo'] / true - 1):+.2f} %)",
                    f"{100 * (row['model']['albedo'] / true - 1):+.1f} %",
                    f"{own['distance']:.4f}",
                    f"{row['noise']:.4f}",
                    f"{row['model']['distance']:.3f}",
                ]
            )
    columns = ["preset", "theta", "true albedo", "simulated", "model", "distance", "noise of truth"]
    return table([*columns, "distance, model"], rows)


def truth_source() -> str:
    """The command behind `truth` and `furnace`, and its photons."""
    found = load(TRUTH)
    return f"{circumstances(found)}\n\n{found['photons']:,} photons a row."


def furnace() -> str:
    """White fibres in white light, and what tables take, by preset."""
    rows = []
    for name, found in load(TRUTH)["results"].items():
        light = (found["furnace"][way] for way in WAYS)
        tables = found["tables"]
        rows.append(
            [
                name,
                *(f"{one['mean']:.4f} +- {one['error']:.4f}" for one in light),
                f"{tables['bytes'] / 2**20:.2f}",
                f"{100 * tables['relative_error']:.2f} %",
            ]
        )
    columns = ["preset", "furnace, model", "furnace, simulated", "tables [MiB]", "error of a row"]
    return table(columns, rows)


TABLES = {
    "simulated": truth,
    "simulated-source": truth_source,
    "simulated-furnace": furnace,
}
