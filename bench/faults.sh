#!/usr/bin/env bash
# Try to break furcl, and print what happens: case, what happened, verdict. Ends with 1 if one is wrong.
#     bash bench/faults.sh [TOPIC or part of a name...] [--quick]
# Minutes on two cores at full size; --quick is what `make test` runs too. BIN: where python is.
set -euo pipefail
cd "$(dirname "$0")/.."
export PYTHONPATH=bench:.${PYTHONPATH:+:$PYTHONPATH}
exec "${BIN:-.venv/bin}/python" -m faults "$@"
