//! The baseline in force, those before it for an undo, and the last good one, stored for the next start.

use crate::files::baseline_file::{self, BaselineFileError, Stored, Subject, unix_s};
use crate::presses::store::try_folder;
use crate::say::say;
use anyhow::{Result, bail};
use hil_sim::BOARD_NAME;
use inverse::reference::baseline::Baseline;
use inverse::reference::departure::{Departure, DriftOptions};
use protocol::Hello;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};
use view::picture::BaselineNote;

/// Baselines that an undo can bring back, one after the other.
const EARLIER: usize = 4;

/// What is said where one is taken again.
pub(crate) const MOVED_SAID: &str = "the sheet moved while the baseline was taken: it is taken again, do not touch";

/// A baseline that is or was in force.
#[derive(Clone, Debug)]
struct Dated {
    is: Stored,
    /// Whether it comes from the file.
    from_file: bool,
    warning: Option<String>,
}

/// Where the last good baseline of a board is stored.
#[derive(Debug)]
struct Store {
    path: PathBuf,
    subject: Subject,
    /// What it holds, where that can be used.
    holds: Option<Stored>,
    /// Whether the next baseline is stored whatever it differs by.
    replace: bool,
    /// Whether it can be written to.
    writes: bool,
}

/// The baselines of a session.
#[derive(Debug, Default)]
pub(crate) struct Baselines {
    store: Option<Store>,
    now: Option<Dated>,
    earlier: Vec<Dated>,
}

/// The folder for what programs keep: on Windows that of local data, else as the XDG base directory specification says; absolute, or
/// not at all.
fn state_folder() -> Option<PathBuf> {
    let absolute = |name| std::env::var_os(name).map(PathBuf::from).filter(|p| p.is_absolute());
    if cfg!(windows) {
        return absolute("LOCALAPPDATA").map(|folder| folder.join("skin"));
    }
    let state = absolute("XDG_STATE_HOME").or_else(|| absolute("HOME").map(|home| home.join(".local/state")));
    state.map(|folder| folder.join("skin"))
}

/// Where what is known of boards is stored: in the folder that is named, else in that of the system, but for simulated ones.
pub(crate) fn state(named: Option<&Path>, simulated: bool) -> Option<PathBuf> {
    named
        .map(Path::to_owned)
        .or_else(|| state_folder().filter(|_| !simulated))
}

/// Where the baselines of a board are stored: in the folder that is named, else in that of the system, if the board is no simulated
/// one: that has no serial number of its own, and nobody comes back to it.
pub(crate) fn folder(named: Option<&Path>, hello: &Hello) -> Option<PathBuf> {
    state(named, hello.board == BOARD_NAME)
}

/// A time in its largest unit: 50 s, 3 min, 3 h, 2 days.
pub(crate) fn words(time: Duration) -> String {
    let s = time.as_secs();
    let units = [(172_800, 86_400, "days"), (7_200, 3_600, "h"), (120, 60, "min")];
    match units.iter().find(|(least, ..)| s >= *least) {
        Some((_, unit, name)) => format!("{} {name}", s / unit),
        None => format!("{s} s"),
    }
}

/// How long ago; 0 for a time to come, after a clock was set back.
pub(crate) fn age(of: &Stored) -> Duration {
    SystemTime::now().duration_since(of.taken).unwrap_or_default()
}

impl Baselines {
    /// Without a folder nothing is stored. `replace` stores the first baseline whatever the stored one is.
    pub(crate) fn new(folder: Option<&Path>, subject: Subject, replace: bool) -> Self {
        let store = folder.map(|folder| {
            let path = baseline_file::path(folder, &subject);
            let holds = match baseline_file::read(&path, &subject) {
                Ok(stored) => Some(stored),
                Err(BaselineFileError::Missing { .. }) => None,
                Err(why) => {
                    say!("{why}; the next baseline is not compared with it, and takes its place");
                    None
                }
            };
            let tried = try_folder(folder);
            if let Err(cause) = &tried {
                say!(
                    "warning: {}: cannot be written to ({cause}): no baseline of this run is stored; name another folder with --state-dir",
                    folder.display()
                );
            }
            Store {
                writes: tried.is_ok(),
                path,
                subject,
                holds,
                replace,
            }
        });
        Self {
            store,
            ..Self::default()
        }
    }

