"""Write the tables of docs/ anew from bench/results and the presets, between their marks.

python bench/docs_tables.py [DOCUMENT...]       all documents, or those named: performance.md
"""

from __future__ import annotations

import sys
from pathlib import Path

import check_tables
import convergence_tables
import gpu_tables
import intersect_tables
import ladder_tables
import model_samplers_tables
import model_tables
import models_tables
import near_far_tables
import paper_size_tables
import paper_spp_tables
import render_tables
import scattering_tables
import sharing_tables
import stability_tables
import view_tables
import where_it_pays_tables
from tables import filled

DOCS = Path(__file__).parents[1] / "docs"
DOCUMENTS = {
    "model.md": model_tables.TABLES | near_far_tables.TABLES | scattering_tables.TABLES,
    "performance.md": intersect_tables.TABLES | render_tables.TABLES | check_tables.PERFORMANCE,
    "results.md": convergence_tables.TABLES
    | ladder_tables.TABLES
    | model_samplers_tables.TABLES
    | paper_size_tables.TABLES
    | paper_spp_tables.TABLES
    | check_tables.RESULTS,
    "numerics.md": stability_tables.TABLES,
    "models/index.md": models_tables.TABLES,
    "gpu.md": gpu_tables.TABLES,
    "sharing.md": sharing_tables.TABLES,
    "view.md": view_tables.TABLES,
    "where_it_pays.md": where_it_pays_tables.TABLES,
}


def written(name: str) -> str:
    """A document of docs/ with its tables made anew."""
    return filled((DOCS / name).read_text(), DOCUMENTS[name])


if __name__ == "__main__":
    for name in sys.argv[1:] or DOCUMENTS:
        (DOCS / name).write_text(written(name))
