//! Files to record into: their names, and what is said of one that is closed.

use crate::ending;
use crate::recorded::SessionRecord;
use crate::say::{self, say};
use anyhow::{Context, Result, bail};
use recording::{Recorder, Tap, Topic, WaitingRecorder};
use serde::Serialize;
use std::path::Path;

/// Year, month, day of a day after 1970-01-01 (UTC); Hinnant's algorithm, with years that begin in March.
fn date(day: i64) -> (i64, i64, i64) {
    let z = day + 719_468;
    let era = z.div_euclid(146_097);
    let of_era = z.rem_euclid(146_097);
    let year = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let month_from_one = if month < 10 { month + 3 } else { month - 9 };
    let day = of_year - (153 * month + 2) / 5 + 1;
    (year + era * 400 + i64::from(month_from_one <= 2), month_from_one, day)
}

/// A time since 1970 as `20261122T123714Z`.
pub(crate) fn compact(unix_s: f64) -> String {
    let s = unix_s.max(0.0) as i64;
    let (year, month, day) = date(s / 86_400);
    let (h, m, s) = (s / 3600 % 24, s / 60 % 60, s % 60);
    format!("{year:04}{month:02}{day:02}T{h:02}{m:02}{s:02}Z")
}

/// The day of a time since 1970 (UTC) as `2026-11-22`.
pub(crate) fn day(unix_s: f64) -> String {
    in_words(unix_s).chars().take(10).collect()
}

/// A time since 1970 as `2026-11-22 12:37:14 UTC`.
pub(crate) fn in_words(unix_s: f64) -> String {
    let t = compact(unix_s);
    let part = |from: usize, to: usize| t.get(from..to).unwrap_or_default().to_owned();
    format!(
        "{}-{}-{} {}:{}:{} UTC",
        part(0, 4),
        part(4, 6),
        part(6, 8),
        part(9, 11),
        part(11, 13),
        part(13, 15)
    )
}

/// The name of a recording of a board. What no file's name should hold is left out of its serial number.
pub(crate) fn file_name(unix_s: f64, serial: &str) -> String {
    let serial: String = serial
        .chars()
        .filter(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_'))
        .collect();
    let serial = if serial.is_empty() { "board" } else { &serial };
    format!("skin-{}-{serial}.mcap", compact(unix_s))
}

/// A file to record into.
pub(crate) enum RecordTo {
    /// That was asked for: it is made before anything else is done.
    File(Recorder),
    /// Its name is that of the board.
    Named(WaitingRecorder),
    /// One of several skins: somebody else writes the file.
    Skin(Tap),
}

impl RecordTo {
    /// A recorder for this file, or for one with a name of its own.
    ///
    /// # Errors
    /// There is a file of that name, or it cannot be made.
    pub(crate) fn new(file: Option<&Path>) -> Result<Self> {
        Ok(match file {
            Some(file) => {
                let recorder = Recorder::create(file)?;
                ending::closes(&recorder);
                Self::File(recorder)
            }
            None => Self::Named(Recorder::waiting()),
        })
    }

    /// Hands over what there is to record.
    pub(crate) fn tap(&self) -> &Tap {
        match self {
            Self::File(recorder) => recorder.tap(),
            Self::Named(waiting) => waiting.tap(),
            Self::Skin(tap) => tap,
        }
    }

    /// Begins to write the recording of a session; none where somebody else writes the file.
    ///
    /// # Errors
    /// The file cannot be made.
    pub(crate) fn begin(self, session: &SessionRecord) -> Result<Option<Recorder>> {
        if let Self::Skin(tap) = self {
            tap.put(Topic::Session, None, session);
            return Ok(None);
        }
        let mut recorder = self.into_recorder(session.started_unix_s, session.name())?;
        recorder.begin(session)?;
        Ok(Some(recorder))
    }

    /// Begins to write the recording of several skins.
    ///
    /// # Errors
    /// The file cannot be made.
    pub(crate) fn begin_several(self, skins: &impl Serialize) -> Result<Recorder> {
        let started_unix_s = self.tap().clock().started_unix_s();
        let mut recorder = self.into_recorder(started_unix_s, "skins")?;
        recorder.begin_several(skins)?;
        Ok(recorder)
    }

    fn into_recorder(self, started_unix_s: f64, whose: &str) -> Result<Recorder> {
        let (recorder, file) = match self {
            Self::File(recorder) => (recorder, None),
            Self::Named(waiting) => {
                let file = file_name(started_unix_s, whose);
                let recorder = waiting.into_file(Path::new(&file))?;
                ending::closes(&recorder);
                (recorder, Some(file))
            }
            Self::Skin(_) => bail!("the recording is another skin's"),
        };
        say::record_to(recorder.tap());
        if let Some(file) = file {
            say!("recording into {file}");
        }
        Ok(recorder)
    }
}

/// Closes a recording and says what is in it.
///
/// # Errors
/// Not all could be written.
pub(crate) fn finish(recorder: Recorder) -> Result<()> {
    let file = recorder.file().to_owned();
    let counts = recorder.finish().context("the recording is not complete")?;
    say!(
        "{file}: {} frames in {} messages, {:.1} MB; skin replay shows it again",
        counts.frames,
        counts.messages,
        counts.file_bytes as f64 / 1e6
    );
    if counts.lost_messages > 0 || counts.lost_bytes > 0 {
        say!(
            "warning: {file}: the disk was too slow for {} messages and {} bytes of the port, which are missing",
            counts.lost_messages,
            counts.lost_bytes
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (unix_s, text) in [
            (0.0, "1970-01-01 00:00:00 UTC"),
            (951_782_400.0, "2000-02-29 00:00:00 UTC"),
            (1_700_000_000.9, "2023-11-14 22:13:20 UTC"),
            (4_107_542_399.0, "2100-02-28 23:59:59 UTC"),
            (4_107_542_400.0, "2100-03-01 00:00:00 UTC"),
        ] {
            assert_eq!(in_words(unix_s), text);
        }
        assert_eq!(
            file_name(1_700_000_000.0, "A/7..x y"),
            "skin-20231114T221320Z-A7xy.mcap"
        );
        assert_eq!(file_name(0.0, "/"), "skin-19700101T000000Z-board.mcap");
    }
}