    /// Puts the stored baseline in force.
    ///
    /// # Errors
    /// There is none, or it is of another sheet, plan, board or number of electrodes.
    pub(crate) fn start_from_stored(&mut self) -> Result<Baseline> {
        let Some(store) = &self.store else {
            bail!("there is no folder with stored baselines; name one with --state-dir");
        };
        let stored = baseline_file::read(&store.path, &store.subject)?;
        say!("baseline of {} ago, from {}", words(age(&stored)), store.path.display());
        let baseline = stored.baseline.clone();
        self.now = Some(Dated {
            is: stored,
            from_file: true,
            warning: None,
        });
        Ok(baseline)
    }

    /// Takes note of a baseline that was taken just now: it is compared with the stored one, and takes its place where
    /// it differs by no more than noise and drift. One of a sheet that moved meanwhile is not stored.
    pub(crate) fn taken(&mut self, baseline: Baseline) {
        let is = Stored {
            baseline,
            taken: SystemTime::now(),
        };
        let at_start = self.now.is_none();
        let mut store = self.store.as_mut().filter(|_| is.baseline.moved == 0.0);
        let differs = store.as_mut().and_then(|store| store.keep(&is));
        if let Some(differs) = &differs {
            say!("warning: {differs}");
        }
        self.put(Dated {
            is,
            from_file: false,
            // Whoever takes one later may mean what lies there.
            warning: differs.filter(|_| at_start),
        });
    }

    fn put(&mut self, dated: Dated) {
        if let Some(before) = self.now.replace(dated) {
            self.earlier.push(before);
            let most = self.earlier.len().saturating_sub(EARLIER);
            self.earlier.drain(..most);
        }
    }

    /// The baseline to go back to: while another is being taken that in force, else the one before, which then is in force.
    pub(crate) fn undo(&mut self, taking: bool) -> Option<Baseline> {
        if !taking && let Some(before) = self.earlier.pop() {
            self.now = Some(before);
        } else if !taking || self.now.is_none() {
            say!("there is no earlier baseline to go back to");
            return None;
        }
        let now = self.now.as_ref()?;
        say!("back to the baseline of {} ago", words(age(&now.is)));
        Some(now.is.baseline.clone())
    }

    /// What is said of the baseline in force, on the page and in JSON. While another is being taken, an undo goes back to it.
    pub(crate) fn note(&self, taking: bool) -> Option<BaselineNote> {
        self.now.as_ref().map(|now| BaselineNote {
            taken_unix_s: unix_s(now.is.taken),
            stored: now.from_file,
            earlier: self.earlier.len() + usize::from(taking),
            warning: now.warning.clone(),
        })
    }
}

