//! Processor time of this program's threads (Linux), by what they do.

use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::time::Instant;

/// How the threads of simulated boards are called.
const SIMULATED: &str = "skin-sim";

/// Processor time so far, of threads that have ended too.
#[derive(Debug, Default)]
pub(crate) struct Load {
    /// By the thread's number: whether it simulates a board, and its time, ns.
    threads: BTreeMap<u32, (bool, u64)>,
}

impl Load {
    /// Looks at all threads. Where the system does not tell there is nothing.
    pub(crate) fn look(&mut self) {
        let Ok(tasks) = fs::read_dir("/proc/self/task") else {
            return;
        };
        for task in tasks.flatten() {
            let read = |name: &str| fs::read_to_string(task.path().join(name)).ok();
            let number = task.file_name().to_str().and_then(|n| n.parse().ok());
            // The first of three numbers is the time on a processor.
            let ns = read("schedstat").and_then(|text| text.split_whitespace().next()?.parse().ok());
            if let (Some(number), Some(ns), Some(name)) = (number, ns, read("comm")) {
                self.threads.insert(number, (name.trim_end() == SIMULATED, ns));
            }
        }
    }

    /// Of simulated boards, or of all else, s.
    fn seconds(&self, simulated: bool) -> f64 {
        let of = self.threads.values().filter(|(is, _)| *is == simulated);
        1e-9 * of.map(|(_, ns)| *ns).sum::<u64>() as f64
    }
}

/// Seconds of a stretch of work: of processor time of this thread where the system tells (Linux), else by the clock.
pub(crate) struct Stretch {
    from: Instant,
    ns: Option<u64>,
}

impl Stretch {
    /// From now on.
    pub(crate) fn begin() -> Self {
        Self {
            from: Instant::now(),
            ns: Self::ns(),
        }
    }

    fn ns() -> Option<u64> {
        let text = fs::read_to_string("/proc/thread-self/schedstat").ok()?;
        text.split_whitespace().next()?.parse().ok()
    }

    /// So far.
    pub(crate) fn seconds(&self) -> f64 {
        match (self.ns, Self::ns()) {
            (Some(from), Some(to)) => 1e-9 * to.saturating_sub(from) as f64,
            _ => self.from.elapsed().as_secs_f64(),
        }
    }
}

impl fmt::Display for Load {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.threads.is_empty() {
            return Ok(());
        }
        let (simulated, rest) = (self.seconds(true), self.seconds(false));
        write!(f, "; processor time {rest:.1} s")?;
        if simulated > 0.0 {
            write!(f, ", and {simulated:.1} s of the simulated boards")?;
        }
        Ok(())
    }
}
