//! `skin settings`: what a board is set to and keeps.

use crate::board::{Choice, Connected};
use crate::recorded_board::{self, ONLY_LIVE, RecordedBoard};
use crate::usage::Usage;
use crate::{json, number, plan};
use anyhow::{Result, bail};
use clap::builder::RangedU64ValueParser;
use clap::{ArgGroup, Args, Subcommand, ValueEnum};
use link::plans::{PlanChoice, described};
use link::settings::{Change, change, learn, read, store};
use protocol::{Baseline, Hello, Plan, PlanName, QUARTERS, Status, Stored, Watch, Watching};
use serde_json::json;
use std::io::Write;

/// Arguments of `skin settings`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    action: Option<Action>,
    #[command(flatten)]
    board: Choice,
    #[command(flatten)]
    recorded: recorded_board::From,
    /// One JSON object on stdout.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// What is set and what is stored (what `skin settings` alone does).
    Show,
    /// Sets something, and stores it with all that is set.
    Set(Set),
    /// Stores what is set.
    Store,
    /// Forgets what is stored: from the next start on the board is as it was made.
    Forget,
    /// Learns anew what the watch takes for untouched; nothing may touch. A board does so at every start by itself.
    Baseline,
}

#[derive(Debug, Args)]
#[group(skip)]
#[command(group(ArgGroup::new("something").required(true).multiple(true)))]
struct Set {
    /// What frames measure.
    #[arg(long, value_name = "PLAN", group = "something", value_parser = plan::parser())]
    plan: Option<PlanChoice>,
    /// What the board does while nothing touches.
    #[arg(long, value_name = "WATCH", group = "something")]
    watch: Option<WatchName>,
    /// The watch wakes the board when the mean square of the changes is so many times their noise's [default: the watch's
    /// own: 6.25 for paper, 9 for sequential].
    #[arg(long, value_name = "TIMES", requires = "watch", allow_negative_numbers = true, value_parser = threshold())]
    threshold: Option<f64>,
    /// The board starts by itself at power-up.
    #[arg(long, value_name = "ON", group = "something")]
    autostart: Option<Switch>,
    /// Amplitude of the excitation, thousandths of full scale.
    #[arg(
        long,
        value_name = "PERMILLE",
        group = "something",
        value_parser = RangedU64ValueParser::<u16>::new().range(1..=1000)
    )]
    excitation: Option<u16>,
    /// Only until the board is reset, which opening its port does where reset is wired to RTS.
    #[arg(long)]
    no_store: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Switch {
    On,
    Off,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum WatchName {
    /// Frames all the time.
    None,
    /// The one that suits the board.
    Auto,
    /// Two drives, six pairs of each at once; a scan every 3.4 ms.
    Paper,
    /// Eight values one by one, for a board with one channel; a scan every 8.1 ms.
    Sequential,
}

impl WatchName {
    fn watch(self, board: &Hello) -> Result<Option<Watch>> {
        Ok(match self {
            Self::None => None,
            Self::Auto => match Watch::for_board(board) {
                None => bail!(
                    "there is no ready-made watch for {} electrodes, only for 16",
                    board.electrodes
                ),
                some => some,
            },
            Self::Paper => Some(Watch::paper()),
            Self::Sequential => Some(Watch::sequential()),
        })
    }
}

/// Runs the command.
///
/// # Errors
/// No board, or one that refuses.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let action = arguments.action.as_ref().unwrap_or(&Action::Show);
    if let Some(recorded) = arguments.recorded.board()? {
        if !matches!(action, Action::Show) {
            let why = "a recording only shows what was set; name the board with --port to change it";
            return Err(Usage(why.to_owned()).into());
        }
        let RecordedBoard { hello, source, .. } = &recorded;
        let shown = Shown {
            status: recorded.status,
            plan: &recorded.plan,
            watch: recorded.watch.as_ref().map(Option::as_ref),
        };
        if arguments.json {
            crate::say::stdout().write_all(&json::line(&as_json(&shown, None, hello, source))?)?;
        } else {
            describe(&shown, hello, source);
        }
        return Ok(());
    }
    let Connected {
        mut link,
        hello,
        source,
    } = arguments.board.connect()?;
    let before = read(&link)?;
    if before.status.running {
        link.leave_running();
    }
    let mut baseline = None;
    match action {
        Action::Show => {}
        Action::Set(set) => {
            change(&link, &set.change(&hello)?)?;
            if !set.no_store {
                store(&link, true)?;
            }
        }
        Action::Store => store(&link, true)?,
        Action::Forget => store(&link, false)?,
        Action::Baseline => {
            if before.watch.is_none() {
                bail!("the board has no watch, and so no baseline; set one with: skin settings set --watch auto");
            }
            baseline = Some(learn(&link)?);
        }
    }
    let settings = read(&link)?;
    let shown = Shown {
        status: Some(settings.status),
        plan: &settings.plan,
        watch: Some(settings.watch.as_ref()),
    };
    if arguments.json {
        crate::say::stdout().write_all(&json::line(&as_json(&shown, baseline.as_ref(), &hello, &source))?)?;
    } else {
        describe(&shown, &hello, &source);
        if let Some(baseline) = &baseline {
            println!(
                "baseline    of {} values from {} scans, noise {:.2} codes rms",
                baseline.values.len(),
                baseline.scans,
                noise_codes(baseline)
            );
        }
    }
    Ok(())
}

/// 256ths in 16 bits.
fn threshold() -> impl Fn(&str) -> Result<f64, String> + Clone {
    let wanted = "1 to 255; at 1 the noise alone wakes the board";
    number::allowed(wanted, |times| (1.0..=255.0).contains(&times))
}

