//! The command line word for word. `TRYCMD=overwrite cargo test -p host --test suite transcripts` writes them anew.

#[test]
fn transcripts() {
    let cases = trycmd::TestCases::new();
    // On a slow machine more would be said than on a fast one.
    cases.env("SKIN_NO_PROGRESS", "1");
    cases.case("tests/cli/*.trycmd");
}
