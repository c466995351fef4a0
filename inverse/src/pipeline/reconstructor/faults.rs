//! What is broken, from frame to frame.

use super::{Reconstructor, detector, has_detector};
use crate::change::detector::ChangeDetector;
use crate::quality::doubt::Doubt;
use crate::quality::fault_monitor::Seen;
use crate::reference::diagnosis::{Fault, Faults};
use crate::reference::drift::Drifting;
use crate::reference::imager::ImagerError;
use forward::Drive;

/// Misfit of the same touches beside a fault, over that without, from which the fault is one.
const BETTER: f64 = 0.7;

impl Reconstructor {
    /// A fault is over as soon as nothing touches and its values are those of the baseline.
    pub(super) fn look_for_end(&mut self, values: &[f64]) -> Result<(), ImagerError> {
        if self.broken.named().is_some() && !self.broken.leaks() {
            self.reference.difference_into(values, &mut self.whole)?;
            self.end_if_over();
        }
        Ok(())
    }

    /// Takes what a leak changes out of a frame; where it has gone, it is over.
    pub(super) fn take_leak_out(&mut self, values: &mut [f64]) -> Result<(), ImagerError> {
        // A frame of a table says nothing of the next one.
        if self.options.sequence && self.broken.leaks() {
            self.reference.difference_into(values, &mut self.whole)?;
            self.end_if_over();
            self.broken.without_leak(values, self.reference.baseline());
        }
        Ok(())
    }

    fn end_if_over(&mut self) {
        let Some(noise) = self.noise() else {
            return;
        };
        let sigma_v = noise.sigma * (1.0 + self.reference.baseline_share()).sqrt();
        if self.broken.is_over(&self.whole, self.reference.unchanged(), sigma_v) {
            self.broken.clear();
            self.left_changed = true;
            self.show_faults();
        }
    }

    /// Contacts that were decided on are named as what is broken in the frames that follow: their values are left out then, since no shapes
    /// are those of every change. True where that is so. A given current does not go with its wires: nothing but the shapes tells there
    /// that contacts are still changed.
    pub(super) fn hand_over_contacts(&mut self) -> bool {
        let decided = self.contacts.decided();
        let may = self.options.sequence && matches!(self.imager().drive, Drive::Voltage { .. });
        if !may || decided.is_empty() || !self.broken.name_contacts(decided) {
            return false;
        }
        self.instead_of = None;
        self.left_changed = true;
        self.solver.forget();
        true
    }

    /// Looks for what is broken in a frame that touches do not explain, or that a fault would explain as well. True where something
    /// else is known now.
    pub(super) fn look_for_faults(&mut self, blind: bool, due: bool) -> bool {
        let result = &self.result;
        let unexplained = blind
            || self.gain_jumped()
            || matches!(
                result.doubt,
                Some(
                    Doubt::NotThisSheet
                        | Doubt::NotTouches
                        | Doubt::NotReciprocal
                        | Doubt::FewValues { .. }
                        | Doubt::Gone { .. }
                )
            )
            || self.is_bare(1.0)
            || (self.solver.fits() && result.misfit.is_none() && result.changed)
            || self.faults.is_open()
            || self.faults.rejects();
        let (touches, misfit) = (result.touches.len(), result.misfit);
        // Contacts that changed by so much are no drift, and touches beside them may be what the linear shapes leave.
        let least = self.options.contacts.least_change;
        let is_known = |l: usize| self.contacts.changed().any(|known| known == l);
        let contacts = result.drift.contacts.iter().enumerate();
        let contacts = contacts
            .filter(|(l, change)| change.abs() > least && !is_known(*l))
            .count();
        // What drifting contacts explain, now and then, is no reason to forget a fault that the frames before told.
        let may = touches > 0 || self.broken.is_open() || self.contacts.is_sudden();
        let suspected = !unexplained && may && (contacts > 0 || self.broken.suspects(&self.whole, self.stretch()));
        let sigma_v = self.noise().or(result.noise).map(|n| n.sigma);
        let difference = if self.options.sequence && self.gain != self.sound_gain {
            // What a fault does to all values is not to be divided out.
            let mut frame = Vec::with_capacity(self.last.len());
            self.following.divide(&self.last, self.sound_gain, &mut frame);
            match self.reference.difference_into(&frame, &mut self.suspicious) {
                Ok(()) => &self.suspicious,
                Err(_) => &self.whole,
            }
        } else {
            &self.whole
        };
        let frame = (self.last.as_slice(), difference, self.reference.unchanged());
        let seen = Seen {
            unexplained,
            suspected,
            due,
            parts: self.solver.search_parts(self.broken.parts() - self.searched),
            sudden: self.contacts.is_sudden(),
        };
        let other = self.broken.take(frame, sigma_v, seen);
        self.solver.note_search_parts(self.broken.parts() - self.searched);
        if self.broken.found_nothing() {
            self.looked_gain = self.gain;
        }
        if !other {
            return false;
        }
        let named = self.broken.named();
        if named.is_some_and(|fault| !fault.leaves_touches()) {
            // What the fault did to all values is no gain.
            self.gain = self.sound_gain;
        }
        // What leaves no touches takes the place of all.
        let takes_some = |faults: &Faults| {
            faults.leaves_touches() && self.broken.is_suspected() && touches > 0 && !self.broken.is_alone()
        };
        let suspected = named.filter(takes_some);
        if let Some(fault) = suspected {
            self.instead_of = Some((fault, touches, misfit));
        } else if named.is_some() {
            self.contacts.unlearn_signs();
        }
        true
    }

