"""Tables of docs/model.md about simulated scattering: beside brute force, in a furnace, in
pictures, and what it costs."""

from __future__ import annotations

from typing import Any

from tables import circumstances, load, table

TRUTH, PICTURES, COST = "simulated_truth.json", "scattering.json", "scattering_cost.json"
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


def pictures() -> str:
    """Light of the fur, simulated over published, and what pictures and tables cost."""
    seen, cost = load(PICTURES)["scenes"], load(COST)["scenes"]
    rows = []
    for name, found in seen.items():
        ways = [found[way] for way in WAYS]
        errors = [max(e / r for e, r in zip(w["error"], w["radiance"], strict=True)) for w in ways]
        pictures, tables = cost[name]["pictures"], cost[name]["tables"]
        rows.append(
            [
                name,
                ", ".join(f"{ratio:.3f}" for ratio in found["simulated_over_model"]),
                f"{100 * sum(e * e for e in errors) ** 0.5:.2f} %",
                _median(pictures["processor_time"]),
                f"{pictures['rays']:.3f}",
                _median(pictures["time_of_a_ray"]),
                " / ".join(f"{tables['processor_seconds'][way]:.1f}" for way in reversed(WAYS)),
                " / ".join(f"{tables['bytes'][way] / 2**20:.2f}" for way in reversed(WAYS)),
            ]
        )
    columns = ["scene", "light, red, green, blue", "its error", "processor time", "rays"]
    columns += ["processor time of a ray", "making tables [processor s]", "tables [MiB]"]
    return table(columns, rows)


def _median(found: dict[str, Any]) -> str:
    return f"{found['median']:.2f} [{found['low']:.2f}, {found['high']:.2f}]"


TABLES = {
    "simulated": truth,
    "simulated-source": truth_source,
    "simulated-furnace": furnace,
    "scattering": pictures,
    "scattering-source": lambda: circumstances(load(PICTURES), load(COST)),
}
