#!/usr/bin/env bash
# The firmware as Cortex-M programs: builds every board and runs its tests in emulation. Installs with apt-get what is
# missing where it may. Exit code 0: all that could be run passed; 1: something failed; 77: nothing could be run, with the
# reason as the last line. Usage: tests/boards.sh
set -u
cd "$(dirname "$0")/.."
root="$PWD"
target="${CARGO_TARGET_DIR:-$root/target}"
# Board crates share one folder, so that `core` is built once.
boards_target="$target/boards"
programs="$boards_target/programs"
mkdir -p "$programs"

# say STEP: ends the step before, with its time, and begins another.
step_began=$SECONDS
say() {
    printf -- '-- %d s\n\n-- %s\n' $((SECONDS - step_began)) "$1"
    step_began=$SECONDS
}
fail() {
    printf 'boards: FAILED: %s\n' "$1"
    exit 1
}

. boards/toolchain.sh || exit 77

# in_board FOLDER ARGUMENTS...: cargo in a board's folder, where its target and linker are set.
in_board() {
    local folder="$1"
    shift
    (cd "boards/$folder" && CARGO_TARGET_DIR="$boards_target" board_cargo "$@")
}

# Most of what follows keeps one processor busy at a time: these run beside it.
# The emulator's crate asks for a newer Rust than it needs.
emulator() { (cd boards/emulator && CARGO_TARGET_DIR="$target/emulator" cargo test --locked --ignore-rust-version "$@"); }
clippy() {
    for features in laws st-link; do
        in_board stm32f4 clippy --locked --features "$features" -- -D warnings || return 1
    done
    in_board stm32f4 clippy --locked --features defmt -- -D warnings || return 1
    in_board stm32h7 clippy --locked --features laws -- -D warnings || return 1
    in_board stm32h7 clippy --locked --features defmt -- -D warnings || return 1
    in_board template clippy --locked -- -D warnings || return 1
    in_board qemu-mps2 clippy --locked -- -D warnings
}
beside() {
    if has_board_clippy; then clippy || return 1; fi
    emulator --no-run
}
beside >"$programs/beside.log" 2>&1 &
beside=$!
trap 'kill "$beside" 2>/dev/null' EXIT

say "the STM32F4's program, for each chip, within 144 KiB of flash and 8 KiB of RAM"
for chip in f446 f427 f405; do
    in_board stm32f4 build --release --locked --bin skin-board --no-default-features --features "$chip" || fail "stm32f4 ($chip) does not build"
    cp "$boards_target/$TARGET/release/skin-board" "$programs/$chip"
done

say "the same for the serial port of a Nucleo's debugger, and the laws of its front end"
in_board stm32f4 build --release --locked --bin skin-board --no-default-features --features f446,st-link || fail "stm32f4 (st-link) does not build"
cp "$boards_target/$TARGET/release/skin-board" "$programs/st-link"
in_board stm32f4 build --release --locked --bin laws --features laws || fail "the laws do not build"
cp "$boards_target/$TARGET/release/laws" "$programs/laws"

say "the STM32F4's hot path links without a way to panic, and not with one planted"
in_board stm32f4 build --release --locked --bin hot-path || fail "the hot path can panic"
if in_board stm32f4 build --release --locked --bin hot-path --features fault-hot-path >"$programs/hot-path.log" 2>&1; then
    fail "a planted panic in the hot path was not found"
fi
grep -q the_hot_path_can_panic "$programs/hot-path.log" || fail "the hot path with a planted panic does not build for another reason: $programs/hot-path.log"

say "the same program with planted faults"
for fault in routing break settling timer phase request panic hang; do
    in_board stm32f4 build --release --locked --bin skin-board --features "fault-$fault" 2>/dev/null || fail "fault-$fault does not build"
    cp "$boards_target/$TARGET/release/skin-board" "$programs/fault-$fault"
done

say "with its log over the debug probe"
in_board stm32f4 build --release --locked --bin skin-board --features defmt || fail "stm32f4 (defmt) does not build"
cp "$boards_target/$TARGET/release/skin-board" "$programs/defmt"

say "clippy on the board crates, warnings denied: every unsafe block has its argument; the emulator's build"
wait "$beside"
built=$?
cat "$programs/beside.log"
[ "$built" = 0 ] || fail "clippy on the board crates, or the emulator does not build"
has_board_clippy || say "skipped: clippy on the board crates: none for their compiler (rustup component add clippy, or apt-get install rust-web-clippy)"

# What needs the STM32F4's programs alone runs beside the builds that follow.
of_stm32f4=(careful:: panics:: programs:: trouble::)
SKIN_STM32_PROGRAMS="$programs" emulator -- --nocapture --test-threads 1 "${of_stm32f4[@]}" >"$programs/of_stm32f4.log" 2>&1 &
alone=$!
trap 'kill "$alone" 2>/dev/null' EXIT

say "the STM32H743's program, and the laws of its front end"
in_board stm32h7 build --release --locked || fail "stm32h7 does not build"
cp "$boards_target/$TARGET/release/skin-board-h743" "$programs/h743"
in_board stm32h7 build --release --locked --bin laws-h743 --features laws || fail "stm32h7: the laws do not build"
cp "$boards_target/$TARGET/release/laws-h743" "$programs/h743-laws"

