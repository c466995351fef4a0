#!/usr/bin/env bash
# Builds the fuzz targets with the coverage that libFuzzer looks at, on the stable toolchain, and runs them.
# Usage: fuzz/run.sh SECONDS [TARGET]...     (all targets one after another; 0 seconds: the seeds only)
# What a target finds is in fuzz/artifacts, what it learned in fuzz/corpus.
set -eu
cd "$(dirname "$0")"
seconds=${1:?usage: fuzz/run.sh SECONDS [TARGET]...}
shift
host=$(rustc -vV | sed -n 's/^host: //p')
# As cargo-fuzz does it, without a sanitizer, which needs nightly.
coverage="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 -Cllvm-args=-sanitizer-coverage-inline-8bit-counters \
-Cllvm-args=-sanitizer-coverage-pc-table -Cllvm-args=-sanitizer-coverage-trace-compares -Ccodegen-units=1 --cfg fuzzing"
RUSTFLAGS="$coverage" cargo build --locked --release --target "$host"

# Files to begin with.
seeds() {
    case $1 in
        tables) ls ../tests/data/*.csv ../host/tests/cli/*.csv ;;
        programs) ls seeds/programs/* ;;
        toml_files) ls ../hil-sim/scenes/*.toml ../host/tests/cli/*.toml ;;
    esac
}
[ "$#" -gt 0 ] || set -- decoder commands settings tables toml_files programs
failed=0
for target in "$@"; do
    mkdir -p "corpus/$target" artifacts
    for file in $(seeds "$target"); do cp "$file" "corpus/$target/"; done
    rounds=""
    [ "$seconds" = 0 ] && rounds=-runs=0
    printf '== %s\n' "$target"
    # An input that takes more than 10 s or 1 GB counts as found.
    "target/$host/release/$target" "corpus/$target" -max_total_time="$seconds" $rounds -timeout=10 -rss_limit_mb=1024 \
        -max_len=65536 -print_final_stats=1 -artifact_prefix="artifacts/$target-" || failed=1
done
exit $failed
