#!/usr/bin/env bash
# Recordings and exports as other people's programs open them: puts mcap, NumPy, SciPy, pyEIT, DuckDB and rosbags into a fresh virtual
# environment below target/, and runs tests/recordings.py there.
# Exit code 77 where something to test it with cannot be had; the last line says what.
set -euo pipefail
cd "$(dirname "$0")/.."

missing() {
    echo "$1"
    exit 77
}
command -v python3 >/dev/null || missing "no python3"
target="${CARGO_TARGET_DIR:-target}"
venv="$target/recordings"
rm -rf "$venv"
python3 -m venv "$venv" 2>/dev/null || missing "no virtual environments (apt-get install python3-venv)"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --prefer-binary mcap numpy scipy pyeit duckdb rosbags ||
    missing "no packages mcap, numpy, scipy, pyeit, duckdb and rosbags (pip install)"
"$venv/bin/python" -B tests/recordings.py "$target/debug/skin"
