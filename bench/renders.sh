#!/usr/bin/env bash
# The runs behind the tables of whole renders in docs/performance.md, about 3 minutes on two quiet
# cores:
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
    $furcl bench stages black_hair white_hair raccoon --device "${device#*=}" \
        -o "$out/stages/${device%%=*}" --spp 8
done

# The rest on the first device.
name=${1%%=*} options=(--device "${1#*=}")
$furcl bench waves black_hair raccoon "${options[@]}" -o "$out/waves/$name" --rounds 5 \
    --set film.width=256 --set film.height=256
$python bench/peers.py "$grooms" "${options[@]}" -o "$out/peers/$name" --spp 16
$furcl bench start black_hair "${options[@]}" -o "$out/start/$name" --runs 9
lean=("${options[@]}" --size 256x256 --spp 2 --rounds 7)
$furcl bench features black_hair white_hair raccoon red_fox single_fibre furnace "${lean[@]}" \
    -o "$out/features/scenes"
$furcl bench features black_hair "${lean[@]}" -o "$out/features/black-hair-grey" \
    --set fibre.kappa=0 --set 'environment={kind="constant"}'
$python bench/render_tables.py docs/performance.md
