#!/usr/bin/env bash
# oclgrind, the simulator of `make oclgrind-check`, in a folder of its own that furcl never imports:
#     bash bench/install_oclgrind.sh [FOLDER]
# Debian's packages of it, its LLVM 14, and what that needs.
set -euo pipefail
cd "$(dirname "$0")/.."
bash bench/unpack_debs.sh "${1:-out/oclgrind}" oclgrind liboclgrind-21.10 libclang-cpp14 libllvm14 \
    libedit2 libz3-4 libxml2 libicu72 libreadline8 libbsd0 libmd0 libffi8 libtinfo6
