//! The program as a user starts it.

use serde_json::Value;
use std::path::Path;
use std::process::{Child, Command, Output};

/// The program with these arguments.
pub(crate) fn program(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_skin"));
    // On a slow machine more would be said than on a fast one.
    command.args(arguments).env("SKIN_NO_PROGRESS", "1");
    command
}

/// What becomes of it.
pub(crate) fn output(arguments: &[&str]) -> Output {
    program(arguments).output().unwrap()
}

/// What the program prints when it succeeds.
pub(crate) fn skin(arguments: &[&str]) -> String {
    let run = output(arguments);
    assert!(run.status.success(), "{arguments:?}: {}", said(&run));
    String::from_utf8(run.stdout).unwrap()
}

/// What it said on stderr.
pub(crate) fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A path as an argument.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A program that ends with the test, whatever becomes of it.
pub(crate) struct Started(pub(crate) Child);

impl Started {
    pub(crate) fn new(command: &mut Command) -> Self {
        Self(command.spawn().unwrap())
    }

    pub(crate) fn kill(&mut self) {
        // Perhaps it has ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        self.kill();
    }
}

/// The lines of JSON that were printed.
pub(crate) fn lines(output: &Output) -> Vec<Value> {
    assert!(output.status.success(), "{}", said(output));
    let lines = output.stdout.split(|b| *b == b'\n').filter(|l| !l.is_empty());
    lines.map(|line| serde_json::from_slice(line).unwrap()).collect()
}

/// Those of a kind, without what is of the moment when they were printed: the time that solving took, the time, the baseline's age.
fn of_kind(output: &Output, kind: &str) -> Vec<Value> {
    let of_kind = lines(output).into_iter().filter(|line| line["kind"] == kind);
    let without_time = |mut line: Value| {
        let fields = line.as_object_mut().unwrap();
        fields.remove("unix_s").unwrap();
        fields.remove("solve_us");
        if let Some(baseline) = fields.get_mut("baseline") {
            baseline.as_object_mut().unwrap().remove("age_s").unwrap();
        }
        line
    };
    of_kind.map(without_time).collect()
}

/// The pictures.
pub(crate) fn pictures(output: &Output) -> Vec<Value> {
    of_kind(output, "picture")
}

/// What happened beside them.
pub(crate) fn events(output: &Output) -> Vec<Value> {
    of_kind(output, "event")
}
