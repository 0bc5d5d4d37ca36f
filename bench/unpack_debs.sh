#!/usr/bin/env bash
# Unpack Debian's packages into a folder, without installing them, which needs no root:
#     bash bench/unpack_debs.sh FOLDER PACKAGE...
set -euo pipefail
folder=$1
shift
command -v apt-get >/dev/null && command -v dpkg >/dev/null || {
    echo "needs apt-get and dpkg of a Debian that has $*" >&2
    exit 1
}
mkdir -p "$folder/debs"
cd "$folder/debs"
apt-get download -qq "$@"
for package in *.deb; do dpkg -x "$package" ..; done
cd ..
rm -r debs
