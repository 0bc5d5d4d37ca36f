"""Tables of docs/sharing.md: bench/results/stragglers."""

from __future__ import annotations

import numpy as np
from tables import circumstances, runs, table


def stragglers() -> str:
    """Share of all machines' time that is work, by parts a machine."""
    rows = []
    for found in runs("stragglers"):
        shares = {
            (row["parts_a_machine"], row["again"], row["one_lost"]): (
                f"{row['median']:.0%} ({row['worst']:.0%})"
            )
            for row in found["rows"]
        }
        for parts in sorted({key[0] for key in shares}):
            cases = ((False, False), (True, False), (True, True))
            rows.append([str(parts), *(shares[parts, *case] for case in cases)])
    columns = [
        "parts a machine",
        "late parts are waited for",
        "taken again",
        "and a machine is lost",
    ]
    return table(columns, rows)


def sizes() -> str:
    """What is sent, and how long a part takes."""
    return "\n".join(
        f"{found['scene']}: {found['groom_bytes'] / 1e6:.1f} MB of groom to each machine, "
        f"{found['picture_bytes'] / 1e6:.2f} MB of picture from each part; "
        f"{found['set_up_seconds']:.1f} s to set up, {np.mean(found['seconds']):.2f} s a part."
        for found in runs("stragglers")
    )


TABLES = {
    "stragglers-circumstances": lambda: circumstances(*runs("stragglers")),
    "stragglers": stragglers,
    "sizes": sizes,
}
