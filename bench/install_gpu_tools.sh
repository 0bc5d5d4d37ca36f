#!/usr/bin/env bash
# Compilers for `make gpu-check`, in a folder of their own that furcl never imports:
#     bash bench/install_gpu_tools.sh [FOLDER]
# clang 19 with libclc from Debian's packages, unpacked and not installed, which needs no root; ptxas from PyPI.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-out/gpu-tools}
bin=${BIN:-.venv/bin}
command -v apt-get >/dev/null && command -v dpkg >/dev/null || {
    echo "needs apt-get and dpkg of a Debian that has clang-19 and libclc-19" >&2
    exit 1
}
mkdir -p "$folder/debs"
"$bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --target "$folder/py" --upgrade \
    nvidia-cuda-nvcc==13.0.88
cd "$folder/debs"
apt-get download -qq clang-19 libclang-cpp19 libclang-common-19-dev libllvm19 libclc-19 libclc-19-dev
for package in *.deb; do dpkg -x "$package" ..; done
cd ..
rm -r debs
