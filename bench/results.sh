#!/usr/bin/env bash
# The runs behind docs/: all kinds, or those named, one after the other on a quiet machine.
#     bash bench/results.sh [KIND...] [--device D] [--quick]
# Minutes on two cores; every run says how long it took, and times.txt beside the results keeps it:
#     intersect 3   launch_sizes 2   stages 1   convergence 13   paper-size 12   features 3   start 1   start_large 4   stability 6   peers 6
#     paper-spp 60   fibre_truth 3   medulla_tables 2   overhead 5   unbiased 20   stragglers 1   simulated 40   scattering 10   docs 0
# A convergence run that was stopped goes on where it stopped. `docs` writes the tables of docs/ from
# the results and comes last. --quick tries the script: tiny sizes, into out/results, no docs.
# Real grooms, the .hair files of the folder GROOMS, are measured where it is there; out/grooms points
# to them. BIN: where furcl and python are.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=${BIN:-.venv/bin}
real_grooms=${GROOMS:-../shared/data/hair}
all="intersect stages convergence paper-size paper-spp features launch_sizes start start_large stability peers fibre_truth medulla_tables overhead unbiased stragglers simulated scattering docs"
device=portable quick= out=bench/results kinds=

refuse() { echo "results.sh: $1" >&2 && exit 2; }

while [ $# -gt 0 ]; do
    case $1 in
        --quick) quick=yes out=out/results ;;
        --device) [ $# -gt 1 ] || refuse "--device needs a name" && device=$2 && shift ;;
        -*) refuse "$1 is not an option; allowed are --device D and --quick" ;;
        *) [[ " $all " == *" $1 "* ]] || refuse "no kind $1; there are $all"
            kinds+=" $1" ;;
    esac
    shift
