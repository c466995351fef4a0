//! Analogue faults at work: what they make of the sheet, of a route and of the codes.

use crate::fault::{FaultKind, Multiplexer};
use firmware::{FULL_SCALE, MAX_CHANNELS, Route, Sense};
use forward::ElectrodeMatrix;

/// What an open contact still conducts, as a resistance, ohm.
const OPEN_OHM: f64 = 1e9;

/// What is broken between the sheet and the codes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Wiring {
    /// Electrodes whose wire is off, bit n for electrode n.
    open: u64,
    raised: Vec<(usize, f64)>,
    shorts: Vec<([usize; 2], f64)>,
    stuck: Vec<(Multiplexer, u8)>,
    pub(crate) source_lost: bool,
    adc: Option<u16>,
    saturated: u32,
    /// Chance that a period of samples is overrun.
    pub(crate) overrun: f64,
}

impl Wiring {
    pub(crate) fn of<'a>(faults: impl Iterator<Item = &'a FaultKind>) -> Self {
        let mut out = Self::default();
        for fault in faults {
            match *fault {
                FaultKind::ElectrodeOpen { electrode } => out.open |= 1 << electrode,
                FaultKind::ContactRaised { electrode, ohm } => out.raised.push((electrode.into(), ohm)),
                FaultKind::ElectrodesShort { electrodes, ohm } => out.shorts.push((electrodes.map(usize::from), ohm)),
                FaultKind::SourceLost => out.source_lost = true,
                FaultKind::AdcStuck { code } => out.adc = Some(code),
                FaultKind::MultiplexerStuck { multiplexer, electrode } => out.stuck.push((multiplexer, electrode)),
                FaultKind::Saturation { channel: Some(channel) } => out.saturated |= 1 << channel,
                FaultKind::Saturation { channel: None } => out.saturated = u32::MAX,
                FaultKind::ConverterOverrun { rate } => out.overrun = out.overrun.max(rate),
                FaultKind::BytesLost { .. }
                | FaultKind::BytesFlipped { .. }
                | FaultKind::BytesDoubled { .. }
                | FaultKind::LineBreak
                | FaultKind::BreakToBoard
                | FaultKind::CablePulled
                | FaultKind::BoardReset => {}
            }
        }
        out
    }

    /// The sheet as the board's wires see it.
    pub(crate) fn seen(&self, sheet: &ElectrodeMatrix) -> ElectrodeMatrix {
        if self.open == 0 && self.raised.is_empty() && self.shorts.is_empty() {
            return sheet.clone();
        }
        let mut r = sheet.potentials_ohm().clone();
        for n in (0..sheet.electrodes()).filter(|n| self.open >> n & 1 == 1) {
            r[(n, n)] += OPEN_OHM;
        }
        for (n, ohm) in &self.raised {
            r[(*n, *n)] += ohm;
        }
        // A resistor between two wires: the current through it is what drives their voltage through the rest.
        for ([a, b], ohm) in &self.shorts {
            let column = r.column(*a) - r.column(*b);
            let across = column[*a] - column[*b];
            let row = r.row(*a) - r.row(*b);
            r -= &column * row / (ohm + across);
        }
        ElectrodeMatrix::from_potentials(r)
    }

    /// Electrodes whose amplifiers float: off the sheet, and not held by another wire.
    pub(crate) fn floating(&self) -> u64 {
        let joined = self.shorts.iter().flat_map(|(pair, _)| pair);
        joined.fold(self.open, |open, n| open & !(1 << n))
    }

    /// The route as the multiplexers carry it out. Amplifiers of their own for all pairs at once need no sense multiplexers.
    pub(crate) fn routed(&self, route: &Route) -> Route {
        let mut out = *route;
        for (multiplexer, electrode) in &self.stuck {
            match (multiplexer, &mut out.sense) {
                (Multiplexer::DrivePlus, _) => out.drive.plus = *electrode,
                (Multiplexer::DriveMinus, _) => out.drive.minus = *electrode,
                (Multiplexer::SensePlus, Sense::One(pair)) => pair.plus = *electrode,
                (Multiplexer::SenseMinus, Sense::One(pair)) => pair.minus = *electrode,
                _ => {}
            }
        }
        out
    }

    /// What becomes of a row of codes.
    pub(crate) fn spoil(&self, row: &mut [u16]) {
        if self.saturated != 0 {
            for (channel, code) in row.iter_mut().enumerate().take(MAX_CHANNELS) {
                if self.saturated >> channel & 1 == 1 {
                    *code = FULL_SCALE;
                }
            }
        }
        if let Some(stuck) = self.adc {
            row.fill(stuck);
        }
    }
}
