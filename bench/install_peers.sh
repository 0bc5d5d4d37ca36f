#!/usr/bin/env bash
# Other renderers for bench/peers.py, in a folder of their own that furcl never imports:
#     bash bench/install_peers.sh [FOLDER]
# Mitsuba 3 and Cycles (bpy) from PyPI and, where there is no LLVM 17 or later on the machine, LLVM 19 from Debian's
# packages, unpacked and not installed. BIN: where python is.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-out/peers}
bin=${BIN:-.venv/bin}
mkdir -p "$folder/llvm"
"$bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --target "$folder" --upgrade \
    mitsuba==3.9.1 drjit==1.5.0 bpy==5.0.1 'numpy<2'
if command -v apt-get >/dev/null && command -v dpkg >/dev/null; then
    (cd "$folder/llvm" && apt-get download --quiet libllvm19 && dpkg -x libllvm19_*.deb . && rm libllvm19_*.deb)
else
    echo "no apt-get: put the path of an LLVM 17 or later in DRJIT_LIBLLVM_PATH" >&2
fi
echo "installed into $folder: python bench/peers.py -o OUT --peers $folder"
