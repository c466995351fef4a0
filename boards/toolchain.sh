# Sets up cargo for the Cortex-M boards; to be sourced. Uses rustup's thumbv7em-none-eabihf target where it is installed,
# else Debian's rustc with its source (packages rustc-web, rust-web-src, lld), from which cargo builds `core` itself.
# Afterwards: board_cargo ARGUMENTS...   (in the board's folder), and has_board_clippy, which says whether its first argument
# can be `clippy`. Returns 1, having said why, where there is no compiler.

TARGET=thumbv7em-none-eabihf

debian_install() {
    command -v apt-get >/dev/null 2>&1 && [ "$(id -u)" = 0 ] || return 1
    # A list of packages that is old names an older compiler, which is too old.
    apt-get update -qq >/dev/null 2>&1
    apt-get install -y -qq "$@" >/dev/null 2>&1
}

debian_rust() { [ -x /usr/bin/rustc ] && [ -d /usr/lib/rustlib/src/rust/library/core ] && command -v ld.lld >/dev/null 2>&1; }

if rustc --print target-libdir --target $TARGET 2>/dev/null | xargs -r test -d; then
    board_cargo() { cargo "$@"; }
    has_board_clippy() { cargo clippy --version >/dev/null 2>&1; }
elif debian_rust || debian_install rustc-web rust-web-src lld && debian_rust; then
    board_cargo() {
        local subcommand="$1"
        shift
        # Debian's clippy fits Debian's compiler only, and cargo would find another one first.
        local cargo=(cargo)
        [ "$subcommand" != clippy ] || cargo=(/usr/bin/cargo-clippy)
        env RUSTC=/usr/bin/rustc RUSTC_BOOTSTRAP=1 CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER=ld.lld \
            "${cargo[@]}" "$subcommand" -Zbuild-std=core "$@"
    }
    has_board_clippy() { [ -x /usr/bin/cargo-clippy ] || debian_install rust-web-clippy && [ -x /usr/bin/cargo-clippy ]; }
else
    echo "no compiler for $TARGET: rustup target add $TARGET, or on Debian: apt-get install rustc-web rust-web-src lld"
    return 1
fi
