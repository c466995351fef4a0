//! The help of the program itself, and the scripts of the shells.

use crate::program::{program, skin};

#[test]
fn help_is_one_screen_and_begins_with_examples() {
    let help = skin(&["--help"]);
    assert_eq!(help, skin(&["-h"]));
    let lines: Vec<&str> = help.lines().collect();
    assert!(lines.len() <= 40, "{} lines", lines.len());
    let widest = lines.iter().map(|l| l.chars().count()).max();
    assert!(widest <= Some(80), "{widest:?}");
    let examples = lines.iter().position(|l| l.starts_with("    skin")).unwrap();
    let usage = lines.iter().position(|l| l.starts_with("Usage")).unwrap();
    assert_eq!(
        lines[examples..usage]
            .iter()
            .filter(|l| l.starts_with("    skin"))
            .count(),
        3
    );
    // Every example is understood: its options are known, whatever becomes of it.
    for line in &lines[examples..usage - 1] {
        let command = line.trim().split("  ").next().unwrap();
        let words: Vec<&str> = command.split_whitespace().skip(1).collect();
        let mut help = words.clone();
        help.push("--help");
        assert!(program(&help).output().unwrap().status.success(), "{command}");
    }
}

#[test]
fn shells_are_told_every_command() {
    for shell in ["bash", "zsh", "fish"] {
        let script = skin(&["completions", shell]);
        for part in ["run", "record", "reconstruct", "completions", "baseline-frames"] {
            assert!(script.contains(part), "{shell}: {part}");
        }
    }
    assert_eq!(
        program(&["completions", "cmd"]).output().unwrap().status.code(),
        Some(2)
    );
}

/// A script that a shell cannot read would break whoever's shell loads it.
#[cfg(unix)]
#[test]
fn shells_read_their_scripts() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish"] {
        let file = folder.path().join(shell);
        std::fs::write(&file, skin(&["completions", shell])).unwrap();
        match std::process::Command::new(shell).arg("-n").arg(&file).output() {
            Ok(run) => assert!(
                run.status.success(),
                "{shell}: {}",
                String::from_utf8_lossy(&run.stderr)
            ),
            Err(why) => eprintln!("not tried: {shell}: {why}"),
        }
    }
}

/// What the environment names is used, and what it names wrongly is said.
#[test]
fn the_configuration_is_used() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("config.toml");
    std::fs::write(&file, "port = \"/dev/no-such-port\"\n").unwrap();
    let run = |command: &[&str], name: &str, value: &str| {
        let run = program(command)
            .env("SKIN_CONFIG", &file)
            .env(name, value)
            .output()
            .unwrap();
        (run.status.code(), String::from_utf8_lossy(&run.stderr).into_owned())
    };
    let (code, said) = run(&["hello"], "SKIN_LISTEN", "");
    assert!(
        code == Some(1) && said.contains("/dev/no-such-port: the port of the configuration"),
        "{said}"
    );
    let (code, said) = run(&["run", "--json"], "SKIN_PORT", "/dev/other-port");
    assert!(
        code == Some(1) && said.contains("/dev/other-port") && !said.contains("no-such-port"),
        "{said}"
    );
    // The simulated skin is no board.
    let (code, said) = run(&["hello", "--simulate"], "SKIN_LISTEN", "");
    assert!(code == Some(0), "{said}");
    std::fs::write(&file, "prot = \"x\"\n").unwrap();
    let (code, said) = run(&["hello"], "SKIN_LISTEN", "");
    assert!(
        code == Some(1) && said.contains("config.toml") && said.contains("prot"),
        "{said}"
    );
}

/// clap does not ask for what an option needs where that may not be given: every such option is refused by itself, before anything is
/// opened.
#[test]
fn an_option_is_refused_without_what_it_needs() {
    for (line, named) in [
        ("run --cells", "--json"),
        ("run --cells --no-open", "--cells"),
        ("paper --out d --gauge g.csv", "--from"),
        ("paper --out d --gauge g.csv --quick", "--gauge"),
        ("doctor --preset ideal", "--simulate"),
        ("doctor --preset ideal --port p", "--preset"),
        ("doctor --fault cable_pulled@5 --from r.mcap", "--fault"),
        ("hello --measured 100", "--phantom"),
        ("hello --measured 100 --no-test", "--measured"),
        ("hello --preset ideal --port p", "--preset"),
        ("hello --fault cable_pulled@5 --from r.mcap", "--fault"),
        ("sim --unpaced", "--pty"),
        ("sim --link l --bytes b", "--link"),
        ("sim --latency-ms 1 --truth t", "--latency-ms"),
        ("sim --unpaced --duration-s 1", "--unpaced"),
        ("check --baseline a", "TABLE"),
        ("check --baseline a --simulate", "--baseline"),
        ("check --drive current --port p", "--drive"),
        ("check --order pyeit --simulate", "--order"),
        ("check t.csv --variable v", "--order"),
        ("check --touch 1,2 --frame a --from r.mcap", "--frame"),
        ("check --radius-mm 5 --simulate", "--radius-mm"),
        ("calibrate presses --truth t.csv", "TABLE"),
        ("calibrate presses --truth t.csv --port p", "--truth"),
        ("calibrate presses --difference --simulate", "--difference"),
        ("reconstruct t.csv --variable v --baseline a", "--order"),
        ("reconstruct --from r.mcap --variable v", "--variable"),
        ("reconstruct t.csv --unit-v 1 --baseline a", "--unit-v"),
        ("settings set --threshold 3 --autostart on", "--watch"),
    ] {
        let words: Vec<&str> = line.split(' ').collect();
        let ended = program(&words).output().unwrap();
        let said = String::from_utf8(ended.stderr).unwrap();
        assert_eq!(ended.status.code(), Some(2), "{line}: {said}");
        assert!(said.contains(named), "{line}: {said}");
    }
}
