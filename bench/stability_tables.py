"""Tables of docs/numerics.md: bench/results/stability."""

from __future__ import annotations

from tables import Results, circumstances, load, table

from furcl.report.stability import number


def blank(value: float) -> str:
    """Three digits; nothing for zero."""
    return number(value) if value else ""


def errors(results: Results) -> str:
    """Errors of every quantity and lobe."""
    rows = [
        [
            r["quantity"],
            r["lobe"],
            f"{r['points']:,}",
            str(r["nan"] + r["inf"] + r["negative"]),
            blank(r["max_absolute"]),
            blank(r["max_relative"]),
            f"{r['within_bars'] / r['points']:.3%}" if r["within_bars"] else "",
            blank(r["conditioning"]),
            number(r["excess"]),
        ]
        for r in results["rows"]
    ]
    columns = ["quantity", "lobe", "points", "NaN, inf, < 0", "abs. error", "rel. error"]
    conditioning = "1 ulp of the inputs at the worst point"
    return table([*columns, "within the bars", conditioning, "error / allowed"], rows)


def largest_weights(results: Results) -> str:
    """The largest weight of every lobe and sampler."""
    found = (
        f"{r['quantity'].replace('sample weight', '').strip(' ()') or 'full-cdf'} {r['lobe']} "
        f"{number(r['max_absolute'])}"
        for r in results["rows"]
        if r["quantity"].startswith("sample weight")
    )
    return f"Largest sample weights, mean of the channels: {', '.join(found)}."


def regions(results: Results) -> str:
    """Largest weights by eta and inclination."""
    rows = [
        [
            *(f"{r[name][0]:g} to {r[name][1]:g}" for name in ("eta", "degrees")),
            f"{r['samples']:,}",
            *(number(r[name]) for name in ("weight", "ratio", "bin_ratio")),
        ]
        for r in results["weights"]
    ]
    columns = ["eta", "\\|theta\\| [deg]", "samples", "largest weight", "over the energy"]
    return table([*columns, "float64"], rows)


def renders(results: Results) -> str:
    """Stiff scenes beside the host's renders of them."""
    rows = [
        [
            r["scene"],
            number(r["largest"]),
            str(r["nonfinite"]),
            *(number(r[name]) for name in ("energy", "p", "detects")),
        ]
        for r in results["renders"]
    ]
    columns = ["scene", "largest pixel", "nonfinite", "energy", "p against the host", "bias seen"]
    return table(columns, rows)


def stability() -> str:
    """All tables of a run and how it was made."""
    results = load("stability/results.json")
    points = f"{results['random_points']:,} random points besides the grid."
    parts = [errors, largest_weights, regions, *([renders] if results["renders"] else [])]
    return "\n\n".join([circumstances(results), points, *(part(results) for part in parts)])


def models() -> str:
    """Shorter runs of the other models: the worst lobe of each quantity."""
    found = [load(f"stability-{name}/results.json") for name in MODELS]
    rows = []
    for results in found:
        for quantity in QUANTITIES:
            of = [r for r in results["rows"] if r["quantity"] == quantity]
            if not of:
                continue
            rows.append(
                [
                    results["model"],
                    quantity,
                    f"{sum(r['points'] for r in of):,}",
                    str(sum(r["nan"] + r["inf"] + r["negative"] for r in of)),
                    blank(max(r["max_relative"] for r in of)),
                    number(max(r["excess"] for r in of)) if quantity != LOOKED_AT else "",
                ]
            )
    columns = ["model", "quantity", "points", "NaN, inf, < 0", "rel. error", "error / allowed"]
    return f"{circumstances(*found)}\n\n{table(columns, rows)}"


LOOKED_AT = "looked at"
QUANTITIES = ("attenuation", "evaluate", "pdf", "sample weight", "value over pdf", LOOKED_AT)
MODELS = ("double-cylinder", "yan2015", "chiang", "deon", "marschner", "sadeghi")
TABLES = {"stability": stability, "stability-models": models}
