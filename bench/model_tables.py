"""Tables of docs/model.md: ranges, presets, their lobe shares, and the model beside brute force."""

from __future__ import annotations

from collections.abc import Sequence

from tables import circumstances, load, table

from furcl import bcsdf
from furcl.fibre.double_cylinder.paper import LOBE_SHARES
from furcl.fibre.double_cylinder.parameters import RANGES, Fibre

DEGREES = (0, 60)  # inclinations of the table of limits


def value(found: float | Sequence[float]) -> str:
    """One number, or three that are not all equal."""
    numbers = dict.fromkeys(found if isinstance(found, Sequence) else (found,))
    return ", ".join(f"{number:.4g}" for number in numbers)


def presets() -> str:
    """What is allowed for every parameter, and its value in every preset."""
    allowed = [f"{low:.6g} to {high:.6g}" for low, high in RANGES.values()]
    rows = [["*allowed*", *allowed], ["*default*", *values(Fibre())]]
    rows += [[name, *values(Fibre.preset(name))] for name in Fibre.preset_names()]
    return table(["preset", *RANGES], rows)


def values(fibre: Fibre) -> list[str]:
    """The parameters of a fibre, in the order of RANGES."""
    return [value(getattr(fibre, name)) for name in RANGES]


def provenance() -> str:
    """Where the numbers of every preset come from."""
    return "\n".join(f"* {name}: {Fibre.preset(name).provenance}" for name in Fibre.preset_names())


def shares() -> str:
    """Lobe shares of presets, and the paper's below them."""
    rows = []
    for name, found in load("medulla_tables.json")["presets"].items():
        rows.append([name, *(f"{100 * found['lobe_shares'][lobe]:.3g} %" for lobe in bcsdf.LOBES)])
        if name in LOBE_SHARES:
            rows.append(["in the paper", *(f"{share:.3g} %" for share in LOBE_SHARES[name])])
    return table(["preset", *bcsdf.LOBES], rows)


def limits() -> str:
    """Energies and shapes of the scattered lobes, truth / model."""
    results = load("fibre_truth.json")
    rows = []
    for name, inclinations in results["results"].items():
        for r in inclinations:
            if r["theta_deg"] not in DEGREES:
                continue
            truth, shape = r["truth"], r["shape"]
            rows.append(
                [
                    name,
                    f"{r['theta_deg']:g}",
                    f"{100 * r['unscattered_worst']:.3f} %",
                    f"{truth['TTs']:.4f} / {r['model']['TTs']:.4f}",
                    f"{r['truth_albedo']:.4f} / {r['model_albedo']:.4f}",
                    f"{100 * r['truth_direct']['TTs'] / truth['TTs']:.0f} %",
                    f"{shape['truth']['mean_s']:+.3f} / {shape['model']['mean_s']:+.3f}",
                    f"{shape['distance']:.3f}",
                ]
            )
    columns = [
        "preset", "theta", "R, TT, TRT differ by", "TTs", "albedo", "leaves at its first arrival",
        "mean s", "distance of the distributions",
    ]  # fmt: skip
    how = f"`{results['command']}`, {results['photons']:,} photons a row."
    return f"{table(columns, rows)}\n\n{how}"


def reciprocity() -> str:
    """How far presets are from reciprocal, by lobe, and what the half difference angle changes."""
    results = load("reciprocity.json")
    rows = []
    for name, found in results["presets"].items():
        for lobe, row in found.items():
            energy = f"{row['energy']:.3f}" if "energy" in row else ""
            variance = f"{row['variance']:.4f}" if "variance" in row else ""
            share = f"{100 * row['share']:.3g} %"
            rows.append([name, lobe, share, f"{100 * row['apart']:.1f} %", energy, variance])
    columns = ["preset", "lobe", "of its light", "apart", "energy", "variance of weights"]
    how = f"`{results['command']}`, {results['pairs']:,} pairs of directions a preset."
    return f"{table(columns, rows)}\n\n{how}"


TABLES = {
    "presets": presets,
    "provenance": provenance,
    "shares": shares,
    "shares-circumstances": lambda: circumstances(load("medulla_tables.json")),
    "limits": limits,
    "reciprocity": reciprocity,
}
