//! The marks of a guided calibration, one after the other: chosen, or from a list.

use inverse::learned::Marks;

/// Where to press next.
pub(super) struct Ways {
    /// In order.
    places_mm: Vec<[f64; 2]>,
    /// Those before were pressed.
    at: usize,
    /// By which they were chosen; none of a list.
    chosen: Option<Marks>,
}

impl Ways {
    /// As a list says.
    pub(super) const fn list(places_mm: Vec<[f64; 2]>) -> Self {
        Self {
            places_mm,
            at: 0,
            chosen: None,
        }
    }

    /// So many that tell most.
    pub(super) fn chosen(marks: Marks, count: usize) -> Self {
        Self {
            places_mm: marks.clone().list(count),
            at: 0,
            chosen: Some(marks),
        }
    }

    /// The mark to press now.
    pub(super) fn next_mm(&self) -> Option<[f64; 2]> {
        self.places_mm.get(self.at).copied()
    }

    /// It was pressed.
    pub(super) const fn press(&mut self) {
        self.at += 1;
    }

    /// The last one that was pressed is to be pressed again.
    pub(super) const fn back(&mut self) {
        self.at = self.at.saturating_sub(1);
    }

    /// The mark to press now is left out. Chosen ones have another in its place: where all the others tell least.
    pub(super) fn skip(&mut self) {
        if self.at >= self.places_mm.len() {
            return;
        }
        let skipped = self.places_mm.remove(self.at);
        let Some(chosen) = &mut self.chosen else { return };
        chosen.skip(skipped);
        let mut with = chosen.clone();
        self.places_mm.iter().for_each(|place| with.press(*place));
        if let Some(other) = with.next_mm() {
            self.places_mm.insert(self.at, other);
        }
    }

    /// So many of the next ones at most.
    pub(super) fn ahead(&self, count: usize) -> Vec<[f64; 2]> {
        self.places_mm.iter().skip(self.at).take(count).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::forward::Sheet;

    #[test]
    fn a_mark_that_is_skipped_has_another_in_its_place_and_the_rest_stay() {
        let mut ways = Ways::chosen(Marks::new(&Sheet::paper(), 6.0).unwrap(), 8);
        let before = ways.ahead(20);
        assert_eq!(before.len(), 8);
        ways.press();
        ways.skip();
        let after = ways.ahead(20);
        assert_eq!((after.len(), &after[1..]), (7, &before[2..]));
        assert!(!before.contains(&after[0]), "{after:?}");
        ways.back();
        assert_eq!(ways.next_mm(), Some(before[0]));
        let mut listed = Ways::list(vec![[1.0, 2.0], [3.0, 4.0]]);
        listed.skip();
        assert_eq!(listed.ahead(5), [[3.0, 4.0]]);
        listed.press();
        listed.skip();
        assert_eq!(listed.next_mm(), None);
    }
}
