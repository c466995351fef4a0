//! The command line word for word. `TRYCMD=overwrite cargo test -p host --test transcripts` writes them anew.

#[test]
fn transcripts() {
    trycmd::TestCases::new().case("tests/cli/*.trycmd");
}
