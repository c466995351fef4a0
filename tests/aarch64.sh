#!/usr/bin/env bash
# Same seed, same bytes: the simulated board's golden test on an emulated 64-bit ARM processor. Uses the Rust toolchain's own
# aarch64-unknown-linux-gnu target where it is installed, else Debian's compiler and library. Installs with apt-get what is
# missing where it may. Exit code 0: the bytes are the same; 77: it could not be run, with the reason as the last line.
# Takes some minutes to half an hour. Usage: tests/aarch64.sh
set -u
cd "$(dirname "$0")/.."
target=aarch64-unknown-linux-gnu
folder="${CARGO_TARGET_DIR:-$PWD/target}/aarch64"
mkdir -p "$folder"
folder="$(cd "$folder" && pwd)"

install() {
    command -v apt-get >/dev/null 2>&1 && [ "$(id -u)" = 0 ] || return 1
    apt-get install -y -qq --no-install-recommends "$@" >/dev/null 2>&1 ||
        { apt-get update -qq >/dev/null 2>&1 && apt-get install -y -qq --no-install-recommends "$@" >/dev/null 2>&1; }
}
have() { command -v "$1" >/dev/null 2>&1; }
cannot() {
    echo "$1"
    exit 77
}

# foreign PACKAGE: unpacks the ARM build of a Debian package, without making ARM an architecture of this machine.
foreign() {
    local apt="$folder/apt"
    mkdir -p "$apt/lists/partial" "$apt/cache/archives/partial" "$folder/library"
    : >"$apt/status"
    local options=(-qq -o APT::Architecture=arm64 -o APT::Architectures::=arm64 -o "Dir::State=$apt"
        -o "Dir::State::status=$apt/status" -o "Dir::Cache=$apt/cache")
    apt-get "${options[@]}" update >/dev/null 2>&1
    (cd "$apt" && rm -f ./*.deb && apt-get "${options[@]}" download "$1" >/dev/null 2>&1 && dpkg -x ./*.deb "$folder/library")
}

have aarch64-linux-gnu-gcc || install gcc-aarch64-linux-gnu libc6-dev-arm64-cross ||
    cannot "no linker for $target: apt-get install gcc-aarch64-linux-gnu libc6-dev-arm64-cross"
have qemu-aarch64-static || install qemu-user-static || cannot "no emulator: apt-get install qemu-user-static"

if ! rustc --print target-libdir --target $target 2>/dev/null | xargs -r test -d; then
    library="$folder/library/usr/lib/rustlib/$target/lib"
    [ -x /usr/bin/rustc ] || install rustc-web || cannot "no compiler for $target: rustup target add $target"
    version=$(dpkg-query -W -f '${Version}' rustc-web 2>/dev/null) || cannot "no compiler for $target: rustup target add $target"
    [ -d "$library" ] || foreign "libstd-rust-web-dev=$version" && [ -d "$library" ] ||
        cannot "no library for $target: rustup target add $target"
    export RUSTC=/usr/bin/rustc CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUSTFLAGS="-L $library"
fi
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="qemu-aarch64-static -L /usr/aarch64-linux-gnu"
CARGO_TARGET_DIR="$folder" CARGO_PROFILE_RELEASE_DEBUG=false \
    cargo test --locked --release -p skin-hil-sim --test suite golden --target $target
