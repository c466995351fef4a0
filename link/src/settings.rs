//! What a board is set to and keeps: plan, watch, excitation, autostart.

use crate::ask::{PATIENCE, insist};
use crate::error::LinkError;
use crate::link::Link;
use protocol::{Baseline, Command, FromBoard, Notice, Plan, Status, ToBoard, Watch};
use std::time::{Duration, Instant};

/// What is in force on a board.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// What it is set to besides, and does.
    pub status: Status,
    /// What frames measure.
    pub plan: Plan,
    /// What is watched while nothing touches.
    pub watch: Option<Watch>,
}

/// What to change; `None` leaves it as it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Change {
    /// What frames measure.
    pub plan: Option<Plan>,
    /// What is watched, or nothing.
    pub watch: Option<Option<Watch>>,
    /// Amplitude of the source, in thousandths of full scale.
    pub excitation_permille: Option<u16>,
    /// Whether to start by itself at power-up.
    pub autostart: Option<bool>,
}

/// Asks for the status, and for what the board says before it: that it is careful, if so.
///
/// # Errors
/// [`LinkError`]: no answer, a lost port.
pub fn status(link: &Link) -> Result<(Status, Option<Notice>), LinkError> {
    let mut careful = None;
    let status = insist(link, "its status", &ToBoard::GetStatus, PATIENCE, |m| match m {
        FromBoard::Status(status) => Some(status),
        FromBoard::Notice(notice @ Notice::Careful { .. }) => {
            careful = Some(notice);
            None
        }
        _ => None,
    })?;
    Ok((status, careful))
}

/// Asks for everything.
///
/// # Errors
/// [`LinkError`]: no answer, a lost port.
pub fn read(link: &Link) -> Result<Settings, LinkError> {
    let (status, _) = status(link)?;
    let plan = insist(link, "its plan", &ToBoard::GetPlan, PATIENCE, |m| match m {
        FromBoard::Plan(plan) => Some(plan),
        _ => None,
    })?;
    let watch = insist(link, "its watch", &ToBoard::GetWatch, PATIENCE, |m| match m {
        FromBoard::Watch(watch) => Some(watch),
        _ => None,
    })?;
    Ok(Settings { status, plan, watch })
}

/// Changes what is in force. What the board refuses it leaves as it was, and so all that comes after it here.
///
/// # Errors
/// [`LinkError`]: a refusal with its reason, no answer, a lost port.
pub fn change(link: &Link, change: &Change) -> Result<(), LinkError> {
    if let Some(plan) = &change.plan {
        let command = ToBoard::SetPlan(plan.clone());
        insist(link, "the plan", &command, PATIENCE, |m| {
            matches!(m, FromBoard::Plan(p) if p == *plan).then_some(())
        })?;
    }
    if let Some(watch) = &change.watch {
        let command = ToBoard::SetWatch(watch.clone());
        insist(link, "the watch", &command, PATIENCE, |m| {
            matches!(m, FromBoard::Watch(w) if w == *watch).then_some(())
        })?;
    }
    if let Some(permille) = change.excitation_permille {
        order(link, ToBoard::SetExcitation(permille), Command::SetExcitation)?;
    }
    if let Some(on) = change.autostart {
        order(link, ToBoard::SetAutostart(on), Command::SetAutostart)?;
    }
    Ok(())
}

/// Stores what is in force, or forgets what is stored (`keep` false). The board stops meanwhile if it measures, and goes on
/// afterwards.
///
/// # Errors
/// [`LinkError`]: a store that does not work, no answer, a lost port.
pub fn store(link: &Link, keep: bool) -> Result<(), LinkError> {
    let running = read(link)?.status.running;
    if running {
        order(link, ToBoard::Stop, Command::Stop)?;
    }
    let stored = if keep {
        order(link, ToBoard::SaveSettings, Command::SaveSettings)
    } else {
        order(link, ToBoard::ForgetSettings, Command::ForgetSettings)
    };
    if running {
        order(link, ToBoard::Start, Command::Start)?;
    }
    stored
}

/// Lets the board learn anew what its watch takes for untouched, and waits for it; starts it for that if it is stopped.
///
/// # Errors
/// [`LinkError`]: the board has no watch, no answer, a lost port.
pub fn learn(link: &Link) -> Result<Baseline, LinkError> {
    /// Longer than any watch of use takes to learn.
    const LEARNING: Duration = Duration::from_secs(20);
    let running = read(link)?.status.running;
    order(link, ToBoard::TakeBaseline, Command::TakeBaseline)?;
    if !running {
        order(link, ToBoard::Start, Command::Start)?;
    }
    let end = Instant::now() + LEARNING;
    let learned = loop {
        let baseline = insist(link, "its baseline", &ToBoard::GetBaseline, PATIENCE, |m| match m {
            FromBoard::Baseline(baseline) => Some(baseline),
            _ => None,
        });
        match baseline {
            Ok(baseline) if baseline.scans == 0 && Instant::now() < end => {
                std::thread::sleep(Duration::from_millis(50));
            }
            Ok(baseline) if baseline.scans == 0 => {
                let (what, ms) = ("with the baseline that it learns", LEARNING.as_millis());
                break Err(LinkError::Silent { what, ms });
            }
            other => break other,
        }
    };
    if !running {
        order(link, ToBoard::Stop, Command::Stop)?;
    }
    learned
}

/// A command that is acknowledged. The store may take half a second to be erased.
fn order(link: &Link, command: ToBoard, expected: Command) -> Result<(), LinkError> {
    insist(link, "a command", &command, 2 * PATIENCE, |m| {
        matches!(m, FromBoard::Ack(c) if c == expected).then_some(())
    })
}
