#!/usr/bin/env bash
# The Python package: builds it, puts it into a fresh virtual environment below target/, and runs its tests there with pytest and mypy.
# Usage: tests/python.sh [--wheel] [PYTEST ARGUMENTS]
# --wheel: the wheel as it is released, by maturin, installed by pip, 15 MB at most; without it the library of the other tests' build.
# Exit code 77 where something to test it with cannot be had; the last line says what.
set -euo pipefail
cd "$(dirname "$0")/.."

missing() {
    echo "$1"
    exit 77
}
wheel=false
[ "${1:-}" = --wheel ] && { wheel=true && shift; }
command -v python3 >/dev/null || missing "no python3"
python3 -c 'import sys; sys.exit(sys.version_info < (3, 10))' || missing "python3 is older than 3.10"

target="${CARGO_TARGET_DIR:-target}"
venv="$target/python"
rm -rf "$venv"
python3 -m venv "$venv" 2>/dev/null || missing "no virtual environments (apt-get install python3-venv)"
python="$venv/bin/python"
"$python" -m pip install --quiet --disable-pip-version-check numpy pytest mypy 'anywidget>=0.9' nbclient ipykernel ||
    missing "no numpy, pytest, mypy, anywidget, nbclient and ipykernel (pip install)"

if $wheel; then
    "$python" -m pip install --quiet --disable-pip-version-check 'maturin>=1.9,<2' || missing "no maturin (pip install maturin)"
    rm -rf "$target/wheels"
    "$venv/bin/maturin" build --release --locked --manifest-path python/Cargo.toml --out "$target/wheels"
    "$python" -m pip install --quiet --disable-pip-version-check "$target"/wheels/*.whl
    bytes=$(stat -c %s "$target"/wheels/*.whl)
    echo "wheel: $bytes bytes"
    [ "$bytes" -le 15000000 ] || { echo "the wheel has more than 15 MB"; exit 1; }
else
    # With the tests, as they were built: else the crates are built once more, with other features.
    cargo build --workspace --locked --lib --bins --tests
    library="$target/debug/libskin_python.so"
    [ -e "$library" ] || library="$target/debug/libskin_python.dylib"
    site=$("$python" -c 'import sysconfig; print(sysconfig.get_path("platlib"))')
    cp -r python/skin "$site/skin"
    ln "$library" "$site/skin/_skin.abi3.so" 2>/dev/null || cp "$library" "$site/skin/_skin.abi3.so"
fi
# Not from python/: the package that is installed is tested.
"$python" -m mypy --config-file python/pyproject.toml --cache-dir "$target/mypy" python/tests python/examples python/benches contrib/rerun_layout.py
"$python" -m mypy --config-file python/pyproject.toml --cache-dir "$target/mypy" -p skin
# The stubs say what is there, and all of it.
"$python" -m mypy.stubtest skin._skin
"$python" -m pytest --quiet -p no:cacheprovider python/tests "$@"