impl Set {
    fn change(&self, board: &Hello) -> Result<Change> {
        let mut watch = self.watch.map(|w| w.watch(board)).transpose()?;
        if let Some(times) = self.threshold {
            match &mut watch {
                Some(Some(watch)) => watch.threshold = (times * 256.0).round() as u16,
                _ => bail!("--threshold is for a watch: name one with --watch"),
            }
        }
        Ok(Change {
            plan: self.plan.map(|p| p.plan(board)).transpose()?,
            watch,
            excitation_permille: self.excitation,
            autostart: self.autostart.map(|s| matches!(s, Switch::On)),
        })
    }
}

/// Root of the mean variance that the change test reckons with.
fn noise_codes(baseline: &Baseline) -> f64 {
    let sum: f64 = baseline.variance.iter().map(|v| f64::from(*v)).sum();
    (sum / baseline.variance.len().max(1) as f64 / 4096.0).sqrt()
}

/// The name of a watch that a board has in force, whatever its threshold.
fn watch_name(watch: &Watch) -> &'static str {
    let is = |ready: Watch| {
        *watch
            == Watch {
                threshold: watch.threshold,
                ..ready
            }
    };
    if is(Watch::paper()) {
        "paper"
    } else if is(Watch::sequential()) {
        "sequential"
    } else {
        "of its own"
    }
}

/// From one scan of the watch to the next, ms.
fn scan_ms(watch: &Watch, board: &Hello) -> f64 {
    let quarters = watch.recipe().quarters() + u32::from(watch.rest_quarters);
    1e3 * f64::from(quarters) / f64::from(QUARTERS) / board.excitation_hz()
}

fn doing(status: &Status) -> &'static str {
    match (status.running, status.watching) {
        (false, _) => "stopped",
        (true, Watching::Off) => "measuring",
        (true, Watching::Learning) => "learning the watch's baseline",
        (true, Watching::Asleep) => "watching, nothing touches",
        (true, Watching::Awake) => "measuring, something touches",
    }
}

/// What is in force; what a recording does not tell is none.
struct Shown<'a> {
    status: Option<Status>,
    plan: &'a Plan,
    /// The inner one is none without a watch.
    watch: Option<Option<&'a Watch>>,
}

fn describe(shown: &Shown<'_>, hello: &Hello, source: &str) {
    let Shown { status, plan, watch } = shown;
    println!("port        {source}");
    println!("board       {}, serial {}", hello.board, hello.serial);
    let name = PlanName::of(plan, hello.electrodes).map_or("of its own", PlanName::name);
    println!("plan        {name}: {}", described(plan.recipe(), hello));
    match watch {
        None => println!("watch       {ONLY_LIVE}"),
        Some(None) => println!("watch       none: frames all the time"),
        Some(Some(watch)) => println!(
            "watch       {}: {}, every {:.1} ms; threshold {}",
            watch_name(watch),
            described(watch.recipe(), hello),
            scan_ms(watch, hello),
            f64::from(watch.threshold) / 256.0
        ),
    }
    let Some(status) = status else {
        println!("the rest    {ONLY_LIVE}");
        return;
    };
    println!(
        "excitation  {:.1} % of {:.2} V",
        f64::from(status.excitation_permille) / 10.0,
        f64::from(hello.excitation_uv) * 1e-6
    );
    println!("autostart   {}", if status.autostart { "on" } else { "off" });
    println!("state       {}", doing(status));
    println!(
        "stored      {}",
        match status.stored {
            Stored::Nothing => "nothing: it starts as it was made",
            Stored::InForce => "all of this",
            Stored::Others => "other settings than these; `skin settings store` stores these",
            Stored::Unread => {
                "not looked at, since the board was restarted by its own faults; `skin settings store` stores these"
            }
            Stored::Unusable => "something that this firmware cannot use; `skin settings store` stores these",
        }
    );
}

fn as_json(shown: &Shown<'_>, baseline: Option<&Baseline>, hello: &Hello, source: &str) -> serde_json::Value {
    let Shown { status, plan, watch } = shown;
    let not_recorded = [
        watch.is_none().then_some(&["watch"][..]),
        status
            .is_none()
            .then_some(&["excitation_permille", "autostart", "running", "watching", "stored"][..]),
    ];
    let watch = watch.flatten().map(|w| {
        json!({
            "name": watch_name(w),
            "values": w.recipe().value_count(),
            "scan_ms": scan_ms(w, hello),
            "threshold": f64::from(w.threshold) / 256.0,
        })
    });
    let baseline = baseline.map(|b| {
        json!({
            "scans": b.scans,
            "values_codes": b.values.iter().map(|v| v.codes()).collect::<Vec<f64>>(),
            "noise_codes": b.variance.iter().map(|v| (f64::from(*v) / 4096.0).sqrt()).collect::<Vec<f64>>(),
        })
    });
    let frame_ms = 1e3 * f64::from(plan.quarters()) / f64::from(QUARTERS) / hello.excitation_hz();
    json!({
        "port": source,
        "board": hello.board.as_str(),
        "serial": hello.serial.as_str(),
        "plan": {
            "name": PlanName::of(plan, hello.electrodes).map(PlanName::name),
            "id": plan.id,
            "values": plan.value_count(),
            "frame_ms": frame_ms,
        },
        "watch": watch,
        "excitation_permille": status.map(|s| s.excitation_permille),
        "autostart": status.map(|s| s.autostart),
        "running": status.map(|s| s.running),
        "watching": status.map(|s| format!("{:?}", s.watching)),
        "stored": status.map(|s| format!("{:?}", s.stored)),
        "baseline": baseline,
        "not_recorded": not_recorded.into_iter().flatten().flatten().collect::<Vec<_>>(),
    })
}
