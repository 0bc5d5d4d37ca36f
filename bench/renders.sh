#!/usr/bin/env bash
# The runs behind the tables of whole renders in docs/performance.md, about 8 minutes a device on two
# quiet cores:
#     bash bench/renders.sh GROOMS [NAME=DEVICE]...
# GROOMS is the folder of hair10k.npz and fur100k.npz (see bench/peers.py); NAME names the folders of
# the results.
set -euo pipefail
cd "$(dirname "$0")/.."
furcl=${FURCL:-.venv/bin/furcl}
python=${PYTHON:-.venv/bin/python}
out=bench/results
grooms=$1
shift
[ $# -gt 0 ] || set -- portable=portable intel=intel

for device in "$@"; do
    name=${device%%=*} options=(--device "${device#*=}")
    $furcl bench stages black_hair white_hair raccoon "${options[@]}" -o "$out/stages/$name" \
        --spp 16 --rounds 3
    $furcl bench waves black_hair raccoon "${options[@]}" -o "$out/waves/$name"
    $python bench/peers.py "$grooms" "${options[@]}" -o "$out/peers/$name" --spp 64 --rounds 3
done
$python bench/render_tables.py docs/performance.md
