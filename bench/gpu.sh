#!/usr/bin/env bash
# Everything about one GPU machine in at most eight minutes, without a network:
#     bash bench/gpu.sh WHEELS OUT [--device D] [--python P] [--quick] [STEP...]
# WHEELS: a folder of wheels of what the machine's Python lacks (docs/gpu.md tells how to fill it).
# OUT: gets one log and one results file a step, and steps.txt: each step, its seconds, its exit code.
# D: part of the device's description (default: the first GPU, else the first device). P: a Python
# 3.11 to 3.13 (default python3); what is installed beside it is found too.
# Steps, all or those named, in their order: doctor stages intersect convergence suite waves features peers.
# If doctor fails nothing else is tried; other steps that fail or take too long stop no other. GROOMS: a
# folder of .hair files to measure too. PEERS: a folder with the packages of Mitsuba, to measure beside.
set -uo pipefail
cd "$(dirname "$0")/.."
all="doctor stages intersect convergence suite waves features peers"
python=python3 device= quick= steps=

refuse() { echo "gpu.sh: $1" >&2 && exit 2; }

[ $# -ge 2 ] || refuse "usage: bash bench/gpu.sh WHEELS OUT [--device D] [--python P] [--quick] [STEP...]"
wheels=$1 out=$2
shift 2
while [ $# -gt 0 ]; do
    case $1 in
        --device | --python) [ $# -gt 1 ] || refuse "$1 needs a value"
            declare "${1#--}=$2" && shift ;;
        --quick) quick=yes ;;
        *) [[ " $all " == *" $1 "* ]] || refuse "no step $1; there are $all"
            steps+=" $1" ;;
    esac
    shift
done
[ -d "$wheels" ] || refuse "no folder of wheels $wheels"
mkdir -p "$out" && out=$(cd "$out" && pwd)
work=out/gpu # relative, as results name it
rm -rf $work && mkdir -p $work out/grooms
bin=$PWD/$work/venv/bin

pick() { if [ "$quick" ]; then echo "$2"; else echo "$1"; fi; }

step() { # NAME SECONDS COMMAND...: run it for at most so long; its output goes to NAME.log
    local name=$1 limit=$2 start=$SECONDS code
    shift 2
    timeout --signal=INT --kill-after=20 "$limit" "$@" >"$out/$name.log" 2>&1 # pytest then says what failed
    code=$?
    echo "$name: $((SECONDS - start)) s, exit $code" | tee -a "$out/steps.txt"
    tail -n "$(pick 15 5)" "$out/$name.log"
    return $code
}

bench() { # NAME SECONDS KIND ARGUMENTS...: a benchmark of furcl; its results.json is kept as NAME.json
    local name=$1 limit=$2
    shift 2
    step "$name" "$limit" "$bin/furcl" -q bench "$@" --device "$device" -o "$work/$name"
    if [ -e "$work/$name/results.json" ]; then cp "$work/$name/results.json" "$out/$name.json"; fi
}

# An environment of its own that also sees the packages of $python, with the wheels before them.
install() {
    "$python" -m venv --without-pip "$work/venv" || return
    local site
    site=$("$bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))') || return
    "$python" -c 'import site, sys; print("\n".join(p for p in sys.path if p.endswith("-packages")))' \
        >"$site/machine.pth" || return
    if compgen -G "$wheels/*.whl" >/dev/null; then
        "$python" -m pip --python "$bin/python" install --quiet --no-index --no-deps --no-compile \
            --ignore-installed "$wheels"/*.whl || return
    fi
    "$python" -m pip --python "$bin/python" install --quiet --no-index --no-deps \
        --no-build-isolation -e .
}

# Drivers in containers often come without the file that tells OpenCL's loader of them.
find_driver() {
    local driver folder
    folder=$("$bin/python" -c 'import pathlib, pyopencl; print(pathlib.Path(pyopencl.__file__).parent / ".libs")')
    for driver in $(ldconfig -p | awk '/libnvidia-opencl\.so\.1|libamdocl64\.so/ {print $NF}'); do
        [ -w "$folder" ] && ! grep -qs "${driver##*/}" /etc/OpenCL/vendors/*.icd "$folder"/*.icd || continue
        echo "$driver" >"$folder/${driver##*/}.icd"
        echo "no file in /etc/OpenCL/vendors names ${driver##*/}; the loader is told of $driver"
    done
}