say "the STM32H743's with planted faults"
for fault in routing break settling timer phase request hang; do
    in_board stm32h7 build --release --locked --bin skin-board-h743 --features "fault-$fault" 2>/dev/null || fail "stm32h7: fault-$fault does not build"
    cp "$boards_target/$TARGET/release/skin-board-h743" "$programs/h743-fault-$fault"
done

say "the STM32H743's with its settings in memory with check bits, and one that does not expect these to be wrong"
for program in check-bits:emulated-check-bits fault-read:emulated-check-bits,fault-read; do
    in_board stm32h7 build --release --locked --bin skin-board-h743 --features "${program#*:}" 2>/dev/null || fail "stm32h7: ${program%%:*} does not build"
    cp "$boards_target/$TARGET/release/skin-board-h743" "$programs/h743-${program%%:*}"
done

say "the STM32H743's with its log over the debug probe"
in_board stm32h7 build --release --locked --bin skin-board-h743 --features defmt || fail "stm32h7 (defmt) does not build"
cp "$boards_target/$TARGET/release/skin-board-h743" "$programs/h743-defmt"

say "without the log both are, byte for byte, the images of sources that never heard of one"
copy="$boards_target/without-log"
# copied_images WHICH SUFFIX: builds both programs of the copy and keeps what of them goes into the chips.
copied_images() {
    for board in stm32f4:skin-board stm32h7:skin-board-h743; do
        local folder="${board%:*}" name="${board#*:}"
        (cd "$copy/boards/$folder" && CARGO_TARGET_DIR="$boards_target" board_cargo build --release --bin "$name") || fail "$1 does not build: $folder"
        "$root/tests/image.py" "$boards_target/$TARGET/release/$name" >"$programs/$folder-$2.image" || fail "$1 has no image: $folder"
    done
}
rm -rf "$copy"
mkdir -p "$copy"
tar -c --exclude target Cargo.toml protocol firmware boards/stm32f4 boards/stm32h7 | tar -x -C "$copy"
sed -i 's/^members = .*/members = ["protocol", "firmware"]/' "$copy/Cargo.toml"
# What a program says of its sources' state is asked for anew: else the first copy says what the original does.
touch "$copy"/boards/*/build.rs
copied_images "the copy" with-log-off
# Lines become empty ones: the places of panics stay the same.
find "$copy" -name '*.rs' -exec sed -i -E 's/^.*(log!\(|feature = "defmt"|macro_use|mod log;|log::tell|\/log\.rs").*$//' {} +
find "$copy" -name log.rs -delete
if grep -rn defmt --include '*.rs' "$copy/protocol" "$copy/firmware" "$copy"/boards/*/src; then fail "these lines of the log could not be taken out"; fi
copied_images "the copy without the log's lines" without-log
for folder in stm32f4 stm32h7; do
    cmp "$programs/$folder-with-log-off.image" "$programs/$folder-without-log.image" || fail "$folder: the log changes the image where it is off"
done

say "board programs for the emulated mps2-an386"
in_board qemu-mps2 build --release --locked || fail "qemu-mps2 does not build"
in_board template build --release --locked || fail "template does not build"

say "the programs on an emulated STM32F427 and an emulated STM32H743, with the simulated skin on their pins"
SKIN_STM32_PROGRAMS="$programs" emulator -- --nocapture --test-threads 2 "${of_stm32f4[@]/#/--skip=}" || fail "the programs in emulation"
wait "$alone"
passed=$?
cat "$programs/of_stm32f4.log"
[ "$passed" = 0 ] || fail "the STM32F4's programs in emulation"

command -v qemu-system-arm >/dev/null 2>&1 || debian_install qemu-system-arm
if command -v qemu-system-arm >/dev/null 2>&1; then
    say "the emulated mps2-an386, the host program and the touches"
    # As tests/all.sh builds them, `skin` with them: nothing is built twice.
    every_test() { cargo test --workspace --locked --lib --bins --tests "$@"; }
    every_test --no-run || fail "the tests do not build"
    SKIN_QEMU_PROGRAMS="$boards_target/$TARGET/release" SKIN_PROGRAM="$target/debug/skin" \
        every_test -- --ignored --nocapture emulated:: || fail "the board on QEMU"

    say "the template of a board: every duty kept, and the host program's self-test passed"
    machine=(qemu-system-arm -M mps2-an386 -nographic -monitor none -semihosting-config "enable=on,target=native")
    timeout 300 "${machine[@]}" -serial null -kernel "$boards_target/$TARGET/release/template-laws" || fail "the template does not keep its duties"
    "${machine[@]}" -serial pty -kernel "$boards_target/$TARGET/release/template-board" >"$programs/template.log" 2>&1 &
    template=$!
    trap 'kill "$template" 2>/dev/null' EXIT
    for _ in $(seq 300); do
        port="$(grep -o '/dev/pts/[0-9]*' "$programs/template.log")" && break
        sleep 0.1
    done
    "$target/debug/skin" hello --port "${port:-none}" || fail "the template does not pass its self-test"
    kill "$template"
else
    say "skipped: no qemu-system-arm (apt-get install qemu-system-arm)"
fi
printf -- '-- %d s\n' $((SECONDS - step_began))
