#!/usr/bin/env bash
# Compilers for `make gpu-check`, in a folder of their own that furcl never imports:
#     bash bench/install_gpu_tools.sh [FOLDER]
# clang 19 with libclc from Debian's packages; ptxas from PyPI.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-out/gpu-tools}
bin=${BIN:-.venv/bin}
bash bench/unpack_debs.sh "$folder" clang-19 libclang-cpp19 libclang-common-19-dev libllvm19 libclc-19 libclc-19-dev
"$bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --target "$folder/py" --upgrade \
    nvidia-cuda-nvcc==13.0.88
