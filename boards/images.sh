#!/usr/bin/env bash
# The program of every board of docs/board.md as a file for `skin flash` or a debug probe, with checksums.
# Usage: boards/images.sh [FOLDER, else target/images]
set -euo pipefail
cd "$(dirname "$0")/.."
root="$PWD"
out="${1:-target/images}"
mkdir -p "$out"
out=$(cd "$out" && pwd)
version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' Cargo.toml)
. boards/toolchain.sh || exit 1

export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$root/target}/boards" CARGO_PROFILE_RELEASE_STRIP=symbols CARGO_PROFILE_RELEASE_DEBUG=none
# image NAME FOLDER PROGRAM CARGO ARGUMENTS...
image() {
    local name="skin-board-$version-$1.elf" folder="$2" program="$3"
    shift 3
    (cd "boards/$folder" && board_cargo build --release --locked --bin "$program" "$@")
    cp "$CARGO_TARGET_DIR/$TARGET/release/$program" "$out/$name"
}
rm -f "$out"/skin-board-*.elf
image nucleo-f446re stm32f4 skin-board
image nucleo-f446re-st-link stm32f4 skin-board --features st-link
image stm32f405 stm32f4 skin-board --no-default-features --features f405
image stm32f427 stm32f4 skin-board --no-default-features --features f427
image stm32h743 stm32h7 skin-board-h743
cd "$out"
sha256sum skin-board-*.elf >SHA256SUMS
cat SHA256SUMS
