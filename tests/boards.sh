#!/usr/bin/env bash
# The firmware as Cortex-M programs: builds every board and runs its tests in emulation. Installs with apt-get what is
# missing where it may. Exit code 0: all that could be run passed; 1: something failed; 77: nothing could be run, with the
# reason as the last line. Usage: tests/boards.sh
set -u
cd "$(dirname "$0")/.."
root="$PWD"
# Board crates share one folder, so that `core` is built once.
boards_target="${CARGO_TARGET_DIR:-$root/target}/boards"

say() { printf '\n-- %s\n' "$1"; }
fail() {
    printf 'boards: FAILED: %s\n' "$1"
    exit 1
}

. firmware/boards/toolchain.sh || exit 77

say "board programs for the emulated mps2-an386"
(cd firmware/boards/qemu-mps2 && CARGO_TARGET_DIR="$boards_target" board_cargo build --release --locked) || fail "qemu-mps2 does not build"

command -v qemu-system-arm >/dev/null 2>&1 || debian_install qemu-system-arm
if command -v qemu-system-arm >/dev/null 2>&1; then
    say "the emulated mps2-an386, the host program and the touches"
    cargo build --locked -p host --bin skin || fail "skin does not build"
    SKIN_QEMU_PROGRAMS="$boards_target/$TARGET/release" SKIN_PROGRAM="${CARGO_TARGET_DIR:-$root/target}/debug/skin" \
        cargo test --locked -p tests --test emulated -- --ignored || fail "the board on QEMU"
else
    say "skipped: no qemu-system-arm (apt-get install qemu-system-arm)"
fi
