//! The pattern that a table's rows are of, and what is missing of it.

use ::forward::{Measurement, Pair, Pattern};
use std::collections::HashSet;

/// The pattern of a table.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TablePattern {
    /// Its name with the number of values: "adjacent, 100 of 208 values".
    pub name: String,
    /// Whether the rows are those of a rotating or a given pattern.
    pub known: bool,
    /// Measurements of the pattern that the table does not have.
    pub missing: Vec<Measurement>,
}

/// A measurement whatever the signs: either pair may be turned round.
fn unsigned(m: Measurement) -> [Pair; 2] {
    [m.drive, m.sense].map(|p| if p.plus <= p.minus { p } else { p.reversed() })
}

impl TablePattern {
    /// Of rows on so many electrodes: a rotating pattern where all drive pairs are equally wide, and all sense pairs.
    pub(crate) fn of_rows(electrodes: usize, rows: &[Measurement]) -> Self {
        let width = |p: Pair| {
            let d = p.plus.abs_diff(p.minus);
            d.min(electrodes - d)
        };
        let only = |mut widths: Box<dyn Iterator<Item = usize> + '_>| {
            let first = widths.next()?;
            widths.all(|w| w == first).then_some(first)
        };
        let drive = only(Box::new(rows.iter().map(|m| width(m.drive))));
        let sense = only(Box::new(rows.iter().map(|m| width(m.sense))));
        let whole = drive.zip(sense).and_then(|(d, s)| {
            let name = match (d, s) {
                (1, 1) => "adjacent".to_owned(),
                (d, 1) if 2 * d == electrodes => "opposite".to_owned(),
                _ => format!("drive pairs {d} apart, sense pairs {s} apart"),
            };
            Some((name, Pattern::rotating(electrodes, d, s).ok()?))
        });
        match whole {
            Some((name, pattern)) => Self::against(&name, &pattern, rows),
            None => Self {
                name: format!("the table's own, {} values", rows.len()),
                known: false,
                missing: Vec::new(),
            },
        }
    }

    /// Of rows that are all that was measured, whatever of a rotating pattern was not.
    pub(crate) fn whole(electrodes: usize, rows: &[Measurement]) -> Self {
        let found = Self::of_rows(electrodes, rows);
        if found.missing.is_empty() {
            return found;
        }
        Self {
            name: format!("{}, all that its header announces", found.name),
            known: true,
            missing: Vec::new(),
        }
    }

    /// Of rows that should be of a given pattern.
    pub(crate) fn against(name: &str, pattern: &Pattern, rows: &[Measurement]) -> Self {
        let there: HashSet<[Pair; 2]> = rows.iter().map(|m| unsigned(*m)).collect();
        let missing: Vec<Measurement> = pattern
            .measurements()
            .iter()
            .filter(|m| !there.contains(&unsigned(**m)))
            .copied()
            .collect();
        let name = format!("{name}, {} of {} values", rows.len(), rows.len() + missing.len());
        Self {
            name,
            known: true,
            missing,
        }
    }

    /// What is missing, drive by drive; none where nothing is.
    pub(crate) fn missing_text(&self, rows: &[Measurement]) -> Option<String> {
        if self.missing.is_empty() {
            return None;
        }
        let pair = |p: Pair| format!("{}-{}", p.plus + 1, p.minus + 1);
        let driven: HashSet<Pair> = rows.iter().flat_map(|m| [m.drive, m.drive.reversed()]).collect();
        let mut parts: Vec<String> = Vec::new();
        for rows in self.missing.chunk_by(|a, b| a.drive == b.drive) {
            let drive = rows[0].drive;
            let list: Vec<String> = rows.iter().map(|m| pair(m.sense.reversed())).collect();
            parts.push(if driven.contains(&drive) {
                format!("drive {}: sense {}", pair(drive), list.join(", "))
            } else {
                format!("drive {}: all {}", pair(drive), list.len())
            });
        }
        let there: HashSet<[Pair; 2]> = rows.iter().map(|m| unsigned(*m)).collect();
        let spare = self.missing.iter().all(|m| there.contains(&unsigned(m.reciprocal())));
        let comfort = if spare {
            " (each has its reciprocal in the table)"
        } else {
            ""
        };
        Some(format!("{}; missing{comfort}: {}", self.name, parts.join("; ")))
    }
}

/// The first row that is not of the pattern, by number from 1.
pub(crate) fn foreign(pattern: &Pattern, rows: &[Measurement]) -> Option<(usize, Measurement)> {
    let allowed: HashSet<[Pair; 2]> = pattern.measurements().iter().map(|m| unsigned(*m)).collect();
    let found = rows.iter().enumerate().find(|(_, m)| !allowed.contains(&unsigned(**m)));
    found.map(|(k, m)| (k + 1, *m))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_taken_away_is_missing() {
        let adjacent = Pattern::adjacent(16).unwrap();
        let rows = adjacent.measurements();
        let whole = TablePattern::of_rows(16, rows);
        assert_eq!(
            (whole.name.as_str(), whole.missing.len()),
            ("adjacent, 208 of 208 values", 0)
        );
        let part = TablePattern::of_rows(16, &rows[..100]);
        assert_eq!(part.missing, rows[100..]);
        let text = part.missing_text(&rows[..100]).unwrap();
        assert!(
            text.starts_with("adjacent, 100 of 208 values; missing: drive 8-9: sense 13-14, 14-15, 15-16, 16-1; "),
            "{text}"
        );
        assert!(text.ends_with("drive 16-1: all 13"), "{text}");
    }

    #[test]
    fn signs_make_no_other_measurement() {
        let opposite = Pattern::opposite(16).unwrap();
        let turned: Vec<Measurement> = opposite
            .measurements()
            .iter()
            .map(|m| Measurement {
                drive: m.drive.reversed(),
                ..*m
            })
            .collect();
        let pattern = TablePattern::of_rows(16, &turned);
        assert_eq!(pattern.name, "opposite, 192 of 192 values");
        assert_eq!(foreign(&opposite, &turned), None);
        let strange = Pattern::adjacent(16).unwrap();
        assert_eq!(foreign(&opposite, strange.measurements()).map(|(k, _)| k), Some(1));
    }

    #[test]
    fn reciprocals_that_are_there_are_said() {
        let adjacent = Pattern::adjacent(16).unwrap();
        let half: Vec<Measurement> = adjacent
            .measurements()
            .iter()
            .filter(|m| m.drive.plus < m.sense.minus)
            .copied()
            .collect();
        assert_eq!(half.len(), 104);
        let text = TablePattern::of_rows(16, &half).missing_text(&half).unwrap();
        assert!(text.contains("each has its reciprocal"), "{text}");
    }
}
