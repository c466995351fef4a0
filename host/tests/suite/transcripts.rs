//! The command line word for word. `TRYCMD=overwrite cargo test -p host --test suite transcripts` writes them anew.

#[test]
fn transcripts() {
    trycmd::TestCases::new().case("tests/cli/*.trycmd");
}
