#!/usr/bin/env bash
# The ladder from a conventional renderer to furcl's best, in the paper's scenes and other lights:
# baseline, each step alone, all steps without each, all; every rung with the paper's sampler beside.
#     bash bench/ablation.sh [LIGHT...] [--device D] [--quick | --paper]
# Scenes, lights and steps are in bench/ladder.py, the protocol in docs/convergence.md. One that was
# stopped goes on where it stopped. By default the pictures are small and all takes half an hour or less
# on two quiet cores; --paper takes the paper's sizes and hours; --quick tries the script, into
# out/results. Images of surroundings are sought in the folder LIGHTS; BIN: where furcl and python are.
# Afterwards `python bench/docs_tables.py results.md` writes the tables, and bench/ladder_tables.py the figure.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=${BIN:-.venv/bin}
device=portable out=bench/results/ablation size=default lights=

refuse() { echo "ablation.sh: $1" >&2 && exit 2; }

ladder() { "$bin/python" bench/ladder.py "$@"; }

while [ $# -gt 0 ]; do
    case $1 in
        --quick) size=quick out=out/results/ablation ;;
        --paper) size=paper ;;
        --device) [ $# -gt 1 ] || refuse "--device needs a name" && device=$2 && shift ;;
        -*) refuse "$1 is not an option; allowed are --device D, --quick and --paper" ;;
        *) ladder lights | grep -x -- "$1" >/dev/null || refuse "no light $1; there are $(ladder lights | xargs)"
            lights+=" $1" ;;
    esac
    shift
done

numbers() { # LIGHT: size of the pictures and numbers of samples
    case $size-$1 in
        quick-*) echo "--quick --size 12x12 --runs 2" ;;
        paper-sky) echo "--size 256x256 --spp 16,64,256,512 --reference-spp 4096" ;;
        paper-*) echo "--size 128x128 --spp 16,64,256 --reference-spp 2048" ;;
        default-sky) echo "--size 48x48 --spp 16,64 --reference-spp 1024" ;;
        default-*) echo "--size 24x24 --spp 16,64 --reference-spp 1024" ;;
    esac
}

for light in ${lights:-$(ladder lights)}; do
    if ! settings=$(ladder light "$light"); then
        echo "== $light: skipped" >&2
        continue
    fi
    echo "== $light" >&2
    start=$SECONDS
    mapfile -t options < <([ -z "$settings" ] || echo "$settings"; ladder variants "$light")
    "$bin/furcl" -q bench convergence black_hair white_hair raccoon $(numbers "$light") \
        "${options[@]}" --device "$device" -o "$out/$light"
    echo "$light: $((SECONDS - start)) s" | tee -a "$out/times.txt" >&2
done
