//! What the help of a command begins with: how it is used most.

use clap::Command;

/// What to type, and what it gives.
type Example = [&'static str; 2];

/// Examples of every command.
const EXAMPLES: [(&str, &[Example]); 21] = [
    (
        "run",
        &[
            ["skin run", "the page, of the board on USB or of the simulated skin"],
            ["skin run --json --record", "lines on stdout, and a recording"],
            ["skin run --on tap 'aplay click.wav'", "a command at every tap"],
        ],
    ),
    (
        "record",
        &[
            ["skin record touches.mcap", "until Ctrl-C"],
            [
                "skin record --seconds 60",
                "a minute; the file is named by time and board",
            ],
            ["skin record robot.mcap --skins robot.toml", "several skins in one file"],
        ],
    ),
    (
        "replay",
        &[
            [
                "skin replay touches.mcap",
                "the page as it was; its slider goes anywhere",
            ],
            ["skin replay touches.mcap --json --speed max", "its lines, at once"],
            ["skin replay robot.mcap#palm", "one skin of several"],
        ],
    ),
    (
        "info",
        &[
            ["skin info touches.mcap", "length, board, sheet, frames, losses"],
            ["skin info robot.mcap#palm --json", "of one skin, for programs"],
        ],
    ),
    (
        "export",
        &[
            ["skin export touches.mcap --to npz", "numpy, in pyEIT's order"],
            ["skin export touches.mcap --to touches-csv", "one touch a line"],
            [
                "skin export touches.mcap --to parquet --out fleet",
                "tables of many recordings",
            ],
        ],
    ),
    (
        "dataset",
        &[
            [
                "skin dataset --scenes studies/scenes/touches.toml --count 100000 --out touches",
                "labelled frames to learn from",
            ],
            [
                "skin dataset --scenes s.toml --count 1000000 --out DIR --shard 3/16",
                "one job of sixteen",
            ],
        ],
    ),
    (
        "recover",
        &[["skin recover cut.mcap --out whole.mcap", "after a power cut"]],
    ),
    (
        "reconstruct",
        &[
            [
                "skin reconstruct frames.csv --baseline 1,2,3",
                "a table of this program",
            ],
            [
                "skin reconstruct frames.npy --order pyeit --baseline 1-8",
                "another tomograph's",
            ],
            [
                "skin reconstruct --from touches.mcap --png pictures",
                "a recording's frames",
            ],
        ],
    ),
    (
        "check",
        &[
            ["skin check", "of the board on USB, with nothing on the sheet"],
            [
                "skin check --touch 40,0",
                "with a finger there: tells turns and mirrors, too",
            ],
            ["skin check --from touches.mcap", "of a recording"],
        ],
    ),
    (
        "forward",
        &[
            ["skin forward", "the table of the untouched disc"],
            [
                "skin forward --touch 30,-20,12.5,0.2",
                "of a touch: x, y, radius in mm, rise",
            ],
            [
                "skin forward --sheet forearm.toml --csv",
                "of another sheet, for reconstruct",
            ],
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
        ],
    ),
    (
        "calibrate",
        &[
            [
                "skin calibrate --port /dev/ttyUSB0 --force-n 10",
                "from a press-and-hold with 10 N",
            ],
            ["skin calibrate --from hold.mcap --force-n 10", "from a recorded one"],
            ["skin calibrate --simulate", "how it goes, without a board"],
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
            ["skin hello --phantom 470", "the production test, on a ring of 470 ohm"],
            ["skin hello --simulate", "the simulated board"],
        ],
    ),
    (
        "sim",
        &[
            [
                "skin sim --pty --link /tmp/skin",
                "a serial port: skin run --port /tmp/skin",
            ],
            ["skin sim --scene hand", "a table of frames"],
            ["skin sim --pty --fault cable_pulled@5+2", "with something that breaks"],
        ],
    ),
    (
        "doctor",
        &[
            ["skin doctor", "the board on USB, with nothing on the sheet"],
            ["skin doctor --from touches.mcap", "what a recording tells"],
            [
                "skin doctor --simulate --fault electrode_open:3@0",
                "what a loose wire looks like",
            ],
        ],
    ),
    (
        "report",
        &[
            ["skin report", "a zip file with what whoever looks for a fault needs"],
            ["skin report --from touches.mcap fault.zip", "of a recording"],
        ],
    ),
    (
        "settings",
        &[
            ["skin settings", "what is set, and what is stored"],
            ["skin settings set --plan fast --autostart on", "sets and stores it"],
            ["skin settings forget", "as it was made, from the next start on"],
        ],
    ),
    (
        "completions",
        &[
            [
                "skin completions bash",
                "for ~/.local/share/bash-completion/completions/skin",
            ],
            ["skin completions zsh", "for \"${fpath[1]}/_skin\""],
            ["skin completions fish", "for ~/.config/fish/completions/skin.fish"],
        ],
    ),
];

/// What a command is, its examples, and then what clap says.
const TEMPLATE: &str = "{about-with-newline}\n{before-help}{usage-heading} {usage}\n\n{all-args}{after-help}";

/// The command line with its examples.
pub(crate) fn with_examples(mut command: Command) -> Command {
    for (name, examples) in EXAMPLES {
        let widest = examples.iter().map(|[line, _]| line.len()).max().unwrap_or(0);
        let lines: Vec<String> = examples
            .iter()
            .map(|[line, what]| format!("    {line:widest$}  {what}"))
            .collect();
        let text = lines.join("\n");
        command = command.mut_subcommand(name, |c| c.before_help(text).help_template(TEMPLATE));
    }
    command
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Cli;
    use clap::CommandFactory;

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