impl Store {
    /// Stores a baseline, unless it differs from the one that is stored: then it says so.
    fn keep(&mut self, new: &Stored) -> Option<String> {
        let compared = self.holds.as_ref().filter(|_| !self.replace).and_then(|holds| {
            let age_h = age(holds).as_secs_f64() / 3600.0;
            let departure = Departure::of(&new.baseline, &holds.baseline, age_h, &DriftOptions::default());
            if departure.is_none() {
                say!("the stored baseline has too few values to compare the new one with, which takes its place");
            }
            departure.filter(|d| d.differs).map(|d| (age(holds), d))
        });
        if let Some((age, departure)) = compared {
            say!(
                "the values changed by {:.2} % rms beside the common gain, noise and drift explain {:.2} %; the stored baseline is \
                 kept, --baseline replace puts a new one in its place",
                100.0 * departure.change,
                100.0 * departure.expected
            );
            return Some(format!(
                "the sheet differs from the baseline of {} ago: something may rest on it; start with --baseline stored or lift it \
                 and take a new one",
                words(age)
            ));
        }
        // That was said at the start.
        if !self.writes {
            return None;
        }
        match baseline_file::write(&self.path, &self.subject, new) {
            Ok(()) => {
                self.holds = Some(new.clone());
                self.replace = false;
            }
            Err(cause) => say!(
                "warning: {}: {cause}; the baseline is not stored, one that was stored before is kept",
                self.path.display()
            ),
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn baseline(v: f64) -> Baseline {
        Baseline {
            values_v: vec![v; 208],
            noise_v: 1e-4,
            deviations: Baseline::deviations_of(&[1e-4; 208], 24),
            frames: 24,
            unlike: 0,
            moved: 0.0,
        }
    }

    fn subject() -> Subject {
        let hello: protocol::Hello = hil_sim::SceneFile::demo(::forward::Sheet::paper())
            .board()
            .unwrap()
            .hello();
        Subject::new(
            &hello,
            &::forward::Sheet::paper(),
            &protocol::Plan::adjacent(16).unwrap(),
        )
    }

    #[test]
    fn undo_brings_back_the_last_few_in_turn() {
        let mut baselines = Baselines::default();
        assert_eq!((baselines.undo(false), baselines.undo(true)), (None, None));
        for k in 0..8 {
            baselines.taken(baseline(f64::from(k)));
        }
        assert_eq!(baselines.note(false).unwrap().earlier, EARLIER);
        // While another is being taken: that in force.
        assert_eq!(baselines.note(true).unwrap().earlier, EARLIER + 1);
        assert_eq!(baselines.undo(true), Some(baseline(7.0)));
        for k in [6.0, 5.0, 4.0, 3.0] {
            assert_eq!(baselines.undo(false), Some(baseline(k)));
        }
        assert_eq!(baselines.undo(false), None);
        assert_eq!(baselines.note(false).unwrap().earlier, 0);
    }

    #[test]
    fn a_baseline_that_differs_is_not_stored_unless_it_is_to_be() {
        let folder = tempfile::tempdir().unwrap();
        let start = |replace| Baselines::new(Some(folder.path()), subject(), replace);
        let path = baseline_file::path(folder.path(), &subject());
        let holds = || std::fs::read(&path).unwrap();
        let pressed = || {
            let mut pressed = baseline(1.0);
            pressed.values_v[4] = 1.1;
            pressed
        };
        let mut first = start(false);
        first.taken(baseline(1.0));
        let untouched = holds();

        let mut second = start(false);
        second.taken(pressed());
        let warning = second.note(false).unwrap().warning.unwrap();
        // How many seconds ago depends on the machine.
        let told = warning.split_once("the sheet differs from the baseline of ");
        assert!(told.is_some_and(|(_, age)| age.contains(" s ago")), "{warning}");
        assert!(holds() == untouched);
        // One that was asked for later is kept from the file too, but not warned of on the page.
        first.taken(pressed());
        assert_eq!(first.note(false).unwrap().warning, None);
        assert!(holds() == untouched);

        start(true).taken(pressed());
        assert!(holds() != untouched);
    }

    #[test]
    fn a_folder_that_cannot_be_written_keeps_no_baseline_from_being_in_force() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "").unwrap();
        let mut baselines = Baselines::new(Some(&file), subject(), true);
        baselines.taken(baseline(1.0));
        assert!(baselines.note(false).is_some_and(|n| !n.stored && n.warning.is_none()));
    }

    #[test]
    fn ages_are_told_in_their_largest_unit() {
        let texts = [
            (0, "0 s"),
            (119, "119 s"),
            (120, "2 min"),
            (10_900, "3 h"),
            (200_000, "2 days"),
        ];
        for (seconds, text) in texts {
            assert_eq!(words(Duration::from_secs(seconds)), text);
        }
    }
}
