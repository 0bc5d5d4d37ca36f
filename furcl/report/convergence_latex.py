"""The summary of a convergence run as a LaTeX table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from furcl.files import atomic_path

_LETTERS = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{letter: f"\\{letter}" for letter in "&%$#_{}"},
}
_HEAD = r"""% \usepackage{booktabs}
\begin{tabular}{@{}llrrrrrr@{}}
\toprule
Scene & Variant & spp & Time [s] & RMSE & median & at equal time & efficiency \\
\midrule
"""
_FOOT = r"""\bottomrule
\end{tabular}
"""


def latex_table(scenes: Sequence[Mapping[str, Any]], marked: Mapping[tuple[str, str], Any]) -> str:
    """Rows of all variants at their largest number of samples.

    RMSE with half of its 95 % interval and the median of its runs; ratios to the baseline as means
    with their intervals. Variants that are `marked` as of another picture are so called.
    """
    parts = []
    for scene in scenes:
        found = {row["variant"]: row for row in scene["comparisons"]}
        rows = []
        for variant in scene["variants"]:
            if not variant["spp"]:
                continue
            cell, ratios = variant["spp"][-1], ["--", "--"]
            if row := found.get(variant["name"]):
                ratios = [_interval(row["equal_time"][-1]["rmse_ratio"])]
                ratios.append(_interval(row["efficiency"]))
            name = escaped(variant["name"])
            if (scene["name"], variant["name"]) in marked:
                name += " (another picture)"
            rows.append(
                [
                    escaped(scene["name"]) if not rows else "",
                    name,
                    str(cell["spp"]),
                    _number(cell["seconds"]["mean"]),
                    _plus_minus(cell["rmse"]),
                    _number(cell["rmse"].get("median")),
                    *ratios,
                ]
            )
        parts.append("".join(f"{' & '.join(row)} \\\\\n" for row in rows))
    return _HEAD + "\\midrule\n".join(parts) + _FOOT


def write_latex(
    scenes: Sequence[Mapping[str, Any]], marked: Mapping[tuple[str, str], Any], path: Path
) -> Path:
    """Write the table, whole or not at all; it needs the package booktabs."""
    with atomic_path(path) as temporary:
        temporary.write_text(latex_table(scenes, marked), encoding="utf-8")
    return path


def escaped(text: str) -> str:
    """Text whose letters mean themselves to LaTeX."""
    return "".join(_LETTERS.get(letter, letter) for letter in text)


def _number(value: float | None, digits: int = 3) -> str:
    """With that many significant digits; powers of ten as LaTeX has them."""
    if value is None:
        return "--"
    mantissa, _, exponent = f"{value:#.{digits}g}".rstrip(".").partition("e")
    return rf"${mantissa}\cdot 10^{{{int(exponent)}}}$" if exponent else mantissa


def _plus_minus(estimate: Mapping[str, Any]) -> str:
    mean = _number(estimate["mean"])
    if estimate["low"] is None:
        return mean
    return rf"{mean} $\pm$ {_number(0.5 * (estimate['high'] - estimate['low']), 2)}"


def _interval(estimate: Mapping[str, Any]) -> str:
    mean = _number(estimate["mean"])
    if estimate["low"] is None:
        return mean
    return f"{mean} [{_number(estimate['low'])}, {_number(estimate['high'])}]"
