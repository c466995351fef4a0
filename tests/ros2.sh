#!/usr/bin/env bash
# `skin run --ros2` against another implementation of DDS: puts Cyclone DDS into a fresh virtual environment below target/, and runs
# tests/ros2.py there. Everything is on 127.0.0.1.
# Usage: tests/ros2.sh [SECONDS], how long four skins send.
# Exit code 77 where something to test it with cannot be had; the last line says what.
set -euo pipefail
cd "$(dirname "$0")/.."

missing() {
    echo "$1"
    exit 77
}
command -v python3 >/dev/null || missing "no python3"
target="${CARGO_TARGET_DIR:-target}"
venv="$target/ros2"
rm -rf "$venv"
python3 -m venv "$venv" 2>/dev/null || missing "no virtual environments (apt-get install python3-venv)"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check --only-binary=:all: cyclonedds numpy rosbags ||
    missing "no packages cyclonedds, numpy and rosbags (pip install)"
"$venv/bin/python" -B tests/ros2.py "$target/debug/skin" "$@"