done
name=${device// /-} # of folders that differ by device

# As the paper's comparison renders.
conventional=()
for setting in light_sampling=bcsdf sequence=independent roulette=depth allocation=even; do
    conventional+=(--set "render.$setting")
done

pick() { if [ "$quick" ]; then echo "$2"; else echo "$1"; fi; }

timed() { # LABEL COMMAND...: run it, print and keep its seconds
    local label=$1 start=$SECONDS
    shift
    echo "== $label" >&2
    mkdir -p "$out"
    "$@"
    echo "$label: $((SECONDS - start)) s" | tee -a "$out/times.txt" >&2
}

run() { # KIND FOLDER ARGUMENTS...: a benchmark of furcl
    local folder="$1${2:+/$2}"
    timed "$folder" "$bin/furcl" -q bench "$1" "${@:3}" --device "$device" -o "$out/$folder"
}

script() { # NAME ARGUMENTS...: a script of this folder
    timed "$1" "$bin/python" "bench/$1.py" "${@:2}" --device "$device"
}

intersect() { # rays beside Embree
    local groom
    mkdir -p out/grooms
    for groom in "$real_grooms"/*.hair; do
        if [ -e "$groom" ]; then ln -sf "$(realpath "$groom")" out/grooms/; else echo "no $groom" >&2; fi
    done
    for groom in $(pick "hair:10000 hair:150000 hair:700000 fur:700000" hair:1000) out/grooms/*.hair; do
        [[ $groom == *:* || -e $groom ]] || continue
        run intersect "$name-$(basename "${groom//:/-}" .hair)" "$groom" $(pick "--rounds 9" "--rounds 1 --size 32")
    done
}

stages() { # where the time of renders goes
    run stages "$name" black_hair white_hair raccoon \
        $(pick "--spp 8 --rounds 3" "--spp 1 --set film.width=16 --set film.height=16")
}

convergence() { # error against time, with the settings of the paper's comparison
    local paper small single fibre settings="${conventional[*]}"
    paper=$(pick "--size 128x128 --spp 16,32,64,128 --reference-spp 1024" "--quick --size 8x8 --runs 2")
    small=$(pick "--size 48x48 --spp 16,32,64 --reference-spp 512" "--quick --size 8x8 --runs 2")
    single=$(pick "--size 24x24 --spp 16,32,64,128" "--quick --size 8x8 --runs 2")
    # The paper's three scenes: its figures 10-12 and tables 2-7.
    run convergence scenes black_hair white_hair raccoon $paper $settings
    # Black hair in other light.
    run convergence black-hair-constant black_hair $small $settings --set 'environment={kind="constant"}'
    run convergence black-hair-back-light black_hair $small $settings \
        --set environment.sun_azimuth_deg=-155 --set environment.sun_scale=3
    # One fibre that fills the picture in even light: nothing hides the light, what is left is the
    # spread of the weights.
    for fibre in human-black human-white raccoon; do
        run convergence "single-fibre-$fibre" single_fibre $single $settings \
            --set camera.vfov_deg=2 --set fibre.preset=$fibre
    done
}

paper-size() { # furcl at its best beside a conventional renderer, at the paper's size
    local variants
    mapfile -t variants < <("$bin/python" bench/ladder.py ends)
    timed paper-size "$bin/furcl" -q bench convergence black_hair white_hair raccoon "${variants[@]}" \
        $(pick "--size 256x256 --spp 16,64 --reference-spp 512" "--quick --size 8x8 --runs 2") \
        --device "$device" -o "$out/paper-size/$name"
}

paper-spp() { # the ends of the paper's tables 5-7, whose renders have 64 to 512 samples a pixel
    local scene
    for scene in black_hair white_hair raccoon; do
        timed "paper-spp/$name-$scene" "$bin/furcl" -q bench convergence $scene \
            --sampling uniform-h,attenuation-cdf "${conventional[@]}" \
            $(pick "--size 256x256 --spp 64,512 --runs 3 --reference-spp 1024" "--quick --size 8x8 --runs 2") \
            --device "$device" -o "$out/paper-spp/$name-$scene"
    done
}

features() { # what leaving out buys
    local size
    size=$(pick "--size 256x256 --spp 2 --rounds 7" "--size 8x8 --spp 1 --rounds 1")
    run features scenes $(pick "black_hair white_hair raccoon red_fox single_fibre furnace" single_fibre) $size
    run features black-hair-grey $(pick black_hair single_fibre) $size \
        --set fibre.kappa=0 --set 'environment={kind="constant"}'
}

launch_sizes() { # rays a second of small launches
    script launch_sizes $(pick "" "hair:10000 --rounds 1") -o "$out/launch_sizes.json"
}

start() { # time to first samples
    run start "$name" $(pick "black_hair --runs 9" "single_fibre --runs 1 --size 16x16")
}

start_large() { # from the file of ten million segments to the first samples
    script start_large -o "$out/start_large" $(pick "" "--groom hair:10000 --runs 1 --size 16")
}

stability() { # float32 at all edges
    run stability "" $(pick "--points 1000000" "--quick --points 2000 --no-renders")
}

peers() { # other renderers in turns with furcl, those of bench/install_peers.sh
    local renderers=furcl
    if [ -d out/peers/mitsuba ]; then renderers=furcl,mitsuba-llvm,mitsuba-linear,mitsuba-scalar,cycles; else echo "no out/peers" >&2; fi
    script peers -o "$out/peers/$name" --renderers $renderers \
        $(pick "" "--spp 1 --rounds 2 --size 16 --strands 100")
}

fibre_truth() { # the model beside brute force
    script fibre_truth -o "$out" $(pick "" "--presets raccoon --theta 60 --photons 1000")
}

medulla_tables() { # simulated profiles of presets, and lobe shares
    script medulla_tables -o "$out" $(pick "" raccoon)
}

overhead() { # what numbers, plans and learning cost
    script overhead $(pick "" "black_hair --size 16x16 --spp 8 --rounds 1") -o "$out/overhead/$name.json"
}

unbiased() { # whether every variant of the ladder shows the same picture, in every light
    script unbiased $(pick "--size 32x32" "sky --scenes black_hair --size 8x8 --runs 2 --spp 4") \
        -o "$out/unbiased/$name.json"
}

stragglers() { # how well machines share a render
    script stragglers -o "$out/stragglers/$name" $(pick "" "single_fibre --parts 2")
}

simulated() { # simulated scattering beside brute force
    script simulated_truth -o "$out" $(pick "--photons 4000000" "--presets raccoon --theta 60 --photons 1000")
}

scattering() { # pictures with simulated scattering beside published ones, and what it costs
    timed make_scattering "$bin/python" docs/make_scattering.py --device "$device" \
        $(pick "" "--size 16 --spp 2 --out out")
    script scattering_cost $(pick "" "raccoon --size 16x16 --spp 1 --rounds 1") -o "$out/scattering_cost.json"
}

docs() {
    if [ ! "$quick" ]; then "$bin/python" bench/docs_tables.py; fi
}

for kind in ${kinds:-$all}; do
    "$kind"
done