    /// Takes a frame that was reconstructed: what comes and goes is looked for in the frames after it.
    pub(super) fn look_for_loose_contacts(&mut self, values: &[f64]) {
        let (Some(noise), Some(noises)) = (self.noise(), self.reference.value_noise()) else {
            return;
        };
        // A contact that fails may look like a finger that has gone from there.
        let unlike = self.unexplained > 0 || matches!(self.result.doubt, Some(Doubt::Gone { .. }));
        let flicker = self.flickers.take(values, &self.left.used, unlike, noises);
        let has_time = self.solver.search_parts(self.broken.parts() - self.searched) > 0;
        let seen = (&self.whole, noise.sigma);
        let named = self
            .broken
            .take_flicker((flicker, self.flickers.often()), seen, has_time);
        self.solver.note_search_parts(self.broken.parts() - self.searched);
        let rests = self.result.touches.is_empty() && !self.result.changed && self.result.doubt.is_none();
        let held = rests && self.broken.rests(values, noises);
        if named {
            self.contacts.unlearn_signs();
        }
        if named || held {
            self.left_changed = true;
            self.show_faults();
        }
    }

    /// Whether the fault that was named just now leaves as many touches as there were, as badly explained: it is none, and forgotten.
    pub(super) fn took_no_place(&mut self) -> bool {
        let Some((fault, touches, before)) = self.instead_of.take() else {
            return false;
        };
        let now = self.result.touches.len();
        let better = before
            .zip(self.result.misfit)
            .is_some_and(|(before, now)| now < BETTER * before);
        if now < touches || (now == touches && better) {
            self.contacts.unlearn_signs();
            return false;
        }
        self.broken.reject(fault);
        true
    }

    /// Lets the detectors of changes look at the values that are left. They have seen no frame then. Each takes as long as some frames to
    /// make, so it is made when it is needed. False where the frame has no time for more.
    pub(super) fn look_without_faults(&mut self) -> bool {
        if !self.options.sequence {
            return true;
        }
        if std::mem::take(&mut self.left_changed) {
            self.disagrees = false;
            let mut left = self.reference.unchanged().clone();
            self.broken.leave_out(&mut left);
            if left.used != self.left.used {
                (self.left, self.detectors) = (left, Drifting::ALL.map(|_| None));
            }
        }
        let now = self.contacts.detector();
        if let (None, Some(drifting)) = (&self.detectors[now], Drifting::ALL.get(now)) {
            let may = self.may_make() && has_detector(&self.solver, &self.reference, *drifting);
            if may && self.solver.prepare(&self.left, (*drifting, &[])) {
                self.makes = true;
                return false;
            }
            self.detectors[now] = detector(&mut self.solver, &self.reference, &self.left, *drifting, false);
        }
        true
    }

    /// Says what is broken. Where it leaves no touches, none are shown.
    pub(super) fn show_faults(&mut self) {
        let named = self.broken.named();
        self.contacts.leave_out(&self.broken.electrodes_left_out());
        if self.broken.is_open() || self.broken.owed() > 0 {
            // Every frame counts.
            self.detectors.iter_mut().flatten().for_each(ChangeDetector::forget);
        }
        let named = self.before.map_or(named, |before| Some(before.into()));
        let named = || named.into_iter().flat_map(Faults::iter);
        if let Some(fault) = named().find(|fault| !fault.leaves_touches()) {
            let used = self.whole.used.iter().filter(|used| **used).count();
            self.result.clear(self.noise(), used);
            (self.result.anew, self.result.doubt) = (true, Some(Doubt::Fault(fault)));
            self.solver.forget();
        }
        self.result.contacts.clear();
        self.result.contacts.extend(self.contacts.changed());
        for fault in named() {
            if let Fault::Contacts(electrodes) = fault {
                self.result.contacts.extend_from_slice(electrodes.list());
            }
        }
        self.result.faults.clear();
        let all = named()
            .chain(self.broken.rails())
            .chain(self.broken.loose())
            .chain(self.contacts.faults());
        self.result.faults.extend(all);
    }
}