doctor() {
    nvidia-smi 2>/dev/null || true
    lscpu | grep -E 'Model name|^CPU\(s\)'
    "$bin/furcl" devices
    "$bin/furcl" doctor
    "$bin/furcl" render raccoon --device "$device" --size 128x128 --spp 64 --stats "$out/render.json" \
        -o "$work/raccoon.exr" --set render.light_sampling=mis --set render.sequence=sobol \
        --set render.roulette=adjoint --set render.allocation=adaptive
}

suite() {
    local workers=
    if "$bin/python" -c 'import xdist' 2>/dev/null; then workers="-n $(pick 12 2) --dist loadfile"; fi
    "$bin/python" -m pytest -q -m "not slow" --device "$device" -p no:cacheprovider $workers \
        --continue-on-collection-errors --durations=15 \
        $(pick "" "tests/test_intersect.py")
}

intersect() {
    local groom
    for groom in "${GROOMS:-none}"/*.hair; do
        if [ -e "$groom" ]; then ln -sf "$(realpath "$groom")" out/grooms/; fi
    done
    for groom in $(pick "hair:150000 hair:700000 fur:700000" hair:1000) out/grooms/*.hair; do
        [[ $groom == *:* || -e $groom ]] || continue
        bench "intersect-$(basename "${groom//:/-}" .hair)" 60 intersect "$groom" \
            $(pick "--size 1024 --rounds 5" "--size 32 --rounds 1")
    done
}

stages() {
    bench stages 90 stages black_hair white_hair raccoon \
        $(pick "--spp 16 --rounds 3" "--spp 1 --set film.width=16 --set film.height=16")
}

waves() {
    bench waves 60 waves black_hair raccoon \
        $(pick "--sizes 1048576,65536,262144,4194304 --spp 16 --rounds 3" \
            "--sizes 32768,16384 --spp 1 --rounds 1 --set film.width=16 --set film.height=16")
}

features() {
    bench features 60 features black_hair white_hair raccoon $(pick "--size 512x512 --spp 8" "--size 8x8 --spp 1 --rounds 1")
}

convergence() {
    local variants
    mapfile -t variants < <("$bin/python" bench/ladder.py ends)
    bench paper-size 120 convergence black_hair white_hair raccoon "${variants[@]}" \
        $(pick "--size 256x256 --spp 16,64,256 --reference-spp 4096" "--quick --size 8x8 --runs 2")
}

peers() {
    [ -n "${PEERS:-}" ] || { echo "peers: no folder PEERS" && return; }
    step peers 100 "$bin/python" bench/peers.py -o "$work/peers" --peers "$PEERS" --device "$device" \
        --renderers "furcl,$(pick mitsuba-cuda mitsuba-scalar)" --pictures "$out/peers" \
        $(pick "--size 512 --spp 64 --rounds 5" "--size 16 --spp 2 --rounds 2 --strands 100")
    if [ -e "$work/peers/results.json" ]; then cp "$work/peers/results.json" "$out/peers.json"; fi
}

export -f doctor suite pick
export bin device quick out work
started=$SECONDS
install >"$out/install.log" 2>&1 || { cat "$out/install.log"; refuse "the wheels could not be installed"; }
echo "install: $((SECONDS - started)) s" | tee "$out/steps.txt"
find_driver
: "${device:=$("$bin/python" -c '
from furcl.device.choice import list_candidates
found = sorted(list_candidates(), key=lambda c: c.rank())
print(found[0].description if found else "")')}"
[ -n "$device" ] || { ldconfig -p | grep -iE "opencl|nvidia"; ls /usr/local/nvidia/lib64 2>/dev/null; refuse "no OpenCL device"; }
echo "device: $device"
export device
for kind in ${steps:-$all}; do
    case $kind in
        doctor) step doctor 90 bash -c "set -e; doctor" || refuse "this device renders nothing" ;;
        suite) step suite "$(pick 300 200)" bash -c suite ;;
        *) "$kind" ;;
    esac
done
echo "in all: $((SECONDS - started)) s" | tee -a "$out/steps.txt"
