//! The drive's current through switches and sheet, and what of the circuit is broken.

use crate::head_room::Pickup;
use firmware::{MAX_CHANNELS, Route};
use forward::ElectrodeMatrix;

/// What is broken between source and converter; by default nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Broken {
    /// Electrodes whose wire is off, bit n for electrode n. An amplifier there sees the middle of the source, unless the
    /// source is connected to that electrode.
    pub open: u64,
    /// What the closed switches at the drive's positive and negative end have in addition, ohm.
    pub switches_ohm: [f64; 2],
    /// The amplifier of gain 0 gives nothing.
    pub amplifier_dead: bool,
    /// How much less near to the supply's ends that amplifier's first stage comes, V.
    pub reach_lost_v: f64,
    /// Channels whose own amplifiers give nothing where all pairs are sensed at once, bit n for channel n.
    pub channels_dead: u32,
    /// As `reach_lost_v`, in addition, of such channels' own amplifiers.
    pub channels_reach_lost_v: [f64; MAX_CHANNELS],
    /// The reference in the middle of the supply is at 0 V. Seen only where a supply is given.
    pub drive_reference_lost: bool,
    /// The reference of the amplifiers' outputs is at 0 V.
    pub converter_reference_lost: bool,
}

/// The drive's current through a sheet.
pub(crate) struct Current<'a> {
    sheet: &'a ElectrodeMatrix,
    plus: usize,
    minus: usize,
    /// Of the sheet between the drive's electrodes, and of everything between the source's ends.
    own_ohm: f64,
    all_ohm: f64,
    /// The switch at the positive end.
    first_ohm: f64,
    open: u64,
}

impl<'a> Current<'a> {
    pub(crate) fn new(sheet: &'a ElectrodeMatrix, route: &Route, switch_ohm: f64, broken: &Broken) -> Self {
        let (plus, minus) = (usize::from(route.drive.plus), usize::from(route.drive.minus));
        let [first_ohm, second_ohm] = broken.switches_ohm.map(|added| switch_ohm + added);
        let mut current = Self {
            sheet,
            plus,
            minus,
            own_ohm: 0.0,
            all_ohm: 0.0,
            first_ohm,
            open: broken.open,
        };
        current.own_ohm = current.potential_ohm(plus) - current.potential_ohm(minus);
        current.all_ohm = current.own_ohm + first_ohm + second_ohm;
        current
    }

    /// Potential of an electrode for 1 A, ohm.
    fn potential_ohm(&self, n: usize) -> f64 {
        let r = self.sheet.potentials_ohm();
        r[(n, self.plus)] - r[(n, self.minus)]
    }

    /// The same, as an amplifier sees it.
    fn seen_ohm(&self, n: usize) -> f64 {
        if self.open >> n & 1 == 1 && n != self.plus && n != self.minus {
            0.5 * (self.potential_ohm(self.plus) + self.potential_ohm(self.minus))
        } else {
            self.potential_ohm(n)
        }
    }

    /// What a pair sees of a voltage between the source's ends. Both ends on one electrode drive nothing.
    pub(crate) fn share(&self, a: usize, b: usize) -> f64 {
        if self.plus == self.minus {
            return 0.0;
        }
        (self.seen_ohm(a) - self.seen_ohm(b)) / self.all_ohm
    }

    pub(crate) fn pickup(&self, a: usize, b: usize) -> Pickup {
        let from_plus = |n| self.first_ohm + self.potential_ohm(self.plus) - self.seen_ohm(n);
        Pickup {
            to_plus_ohm: from_plus(a),
            to_minus_ohm: from_plus(b),
            drive_ohm: self.all_ohm,
        }
    }
}
