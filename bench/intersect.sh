#!/usr/bin/env bash
# The runs behind docs/performance.md: rays beside Embree, about 3 minutes a device on two quiet cores:
#     bash bench/intersect.sh [DEVICE [GROOM_FILE...]]
# Writes the tables of all results. Environment: ROUNDS, GROOMS (in place of the generated ones).
set -euo pipefail
cd "$(dirname "$0")/.."
bin=${BIN:-.venv/bin}
device=${1:-portable}
grooms=${GROOMS:-hair:150000 hair:700000 fur:700000 hair:10000 hair:100000 hair:1000000 hair:10000000 fur:1000000 fur:10000000 head:1000000 head:10000000}

for groom in $grooms "${@:2}"; do
    name=$(basename "${groom%.*}")
    $bin/furcl -q bench intersect "$groom" --device "$device" --rounds "${ROUNDS:-9}" \
        -o "bench/results/intersect/${device// /-}-${name//:/-}"
done

$bin/python bench/render_tables.py docs/performance.md
