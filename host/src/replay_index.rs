//! Where in a recording what is: for replays that jump.

use crate::event::Event;
use crate::recorded::LiveRecord;
use anyhow::Result;
use recording::{Known, Reader, Topic};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Frames arrive so long before the steps that took them are recorded, ns, and as much longer as the recording itself says: a replay
/// looks for them from there on. How late a frame came itself the recording does not say, so that one may have come earlier still
/// ([`Index::earlier`]).
const LEAD_NS: u64 = 2_000_000_000;
/// A frame that did not come within so long before is not in the file, ns: more than memory has room for frames that wait.
const MOST_LEAD_NS: u64 = 600_000_000_000;

/// A baseline of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
struct BaselineSpan {
    /// Log time of its first step, ns.
    begun_ns: u64,
    /// From when on it was in force, ns; none where it never was.
    in_force_ns: Option<u64>,
}

/// A part of a recording that is played in one go.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Stretch {
    /// Where in the file it begins; none for its beginning.
    pub(crate) place: Option<u64>,
    /// Steps that were recorded before are no part of it, ns.
    pub(crate) begin_ns: u64,
    /// Pictures that were recorded before are passed over, ns.
    pub(crate) pictures_ns: u64,
    /// Whether it begins with a baseline, and so with a reconstruction of its own.
    pub(crate) anew: bool,
    /// Whether it ends once that is in force.
    pub(crate) to_baseline: bool,
    /// So long before its steps their frames are looked for, ns.
    lead_ns: u64,
}

impl Stretch {
    /// Whether frames may have come before it begins.
    pub(crate) fn may_be_earlier(&self) -> bool {
        self.place.is_some() && self.lead_ns < MOST_LEAD_NS
    }
}

/// What a recording holds when; times are log times, ns.
pub(crate) struct Index {
    known: Known,
    /// Chunks that can be begun with: time of the first message, and place.
    chunks: Vec<(u64, u64)>,
    baselines: Vec<BaselineSpan>,
    /// Steps and pictures were recorded so long after their frames were measured, at most. The first baseline's waited for the model of
    /// the sheet.
    latest_ns: u64,
    /// Of the first step and of the last one.
    pub(crate) began_ns: u64,
    pub(crate) ended_ns: u64,
}

impl Index {
    /// Reads a recording; none where it is told to stop, or nothing is in it.
    ///
    /// # Errors
    /// It cannot be read, or a step not be understood.
    pub(crate) fn of(path: &Path, stop: &AtomicBool) -> Result<Option<Self>> {
        let mut reader = Reader::open(path)?;
        let (mut chunks, mut baselines) = (Vec::new(), Vec::<BaselineSpan>::new());
        let (mut span, mut seen, mut is_away) = (None, None, false);
        let mut latest_ns = 0;
        while let Some(message) = reader.next()? {
            let (log_ns, topic) = (message.log_ns, message.topic);
            if matches!(topic, Some(Topic::Live | Topic::Touches)) {
                latest_ns = latest_ns.max(log_ns.saturating_sub(message.publish_ns));
            }
            let step = (topic == Some(Topic::Live))
                .then(|| serde_json::from_slice::<LiveRecord>(message.data))
                .transpose()?;
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            if seen != Some(reader.place()) {
                seen = Some(reader.place());
                // A board that was away then comes back on another port than the one that is opened first.
                if !is_away {
                    chunks.push((log_ns, reader.place()));
                }
            }
            if let Some(step) = step {
                let begins = matches!(step, LiveRecord::Tare | LiveRecord::Resume { .. }) || baselines.is_empty();
                if begins {
                    baselines.push(BaselineSpan {
                        begun_ns: log_ns,
                        in_force_ns: None,
                    });
                }
                match step {
                    LiveRecord::InForce { .. } => {
                        if let Some(last) = baselines.last_mut() {
                            last.in_force_ns.get_or_insert(log_ns);
                        }
                    }
                    LiveRecord::Event { said } => match said.event {
                        Event::BoardAway { .. } => is_away = true,
                        Event::BoardBack { .. } => is_away = false,
                        _ => {}
                    },
                    _ => {}
                }
            }
            if matches!(topic, Some(Topic::Live | Topic::Touches)) {
                let (_, ended_ns) = span.get_or_insert((log_ns, log_ns));
                *ended_ns = (*ended_ns).max(log_ns);
            }
        }
        let known = reader.known();
        Ok(span.map(|(began_ns, ended_ns)| Self {
            known,
            chunks,
            baselines,
            latest_ns,
            began_ns,
            ended_ns,
        }))
    }

    /// What is needed to read on from a place.
    pub(crate) fn known(&self) -> &Known {
        &self.known
    }

    /// The number of the baseline that was taken, or in force, at a time.
    fn baseline(&self, log_ns: u64) -> usize {
        self.baselines
            .partition_point(|b| b.begun_ns <= log_ns)
            .saturating_sub(1)
    }

