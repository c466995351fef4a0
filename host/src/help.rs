//! What the help of a command begins with: how it is used most. `--help` and `-h` are one screen, `skin help COMMAND` has every option.

use clap::{Arg, ArgAction, Command};

/// What to type, and what it gives.
type Example = [&'static str; 2];

/// Examples of every command.
const EXAMPLES: [(&str, &[Example]); 21] = [
    (
        "run",
        &[
            ["skin run", "the page, of the board or simulated"],
            ["skin run --json --record", "lines on stdout, and a recording"],
            ["skin run --on tap 'aplay click.wav'", "a command at every tap"],
        ],
    ),
    (
        "record",
        &[
            ["skin record touches.mcap", "until Ctrl-C"],
            ["skin record --seconds 60", "a minute, in a file of its own"],
            ["skin record robot.mcap --skins robot.toml", "several skins in one file"],
        ],
    ),
    (
        "replay",
        &[
            ["skin replay touches.mcap", "the page as it was"],
            ["skin replay touches.mcap --json --speed max", "its lines, at once"],
            ["skin replay robot.mcap#palm", "one skin of several"],
        ],
    ),
    (
        "info",
        &[
            ["skin info touches.mcap", "length, board, sheet, frames, losses"],
            ["skin info robot.mcap#palm", "of one skin of several"],
            ["skin info touches.mcap --json", "for programs"],
        ],
    ),
    (
        "export",
        &[
            ["skin export touches.mcap --to npz", "numpy, in pyEIT's order"],
            ["skin export touches.mcap --to touches-csv", "one touch a line"],
            ["skin export touches.mcap --to parquet --out fleet", "many in a table"],
        ],
    ),
    (
        "dataset",
        &[
            ["skin dataset --scenes s.toml --count 1000 --out DIR", "labelled frames"],
            [
                "skin dataset --scenes s.toml --count 9 --out DIR --format npz",
                "for numpy",
            ],
            [
                "skin dataset --scenes s.toml --count 9999 --out DIR --shard 3/16",
                "a part",
            ],
        ],
    ),
    (
        "recover",
        &[
            ["skin recover cut.mcap --out whole.mcap", "after a power cut"],
            ["skin recover robot.mcap --out all.mcap", "of several skins all"],
            ["skin recover usb/cut.mcap --out here.mcap", "from another disk"],
        ],
    ),
    (
        "reconstruct",
        &[
            ["skin reconstruct frames.csv --baseline 1,2,3", "our table"],
            ["skin reconstruct frames.npy --order pyeit --baseline 1-8", "another's"],
            ["skin reconstruct --from touches.mcap --png pictures", "a recording"],
        ],
    ),
    (
        "check",
        &[
            ["skin check", "the board, nothing on the sheet"],
            ["skin check --touch 40,0", "a finger there tells turns, too"],
            ["skin check --from touches.mcap", "of a recording"],
        ],
    ),
    (
        "forward",
        &[
            ["skin forward", "the table of the untouched disc"],
            ["skin forward --touch 30,-20,12.5,0.2", "x, y, radius in mm, rise"],
            ["skin forward --sheet forearm.toml --csv", "of another sheet"],
        ],
    ),
    (
        "bench",
        &[
            ["skin bench cost", "what a frame costs on this machine"],
            ["skin bench latency", "from a contact to its line and to the page"],
            ["skin bench --stress", "what must hold on any data"],
        ],
    ),
    (
        "paper",
        &[
            ["skin paper --out report --quick", "a first look, in 20 s"],
            ["skin paper --out report", "all of it, in 2 min"],
            ["skin paper --out report --from touches.mcap", "of a recorded run"],
        ],
    ),
    (
        "calibrate",
        &[
            ["skin calibrate --port /dev/ttyUSB0 --force-n 10", "press and hold 10 N"],
            ["skin calibrate --from hold.mcap --force-n 10", "from a recorded one"],
            ["skin calibrate --simulate", "without a board"],
        ],
    ),
    (
        "flash",
        &[
            ["skin flash firmware.elf", "the board on USB"],
            ["skin flash firmware.elf --manual", "with the boot pin set by hand"],
            ["skin flash firmware.elf --simulate", "how it goes, without a board"],
        ],
    ),
    (
        "list",
        &[
            ["skin list", "the boards on USB"],
            ["skin list tcp://robot:3333", "and one behind a bridge"],
            ["skin list --skins robot.toml", "which board is which skin"],
        ],
    ),
    (
        "hello",
        &[
            ["skin hello", "the board on USB"],
            ["skin hello --phantom 470", "on a ring of resistors of 470 ohm"],
            ["skin hello --from touches.mcap", "who the board of a recording was"],
        ],
    ),
    (
        "sim",
        &[
            ["skin sim --pty --link /tmp/skin", "a serial port, /tmp/skin"],
            ["skin sim --scene hand", "a table of frames"],
            ["skin sim --pty --fault cable_pulled@5+2", "with something that breaks"],
        ],
    ),
    (
        "doctor",
        &[
            ["skin doctor", "nothing on the sheet"],
            ["skin doctor --from touches.mcap", "what a recording tells"],
            ["skin doctor --simulate --fault electrode_open:3@0", "a loose wire"],
        ],
    ),
    (
        "report",
        &[
            ["skin report", "a zip file for who looks for a fault"],
            ["skin report --simulate fault.zip", "what such a file looks like"],
            ["skin report --from touches.mcap fault.zip", "of a recording"],
        ],
    ),
    (
        "settings",
        &[
            ["skin settings", "what is set, and what is stored"],
            ["skin settings set --plan fast --autostart on", "sets, and stores it"],
            ["skin settings --from touches.mcap", "of a recorded board"],
        ],
    ),
    (
        "completions",
        &[
            ["skin completions bash", "into ~/.local/share/bash-completion/"],
            ["skin completions zsh", "for \"${fpath[1]}/_skin\""],
            ["skin completions fish", "for ~/.config/fish/completions/skin.fish"],
        ],
    ),
];

/// Examples of commands of commands.
const OF_PARTS: [((&str, &str), [Example; 3]); 9] = [
    (
        ("bench", "skins"),
        [
            ["skin bench skins tables", "all tables of a folder"],
            ["skin bench skins tables --json", "for programs"],
            ["skin bench skins tables --svg skins.svg", "a picture, too"],
        ],
    ),
    (
        ("calibrate", "presses"),
        [
            ["skin calibrate presses --port /dev/ttyUSB0", "guides through presses"],
            ["skin calibrate presses --from presses.mcap", "of a recording"],
            ["skin calibrate presses --simulate", "without a board"],
        ],
    ),
    (
        ("calibrate", "marks"),
        [
            ["skin calibrate marks --svg marks.svg", "a drawing to print"],
            ["skin calibrate marks --count 50 --csv marks.csv", "a list of 50"],
            ["skin calibrate marks --sheet forearm.toml", "of another sheet"],
        ],
    ),
    (
        ("calibrate", "gcode"),
        [
            ["skin calibrate gcode --out press.gcode", "20 marks, and when and where"],
            ["skin calibrate gcode --out press.gcode --count 50", "more of them"],
            ["skin calibrate gcode --out press.gcode --depth-mm 2", "deeper"],
        ],
    ),
    (
        ("settings", "show"),
        [
            ["skin settings show", "what is set, and what is stored"],
            ["skin settings show --json", "for programs"],
            ["skin settings show --from touches.mcap", "of a recorded board"],
        ],
    ),
    (
        ("settings", "set"),
        [
            ["skin settings set --plan fast", "what a frame measures"],
            ["skin settings set --watch auto --autostart on", "starts by itself"],
            ["skin settings set --excitation 200 --no-store", "until the reset"],
        ],
    ),
    (
        ("settings", "store"),
        [
            ["skin settings store", "the board on USB"],
            ["skin settings store --port /dev/ttyUSB0", "by its port"],
            ["skin settings store --simulate", "without a board"],
        ],
    ),
    (
        ("settings", "forget"),
        [
            ["skin settings forget", "the board on USB"],
            ["skin settings forget --port /dev/ttyUSB0", "by its port"],
            ["skin settings forget --simulate", "without a board"],
        ],
    ),
    (
        ("settings", "baseline"),
        [
            ["skin settings baseline", "the board on USB"],
            ["skin settings baseline --port /dev/ttyUSB0", "by its port"],
            ["skin settings baseline --simulate", "without a board"],
        ],
    ),
];

/// Commands that ask a board and read no recording, and why.
const LIVE_ONLY: [(&str, &str); 3] = [
    ("run", "A recording is shown by skin replay FILE."),
    (
        "record",
        "What a recording holds is shown by skin replay FILE, and written by skin export FILE.",
    ),
    (
        "flash",
        "A program goes into a board: no recording takes the board's place.",
    ),
];

/// What a command is, its examples, and then what clap says.
const TEMPLATE: &str = "{about-with-newline}\n{before-help}{usage-heading} {usage}\n\n{all-args}{after-help}";

/// Examples, one a line.
fn lines_of(examples: &[Example]) -> String {
    let widest = examples.iter().map(|[line, _]| line.len()).max().unwrap_or(0);
    let line = |[line, what]: &Example| format!("    {line:widest$}  {what}");
    examples.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// Asks for one screen of help, by its short and its long name.
fn one_screen() -> Arg {
    let every = "This screen; 'skin help COMMAND' has every option";
    let of = Arg::new("help").short('h').long("help").global(true);
    of.action(ArgAction::HelpShort).help(every)
}

/// The command line with its examples.
pub(crate) fn with_examples(command: Command) -> Command {
    let mut command = command.disable_help_flag(true).arg(one_screen());
    for (name, examples) in EXAMPLES {
        let text = lines_of(examples);
        let why = LIVE_ONLY.iter().find(|(of, _)| *of == name).map(|(_, why)| *why);
        command = command.mut_subcommand(name, |c| {
            let mut c = c.before_help(text).help_template(TEMPLATE);
            for ((_, part), examples) in OF_PARTS.iter().filter(|((of, _), _)| *of == name) {
                c = c.mut_subcommand(part, |of| of.before_help(lines_of(examples)).help_template(TEMPLATE));
            }
            match why {
                Some(why) => c.after_help(why),
                None => c,
            }
        });
    }
    command
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Cli;
    use clap::CommandFactory;

    fn has(command: &Command, option: &str) -> bool {
        command.get_arguments().any(|a| a.get_long() == Some(option))
    }

    /// Every command that asks a board reads a recording, or says why it does not.
    #[test]
    fn what_asks_a_board_reads_a_recording() {
        fn asked(command: &Command, asking: &mut Vec<String>) {
            let name = command.get_name();
            let why = LIVE_ONLY.iter().find(|(of, _)| *of == name);
            if has(command, "port") {
                asking.push(name.to_owned());
                assert_ne!(has(command, "from"), why.is_some(), "{name}");
            }
            command.get_subcommands().for_each(|of| asked(of, asking));
        }
        let command = with_examples(Cli::command());
        let mut asking = Vec::new();
        command.get_subcommands().for_each(|of| asked(of, &mut asking));
        asking.sort();
        let expected = [
            "calibrate",
            "check",
            "doctor",
            "flash",
            "hello",
            "presses",
            "record",
            "report",
            "run",
            "settings",
        ];
        assert_eq!(asking, expected);
        for (name, why) in LIVE_ONLY {
            let help = command
                .clone()
                .try_get_matches_from(["skin", name, "-h"])
                .unwrap_err()
                .to_string();
            assert!(help.contains(why), "{help}");
        }
        // It asks no board, and takes the run in the place of its own.
        assert!(
            command
                .get_subcommands()
                .any(|of| of.get_name() == "paper" && has(of, "from"))
        );
    }

    /// Each begins with three examples and has at most 40 lines on a screen of 80 letters; what it leaves out is in the long help, which
    /// it names.
    #[test]
    fn every_help_is_one_screen() {
        const WIDTH: usize = 80;
        fn all(command: &Command, path: &[String], found: &mut Vec<Vec<String>>) {
            for of in command.get_subcommands().filter(|of| of.get_name() != "help") {
                let path = [path, &[of.get_name().to_owned()]].concat();
                found.push(path.clone());
                all(of, &path, found);
            }
        }
        let command = with_examples(Cli::command()).term_width(WIDTH);
        let mut paths = Vec::new();
        all(&command, &[], &mut paths);
        assert!(paths.len() > EXAMPLES.len(), "{paths:?}");
        for path in paths {
            let name = path.join(" ");
            let help = |before: &[&str], after: &[&str]| {
                let path = path.iter().map(String::as_str);
                let words = before.iter().copied().chain(path).chain(after.iter().copied());
                command.clone().try_get_matches_from(words).unwrap_err().to_string()
            };
            let [short, long] = [help(&["skin"], &["--help"]), help(&["skin", "help"], &[])];
            assert_eq!(short, help(&["skin"], &["-h"]), "{name}");
            assert!(short.contains("'skin help COMMAND' has every option"), "{short}");
            // A terminal breaks what is wider, such as clap's line of usage.
            let rows: usize = short
                .lines()
                .map(|line| line.chars().count().div_ceil(WIDTH).max(1))
                .sum();
            assert!(rows <= 40, "{name}: {rows} rows\n{short}");
            let wide = short
                .lines()
                .find(|line| line.chars().count() > WIDTH && !line.contains("skin "));
            assert_eq!(wide, None, "{name}");
            let usage = short.find("Usage:").unwrap();
            let examples: Vec<&str> = short[..usage]
                .lines()
                .filter(|line| line.starts_with("    skin "))
                .collect();
            assert_eq!(examples.len(), 3, "{name}: {short}");
            assert!(
                examples.iter().all(|line| line.chars().count() <= WIDTH),
                "{name}: {examples:#?}"
            );
            let of = path.iter().fold(&command, |of, name| of.find_subcommand(name).unwrap());
            for line in examples {
                let words: Vec<&str> = line.trim().split("  ").next().unwrap().split(' ').collect();
                // Commands in quotes are tried elsewhere.
                if !line.contains('\'') {
                    command.clone().try_get_matches_from(words).unwrap();
                }
            }
            for option in of.get_arguments().filter_map(clap::Arg::get_long) {
                assert!(long.contains(&format!("--{option}")), "{name}: --{option}");
            }
        }
    }

    #[test]
    fn every_command_has_examples_and_every_example_is_understood() {
        let command = with_examples(Cli::command());
        for of in command.get_subcommands() {
            let name = of.get_name();
            let (_, examples) = EXAMPLES.iter().find(|(of, _)| *of == name).unwrap();
            for [line, what] in *examples {
                let words: Vec<&str> = match line.split_once(" '") {
                    Some((before, quoted)) => before.split(' ').chain([quoted.trim_end_matches('\'')]).collect(),
                    None => line.split(' ').collect(),
                };
                assert_eq!(words[..2], ["skin", name]);
                command.clone().try_get_matches_from(words).unwrap();
                assert!(!what.is_empty());
            }
            let help = command.clone().try_get_matches_from(["skin", name, "-h"]);
            let help = help.unwrap_err().to_string();
            let at = |text: &str| help.find(text).unwrap_or_else(|| panic!("{name}: no {text} in {help}"));
            assert!(at(examples[0][0]) < at("Usage:"), "{help}");
        }
    }
}
