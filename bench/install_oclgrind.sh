#!/usr/bin/env bash
# oclgrind, the simulator of `make oclgrind-check`, in a folder of its own that furcl never imports:
#     bash bench/install_oclgrind.sh [FOLDER]
# Debian's packages, unpacked and not installed, which needs no root.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-out/oclgrind}
command -v apt-get >/dev/null && command -v dpkg >/dev/null || {
    echo "needs apt-get and dpkg of a Debian that has oclgrind and its LLVM 14" >&2
    exit 1
}
mkdir -p "$folder/debs"
cd "$folder/debs"
apt-get download -qq oclgrind liboclgrind-21.10 libclang-cpp14 libllvm14 \
    libedit2 libz3-4 libxml2 libicu72 libreadline8 libbsd0 libmd0 libffi8 libtinfo6
for package in *.deb; do dpkg -x "$package" ..; done
cd ..
rm -r debs