    /// Where to begin for what was recorded from a time on, of frames that came so long before at most.
    fn place(&self, log_ns: u64, lead_ns: u64) -> Option<u64> {
        let wanted = log_ns.saturating_sub(lead_ns);
        let chunks = self.chunks.partition_point(|(begun_ns, _)| *begun_ns <= wanted);
        self.chunks.get(chunks.checked_sub(1)?).map(|(_, place)| *place)
    }

    /// The same part, with its frames looked for from twice as long before: the first of them was not in it.
    pub(crate) fn earlier(&self, part: &Stretch) -> Stretch {
        let lead_ns = part.lead_ns.saturating_mul(2);
        Stretch {
            place: self.place(part.begin_ns, lead_ns),
            lead_ns,
            ..*part
        }
    }

    /// What to play to be at a time, for a replay that has got as far as another one: where the baseline differs, that first.
    pub(crate) fn way(&self, from_ns: u64, to_ns: u64) -> Vec<Stretch> {
        let to_ns = to_ns.clamp(self.began_ns, self.ended_ns);
        let wanted = self.baseline(to_ns);
        let span = self.baselines.get(wanted);
        let in_force = |log_ns: u64| span.and_then(|b| b.in_force_ns).is_some_and(|since| since <= log_ns);
        let has_it = self.baseline(from_ns) == wanted && in_force(from_ns);
        let lead_ns = self.latest_ns.saturating_add(LEAD_NS);
        let mut way = Vec::new();
        // Before it was in force nothing was shown: it is taken again.
        if !has_it || !in_force(to_ns) {
            let begin_ns = span.map_or(0, |b| b.begun_ns);
            way.push(Stretch {
                place: self.place(begin_ns, lead_ns),
                begin_ns,
                pictures_ns: begin_ns,
                anew: true,
                to_baseline: in_force(to_ns),
                lead_ns,
            });
        }
        if in_force(to_ns) {
            way.push(Stretch {
                place: self.place(to_ns, lead_ns),
                begin_ns: to_ns,
                pictures_ns: to_ns,
                anew: false,
                to_baseline: false,
                lead_ns,
            });
        }
        way
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use recording::Writer;
    use serde_json::json;

    const S: u64 = 1_000_000_000;

    /// The frames of the first baseline wait for the model of the sheet, on a busy machine for longer than any picture later on.
    #[test]
    fn a_baseline_is_played_from_its_first_frame_on_however_late_it_was_taken() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("late.mcap");
        let mut writer = Writer::create(&path).unwrap();
        let mut put = |topic, log_s: u64, measured_s: u64, message: &str| {
            writer
                .message(topic, log_s * S, measured_s * S, message.as_bytes())
                .unwrap();
            // Every second has a chunk of its own.
            writer.flush().unwrap();
        };
        for s in 100..140 {
            put(Topic::Board, s, s, "a frame");
            match s {
                // Taken 20 s after they were measured.
                120 | 121 => put(
                    Topic::Live,
                    s,
                    s - 20,
                    &json!({"step": "baseline", "frame": s - 120, "left": 121 - s}).to_string(),
                ),
                122 => put(
                    Topic::Live,
                    s,
                    s,
                    &json!({"step": "in_force", "note": null}).to_string(),
                ),
                125.. => put(Topic::Touches, s, s, "{}"),
                _ => {}
            }
        }
        writer.finish().unwrap();
        let index = Index::of(&path, &AtomicBool::new(false)).unwrap().unwrap();
        let first_ns = |place: Option<u64>| {
            let mut reader = match place {
                Some(place) => Reader::open_at(&path, index.known(), place).unwrap(),
                None => Reader::open(&path).unwrap(),
            };
            reader.next().unwrap().unwrap().log_ns
        };
        let way = index.way(index.ended_ns, 130 * S);
        assert_eq!(way.len(), 1, "{way:?}");
        let way = index.way(index.began_ns, 130 * S);
        let [baseline, there] = &way[..] else { panic!("{way:?}") };
        assert!(baseline.anew && baseline.to_baseline && !there.anew, "{way:?}");
        assert!(first_ns(baseline.place) <= 100 * S, "{way:?}");
        let began_ns = first_ns(there.place);
        assert!((100 * S..=130 * S - LEAD_NS).contains(&began_ns), "{way:?}");
        // Twice as long before, and so on to the beginning of the file.
        assert!(there.may_be_earlier());
        let mut earlier = index.earlier(there);
        assert!(first_ns(earlier.place) < began_ns, "{earlier:?}");
        while earlier.may_be_earlier() {
            earlier = index.earlier(&earlier);
        }
        assert_eq!((earlier.place, earlier.begin_ns), (None, there.begin_ns));
    }
}
