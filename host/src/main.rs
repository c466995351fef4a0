//! The program `skin`.
#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(host::run(std::env::args_os()))
}
