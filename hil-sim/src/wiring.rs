//! Analogue faults at work: what they make of the sheet, of a route and of the codes.

use crate::current::Broken;
use crate::fault::{FaultKind, Multiplexer, Reference};
use firmware::{MAX_CHANNELS, Route, Sense};
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
    /// Electrodes whose wires are swapped.
    swapped: Vec<[usize; 2]>,
    stuck: Vec<(Multiplexer, u8)>,
    addresses: Vec<(Multiplexer, [u8; 2])>,
    switches: Vec<(Multiplexer, u8, f64)>,
    /// What does not depend on the route.
    broken: Broken,
    /// Part of the source's amplitude that is missing.
    source_missing: f64,
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
                FaultKind::SourceLost => out.source_missing = 1.0,
                FaultKind::SourceSags { part } => out.source_missing = out.source_missing.max(1.0 - part),
                FaultKind::AdcStuck { code } => out.adc = Some(code),
                FaultKind::AmplifierDead => out.broken.amplifier_dead = true,
                FaultKind::AmplifierSaturating { volt } => out.broken.reach_lost_v += volt,
                FaultKind::ChannelDead { channel } => out.broken.channels_dead |= 1 << channel,
                FaultKind::ChannelSaturating { channel, volt } => {
                    if let Some(lost_v) = out.broken.channels_reach_lost_v.get_mut(usize::from(channel)) {
                        *lost_v += volt;
                    }
                }
                FaultKind::SwitchResistance {
                    multiplexer,
                    electrode,
                    ohm,
                } => out.switches.push((multiplexer, electrode, ohm)),
                FaultKind::AddressSwapped { multiplexer, lines } => out.addresses.push((multiplexer, lines)),
                FaultKind::WiresSwapped { electrodes } => out.swapped.push(electrodes.map(usize::from)),
                FaultKind::ReferenceLost { reference } => match reference {
                    Reference::Drive => out.broken.drive_reference_lost = true,
                    Reference::Converter => out.broken.converter_reference_lost = true,
                },
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
                | FaultKind::BoardReset
                | FaultKind::BoardHangs => {}
            }
        }
        out
    }

    /// What is left of the source's amplitude, 0 to 1.
    pub(crate) fn source_part(&self) -> f64 {
        1.0 - self.source_missing
    }

    /// The sheet as the board's wires see it.
    pub(crate) fn seen(&self, sheet: &ElectrodeMatrix) -> ElectrodeMatrix {
        if self.open == 0 && self.raised.is_empty() && self.shorts.is_empty() && self.swapped.is_empty() {
            return sheet.clone();
        }
        let mut r = sheet.potentials_ohm().clone();
        for [a, b] in &self.swapped {
            r.swap_rows(*a, *b);
            r.swap_columns(*a, *b);
        }
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
    fn floating(&self) -> u64 {
        let joined = self.shorts.iter().flat_map(|(pair, _)| pair);
        joined.fold(self.open, |open, n| open & !(1 << n))
    }

    /// What is broken on the way of a route.
    pub(crate) fn broken(&self, route: &Route) -> Broken {
        let drive = self.routed(route).drive;
        let added = |which, electrode| {
            let of = |(m, n, ohm): &(Multiplexer, u8, f64)| (*m == which && *n == electrode).then_some(*ohm);
            self.switches.iter().filter_map(of).sum()
        };
        Broken {
            open: self.floating(),
            switches_ohm: [
                added(Multiplexer::DrivePlus, drive.plus),
                added(Multiplexer::DriveMinus, drive.minus),
            ],
            ..self.broken
        }
    }

    /// The route as the multiplexers carry it out. Amplifiers of their own for all pairs at once need no sense multiplexers.
    pub(crate) fn routed(&self, route: &Route) -> Route {
        let mut out = *route;
        for (multiplexer, lines) in &self.addresses {
            match (multiplexer, &mut out.sense) {
                (Multiplexer::DrivePlus, _) => out.drive.plus = swapped(out.drive.plus, *lines),
                (Multiplexer::DriveMinus, _) => out.drive.minus = swapped(out.drive.minus, *lines),
                (Multiplexer::SensePlus, Sense::One(pair)) => pair.plus = swapped(pair.plus, *lines),
                (Multiplexer::SenseMinus, Sense::One(pair)) => pair.minus = swapped(pair.minus, *lines),
                _ => {}
            }
        }
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

    /// Whether rows of codes become others.
    pub(crate) fn spoils(&self) -> bool {
        self.saturated != 0 || self.adc.is_some()
    }

    /// What becomes of a row of codes, of which this is the highest.
    pub(crate) fn spoil(&self, row: &mut [u16], full_scale: u16) {
        if self.saturated != 0 {
            for (channel, code) in row.iter_mut().enumerate().take(MAX_CHANNELS) {
                if self.saturated >> channel & 1 == 1 {
                    *code = full_scale;
                }
            }
        }
        if let Some(stuck) = self.adc {
            row.fill(stuck);
        }
    }
}

/// An address with two of its bits swapped.
fn swapped(address: u8, [a, b]: [u8; 2]) -> u8 {
    let differ = (address >> a ^ address >> b) & 1;
    address ^ (differ << a | differ << b)
}
