#!/usr/bin/env bash
# Makes a virtual environment with Python 3.11 to 3.13: make_venv.sh FOLDER.
# PYTHON=... names the interpreter. As root, or with sudo, missing parts come through apt-get.
set -euo pipefail
folder=$1
PYTHON=${PYTHON:-}

is_suitable() { "$1" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null; }
has_venv() { "$1" -c 'import ensurepip, venv' 2>/dev/null; }

find_python() { # the first that can make environments, else the first that is suitable
    local candidate fallback=
    for candidate in ${PYTHON:-python3 python3.13 python3.12 python3.11}; do
        is_suitable "$candidate" || continue
        if has_venv "$candidate"; then echo "$candidate"; return; fi
        fallback=${fallback:-$candidate}
    done
    echo "$fallback"
}

install_packages() {
    local root=
    if [ "$(id -u)" != 0 ]; then root="sudo --non-interactive"; fi
    command -v apt-get >/dev/null && $root true 2>/dev/null || return 1
    $root apt-get update --quiet=2
    $root env DEBIAN_FRONTEND=noninteractive apt-get install --quiet=2 --yes "$@"
}

python=$(find_python)
if [ -z "$python$PYTHON" ]; then # Ubuntu 22.04 has 3.11 beside its python3
    install_packages python3.11 python3.11-venv || true
    python=$(find_python)
fi
if [ -n "$python" ] && ! has_venv "$python"; then
    version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    install_packages "python$version-venv" || true
fi
if [ -z "$python" ] || ! has_venv "$python"; then
    echo "furcl needs Python 3.11, 3.12 or 3.13 with the module venv." >&2
    echo "As root: apt-get install python3.11 python3.11-venv; or set PYTHON=/path/to/python3" >&2
    exit 1
fi
"$python" -m venv "$folder"
