#!/usr/bin/env bash
# The runs behind docs/results.md, about 10 minutes on two quiet cores:
#     bash bench/convergence.sh [DEVICE]
# A run that was stopped goes on where it stopped.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=.venv/bin
out=bench/results/convergence
options=(--device "${1:-Portable Computing Language}")

# The paper's three scenes: its figures 10-12 and tables 2-7.
$bin/furcl bench convergence black_hair white_hair raccoon "${options[@]}" -o $out/scenes \
    --size 128x128 --spp 16,32,64,128 --reference-spp 1024

# Black hair in other light.
small=(--size 48x48 --spp 16,32,64 --reference-spp 512)
$bin/furcl bench convergence black_hair "${options[@]}" "${small[@]}" -o $out/black-hair-constant \
    --set 'environment={kind="constant"}'
$bin/furcl bench convergence black_hair "${options[@]}" "${small[@]}" -o $out/black-hair-back-light \
    --set environment.sun_azimuth_deg=-155 --set environment.sun_scale=3

# One fibre that fills the picture in even light: nothing hides the light, what is left is the
# spread of the weights.
for fibre in human-black human-white raccoon; do
    $bin/furcl bench convergence single_fibre "${options[@]}" -o "$out/single-fibre-$fibre" \
        --size 24x24 --spp 16,32,64,128 --set camera.vfov_deg=2 --set fibre.preset=$fibre
done

$bin/python bench/results_tables.py docs/results.md
