//! The production test: a board with a ring of equal resistors in the place of the sheet, of which theory gives every value.
//! docs/board.md says where the limits come from.

mod readings;
mod ring;

pub use readings::{Reading, Readings, read};
pub use ring::{Multiplexer, Ring, Wiring};

use protocol::Hello;
use std::fmt;

/// Closed switches, ohm: typical of the 74HCT4051 at 4.5 V; assumed until it is measured.
pub const SWITCH_OHM: f64 = 100.0;
/// What one of them may have, ohm. 180 is the data sheet's most; the source's gain may be off by 2 %, which are 6 ohm.
pub const SWITCH_LIMITS_OHM: [f64; 2] = [50.0, 190.0];
/// The same while nobody has measured the ring, at most: typical switches, a low supply and a warm room. Switches of more look
/// like a ring of smaller resistors.
pub const SWITCH_LIMIT_UNMEASURED_OHM: f64 = 130.0;
/// How far the ring may be from what it is said to be, in parts: an ohmmeter, its leads and resistors of 1 %.
pub const RING_LIMIT: f64 = 0.03;
/// How far the two switches of a drive may be from the median of all drives, ohm: 9 between switches of a chip, 3 by resistors
/// of 1 %, twice.
pub const SWITCHES_APART_OHM: f64 = 24.0;
/// How far the sense pairs' gain may be from its ratio to the drive pairs': resistors of 1 %, capacitors of 5 %.
pub const GAIN_LIMIT: f64 = 0.03;
/// How far a value may be from its drive's and its pair's: resistors of 1 %, and 0.4 % of the difference amplifier's load.
pub const SPREAD_LIMIT: f64 = 0.025;
/// Noise of a value of one period, codes: that of a sample of one code over the root of eight. Others measured 0.4 to 0.7 codes
/// on such converters, and 96 values, in phase and ahead, know it to 5 %.
pub const SIGMA_LIMIT: f64 = 0.35;
/// Phase of the sense pairs, degrees: parts to the worse side, 3.7, and a degree of converter and DAC.
pub const PHASE_LIMIT_DEG: f64 = 5.0;
/// Mean code from the middle of the range.
pub const OFFSET_LIMIT: f64 = 100.0;

/// A period that is further from the same upside down than this, codes, and this part of its amplitude, was bent.
const BENT: (f64, f64) = (4.0, 1.0 / 64.0);
/// All values together less than this part of what they should be: the amplifier gives nothing.
const DEAD: f64 = 0.05;
/// Root mean square departure from the ring, of its own, with which its wires are taken for right, and with which a wrong wiring
/// is taken for the explanation. Resistors, switches and noise make 2 %; any two wires swapped 20 % or more.
const RIGHT: f64 = 0.08;
const EXPLAINED: f64 = 0.05;

/// Something that is wrong.
#[derive(Clone, Debug, PartialEq)]
pub enum Finding {
    /// No sense pair gives a signal; drive pairs do.
    AmplifierDead,
    /// Wires or address lines.
    Wiring(Wiring),
    /// The values are not those of such a ring, nor of one with one thing wrong about its wires.
    Unexplained {
        /// Root mean square departure, in parts.
        departure: f64,
    },
    /// Periods that are not the same upside down.
    Saturation {
        /// How many of how many values.
        count: usize,
        /// Of these.
        of: usize,
    },
    /// Values at the converter's ends.
    Clipped {
        /// How many.
        count: usize,
    },
    /// The switches of one drive pair differ from the others'.
    Switches {
        /// The drive pair's first electrode, from 0.
        drive: usize,
        /// Both together, ohm.
        ohm: f64,
        /// The median of all drive pairs, ohm.
        median_ohm: f64,
    },
    /// All switches, or the ring has other resistors.
    AllSwitches {
        /// One, ohm.
        ohm: f64,
    },
    /// Switches that are seldom so poor, or a ring of smaller resistors than said. Only an ohmmeter can tell.
    RingOrSwitches {
        /// One switch if the ring is as said, ohm.
        switch_ohm: f64,
        /// A resistor of the ring if the switches are typical, ohm.
        ring_ohm: f64,
        /// What an ohmmeter shows between neighbours if the ring is as said, ohm.
        between_ohm: f64,
    },
    /// The ring as measured is not the one that was said.
    OtherRing {
        /// A resistor of it, ohm, as measured and as said.
        ohm: f64,
        /// As said.
        said_ohm: f64,
    },
    /// One resistor of the ring, or a contact at it.
    Resistor {
        /// It lies between this electrode, from 0, and the next.
        electrode: usize,
        /// What it has by the values, ohm.
        ohm: f64,
    },
    /// The ratio of the two gains.
    Gain {
        /// Over what it should be.
        ratio: f64,
    },
    /// Single values are off.
    Values {
        /// How many.
        count: usize,
        /// The farthest, in parts.
        worst: f64,
    },
    /// The amplifier of one channel gives no signal; the one behind the multiplexers does.
    ChannelDead {
        /// Which one, from 0.
        channel: usize,
    },
    /// The values of one channel are not those of the amplifier behind the multiplexers.
    Channel {
        /// Which one, from 0.
        channel: usize,
        /// Its gain over that of the amplifier behind the multiplexers.
        ratio: f64,
        /// The farthest value from this ratio, in parts.
        worst: f64,
    },
    /// Noise of a value.
    Noise,
    /// Phase of the values.
    Phase,
    /// A mean far from the middle of the range.
    Offset,
}

impl Finding {
    /// Its name for programs.
    pub fn name(&self) -> &'static str {
        match self {
            Self::AmplifierDead => "amplifier_dead",
            Self::Wiring(_) => "wiring",
            Self::Unexplained { .. } => "unexplained",
            Self::Saturation { .. } => "saturation",
            Self::Clipped { .. } => "clipped",
            Self::Switches { .. } | Self::AllSwitches { .. } => "switch_resistance",
            Self::RingOrSwitches { .. } => "ring_or_switches",
            Self::OtherRing { .. } => "other_ring",
            Self::Resistor { .. } => "resistor",
            Self::Gain { .. } => "gain",
            Self::Values { .. } => "spread",
            Self::ChannelDead { .. } => "channel_dead",
            Self::Channel { .. } => "channel",
            Self::Noise => "noise",
            Self::Phase => "phase",
            Self::Offset => "offset",
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AmplifierDead => {
                f.write_str("the amplifier of the sense pairs gives no signal: look at U3, R12 and PA0")
            }
            Self::Wiring(wiring) => wiring.fmt(f),
            Self::Unexplained { departure } => write!(
                f,
                "the values are {:.0} % off those of such a ring, and no single wrong wire explains them: look at the ring first",
                100.0 * departure
            ),
            Self::Saturation { count, of } => write!(
                f,
                "the amplifier saturates: {count} of {of} periods are not the same upside down; look at the supply and at U3"
            ),
            Self::Clipped { count } => write!(
                f,
                "{count} values are at the converter's ends: is the ring of these resistors?"
            ),
            Self::Switches { drive, ohm, median_ohm } => write!(
                f,
                "the two switches that drive electrodes {} and the next have {ohm:.0} ohm together, those of other pairs {median_ohm:.0}",
                drive + 1
            ),
            Self::AllSwitches { ohm } => write!(
                f,
                "a closed switch has {ohm:.0} ohm, where a 74HCT4051 has 180 at most: is the ring of these resistors?"
            ),
            Self::RingOrSwitches {
                switch_ohm,
                ring_ohm,
                between_ohm,
            } => write!(
                f,
                "either the ring has resistors of about {ring_ohm:.0} ohm, or a closed switch has {switch_ohm:.0}. Unplug the ring, \
                 measure between two neighbouring electrodes ({between_ohm:.0} ohm if it is as said), and tell it with --measured"
            ),
            Self::OtherRing { ohm, said_ohm } => write!(
                f,
                "as measured the ring has resistors of {ohm:.0} ohm, not of {said_ohm:.0}"
            ),
            Self::Resistor { electrode, ohm } => write!(
                f,
                "the resistor between electrode {} and the next has {ohm:.0} ohm, by the values",
                electrode + 1
            ),
            Self::Gain { ratio } => write!(
                f,
                "the sense pairs' gain is {:.3} of what it should be against the drive pairs': look at R12, R15 to R18",
                ratio
            ),
            Self::Values { count, worst } => write!(
                f,
                "{count} values are off those of their drive and pair, the farthest by {:.1} %",
                100.0 * worst
            ),
            Self::ChannelDead { channel } => write!(
                f,
                "channel {} gives no signal, between electrodes {} and the next: look at its amplifier and its wires",
                channel + 1,
                channel + 1
            ),
            Self::Channel { channel, ratio, worst } => write!(
                f,
                "channel {}, between electrodes {} and the next, has {ratio:.3} of the gain it should have, and single values are off \
                 by up to {:.1} %: look at its amplifier, which may saturate, and at its wires",
                channel + 1,
                channel + 1,
                100.0 * worst
            ),
            Self::Noise => f.write_str("the values have more noise than the converter has"),
            Self::Phase => f.write_str("the values are not in phase: look at the filters' parts (C4, C5, C8)"),
            Self::Offset => f.write_str("an amplifier does not rest in the middle of the range"),
        }
    }
}

/// What the ring shows of a board. What could not be judged, since a wire or the amplifier is wrong, is `NaN`.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// What is wrong; nothing for a board that passes.
    pub findings: Vec<Finding>,
    /// Mean of all values, codes, and what theory gives with the switches as measured.
    pub mean_codes: f64,
    /// As said.
    pub expected_codes: f64,
    /// One closed switch, ohm, mean of all.
    pub switch_ohm: f64,
    /// A resistor of the ring, ohm: as measured, or if a switch has [`SWITCH_OHM`] instead. The values show the ratio of the two
    /// only.
    pub ring_ohm: f64,
    /// The sense pairs' gain against the drive pairs', over what it should be.
    pub gain_ratio: f64,
    /// Largest departure of a value from its drive's and its pair's, in parts.
    pub spread: f64,
    /// Standard deviation of a value of one period, codes.
    pub sigma: f64,
    /// Largest phase of a value, degrees.
    pub phase_deg: f64,
    /// Largest distance of a mean from the middle of the range, codes.
    pub offset_codes: f64,
}

/// The ring as whoever connected it knows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// What one resistor is said to be, ohm.
    pub said_ohm: f64,
    /// What an ohmmeter showed between two neighbouring electrodes with the board unplugged, ohm; `None`: nobody looked.
    pub between_ohm: Option<f64>,
}

impl Known {
    /// One resistor of so many, ohm: as measured, else as said. Between neighbours one is beside all others.
    pub fn resistor_ohm(self, electrodes: usize) -> f64 {
        let n = electrodes as f64;
        self.between_ohm
            .map_or(self.said_ohm, |between| between * n / (n - 1.0))
    }
}

/// Holds every channel of a board that senses all pairs at once against the amplifier behind the multiplexers, on the same
/// drives and pairs. It takes no ring: any sheet will do. Nothing of a board that senses one pair at a time.
#[must_use]
pub fn channels(readings: &Readings, electrodes: usize) -> Vec<Finding> {
    let Some(at_once) = &readings.at_once else {
        return Vec::new();
    };
    let of_channel = |channel: usize| {
        let both = || {
            let pairs = readings.list.iter().filter(|r| !r.own).zip(at_once);
            pairs.filter_map(move |(r, v)| (r.sense[1] == channel && !r.clipped).then_some((r.in_phase, *v)))
        };
        let square: f64 = both().map(|(one, _)| one * one).sum();
        let ratio = both().map(|(one, all)| one * all).sum::<f64>() / square;
        if ratio.abs() < DEAD {
            return Some(Finding::ChannelDead { channel });
        }
        let apart = both().map(|(one, all)| (all / one / ratio - 1.0).abs());
        let worst = apart.fold(0.0, f64::max);
        let wrong = (ratio - 1.0).abs() > GAIN_LIMIT || worst > SPREAD_LIMIT;
        wrong.then_some(Finding::Channel { channel, ratio, worst })
    };
    (0..electrodes).filter_map(of_channel).collect()
}

/// Judges the readings of such a ring. `source` is the source's amplitude as the board measures it, over what it is set to.
pub fn judge(hello: &Hello, known: Known, source: f64, readings: &Readings) -> Verdict {
    let gain = |k: Option<&u32>| f64::from(k.copied().unwrap_or(0)) / 1000.0;
    let per_code = f64::from(hello.adc_span_uv) * 1e-6 / hello.range_codes();
    let electrodes = hello.electrodes.into();
    let bench = Bench {
        ring: Ring {
            electrodes,
            ohm: known.resistor_ohm(electrodes),
            switch_ohm: SWITCH_OHM,
            source_v: f64::from(hello.excitation_uv) * 1e-6 * readings.excitation * source,
        },
        known,
        own_v: per_code / gain(hello.gains_milli.last()),
        sense_v: per_code / gain(hello.gains_milli.first()),
        readings,
    };
    bench.verdict()
}

/// Readings with what they are compared with.
struct Bench<'a> {
    ring: Ring,
    known: Known,
    /// Volts of a code of a drive pair's own voltage, and of a sense pair's.
    own_v: f64,
    sense_v: f64,
    readings: &'a Readings,
}

impl Bench<'_> {
    fn volts(&self, r: &Reading) -> f64 {
        r.in_phase * if r.own { self.own_v } else { self.sense_v }
    }

    fn sense(&self) -> impl Iterator<Item = &Reading> {
        self.readings.list.iter().filter(|r| !r.own)
    }

    fn verdict(&self) -> Verdict {
        let largest = |f: fn(&Reading) -> f64| self.sense().map(f).fold(0.0, f64::max);
        let of_all = |f: fn(&Reading) -> f64| self.readings.list.iter().map(f).fold(0.0, f64::max);
        let count = self.sense().count().max(1) as f64;
        let mut verdict = Verdict {
            findings: Vec::new(),
            mean_codes: self.sense().map(|r| r.in_phase).sum::<f64>() / count,
            expected_codes: f64::NAN,
            switch_ohm: f64::NAN,
            ring_ohm: f64::NAN,
            gain_ratio: f64::NAN,
            spread: f64::NAN,
            sigma: self.readings.sigma,
            phase_deg: largest(|r| r.quadrature.atan2(r.in_phase.abs()).to_degrees().abs()),
            offset_codes: of_all(|r| r.offset.abs()),
        };
        let right = self.expected_v(SWITCH_OHM) / self.sense_v;
        if self.sense().map(|r| r.in_phase.abs()).sum::<f64>() / count < DEAD * right {
            verdict.phase_deg = f64::NAN;
            verdict.findings.push(Finding::AmplifierDead);
            return verdict;
        }
        if let Some(finding) = self.wiring() {
            verdict.phase_deg = f64::NAN;
            verdict.findings.push(finding);
            return verdict;
        }
        self.figures(&mut verdict);
        verdict.findings.extend(channels(self.readings, self.ring.electrodes));
        let limits = [
            (verdict.sigma > SIGMA_LIMIT, Finding::Noise),
            (verdict.phase_deg > PHASE_LIMIT_DEG, Finding::Phase),
            (verdict.offset_codes > OFFSET_LIMIT, Finding::Offset),
        ];
        let missed = limits
            .into_iter()
            .filter(|(missed, _)| *missed)
            .map(|(_, finding)| finding);
        verdict.findings.extend(missed);
        verdict
    }

    /// A value of the ring with such switches, V.
    fn expected_v(&self, switch_ohm: f64) -> f64 {
        Ring {
            switch_ohm,
            ..self.ring
        }
        .voltage_v(Wiring::Right, [0, 1], [3, 2])
    }

    /// How far the readings are from a wiring's, root mean square, in parts of their own; a common factor is left open, for the
    /// switches. Drive pairs and sense pairs count alike.
    fn departure(&self, wiring: Wiring) -> f64 {
        let (mut cross, mut square, mut own) = (0.0, 0.0, 0.0);
        let mut missed = 0.0;
        for r in &self.readings.list {
            let weight = if r.own { 1.0 } else { (self.ring.electrodes - 1) as f64 };
            let there = weight * self.volts(r);
            let theory = weight * self.ring.voltage_v(wiring, r.drive, r.sense);
            own += there * there;
            if r.clipped {
                // At least so much, with this sign.
                let enough = theory * there > 0.0 && theory.abs() > 0.85 * there.abs();
                missed += if enough { 0.0 } else { (there - theory).powi(2) };
            } else {
                cross += there * theory;
                square += theory * theory;
                missed += there * there;
            }
        }
        let explained = if square > 0.0 {
            cross * cross.max(0.0) / square
        } else {
            0.0
        };
        ((missed - explained).max(0.0) / own.max(f64::MIN_POSITIVE)).sqrt()
    }

    /// What is wrong with the wires, if anything.
    fn wiring(&self) -> Option<Finding> {
        let departure = self.departure(Wiring::Right);
        if departure < RIGHT {
            return None;
        }
        let wrong = Wiring::wrong(self.ring.electrodes).map(|w| (self.departure(w), w));
        let best = wrong.min_by(|a, b| a.0.total_cmp(&b.0));
        match (best, self.bent()) {
            (Some((left, wiring)), _) if left < EXPLAINED => Some(Finding::Wiring(wiring)),
            (_, 0) => Some(Finding::Unexplained { departure }),
            // It is the amplifier, which is said with the figures.
            _ => None,
        }
    }

    /// How many sense pairs' periods are bent, though not against the converter's ends.
    fn bent(&self) -> usize {
        let is_bent = |r: &&Reading| !r.clipped && r.bent > BENT.0 + BENT.1 * r.in_phase.abs();
        self.sense().filter(is_bent).count()
    }

    /// Switches, gain, resistors and spread of a board whose wires are right.
    fn figures(&self, verdict: &mut Verdict) {
        let n = self.ring.electrodes;
        let own: Vec<f64> = self
            .readings
            .list
            .iter()
            .filter(|r| r.own)
            .map(|r| self.volts(r))
            .collect();
        let both: Vec<f64> = own
            .iter()
            .map(|v| self.ring.between_ohm(1) * (self.ring.source_v / v - 1.0))
            .collect();
        verdict.switch_ohm = both.iter().sum::<f64>() / (2 * n) as f64;
        let measured = self.known.between_ohm.is_some();
        let ratio = if measured { 1.0 } else { SWITCH_OHM / verdict.switch_ohm };
        verdict.ring_ohm = self.ring.ohm * ratio;
        verdict.expected_codes = self.expected_v(verdict.switch_ohm) / self.sense_v;
        // Each value over its drive's own, where all are 1 by theory.
        let parts: Vec<(usize, usize, f64)> = self
            .sense()
            .map(|r| (r.drive[0], r.sense[1], self.volts(r) / own[r.drive[0]] * (n - 1) as f64))
            .collect();
        let mean_of = |of: &dyn Fn(&(usize, usize, f64)) -> bool| {
            let (count, sum) = parts
                .iter()
                .filter(|p| of(p))
                .fold((0, 0.0), |(k, s), p| (k + 1, s + p.2));
            sum / f64::from(count.max(1))
        };
        verdict.gain_ratio = mean_of(&|_| true);
        let by_pair: Vec<f64> = (0..n)
            .map(|pair| mean_of(&|p| p.1 == pair) / verdict.gain_ratio - 1.0)
            .collect();
        let left = parts
            .iter()
            .map(|(_, pair, v)| v / verdict.gain_ratio / (1.0 + by_pair[*pair]) - 1.0);
        let left: Vec<f64> = left.map(f64::abs).collect();
        verdict.spread = left.iter().copied().fold(0.0, f64::max);

        let found = &mut verdict.findings;
        let (bent, clipped) = (self.bent(), self.sense().filter(|r| r.clipped).count());
        if bent > 0 {
            let of = parts.len();
            found.push(Finding::Saturation { count: bent, of });
        }
        if clipped > 0 {
            found.push(Finding::Clipped { count: clipped });
        }
        let median_ohm = median(&both);
        for (drive, ohm) in both.iter().copied().enumerate() {
            if (ohm - median_ohm).abs() > SWITCHES_APART_OHM {
                found.push(Finding::Switches { drive, ohm, median_ohm });
            }
        }
        let Known { said_ohm, .. } = self.known;
        if (self.ring.ohm / said_ohm - 1.0).abs() > RING_LIMIT {
            let ohm = self.ring.ohm;
            found.push(Finding::OtherRing { ohm, said_ohm });
        }
        let ([least, most], one_ohm) = (SWITCH_LIMITS_OHM, 0.5 * median_ohm);
        if !(least..=most).contains(&one_ohm) {
            found.push(Finding::AllSwitches { ohm: one_ohm });
        } else if !measured && one_ohm > SWITCH_LIMIT_UNMEASURED_OHM {
            found.push(Finding::RingOrSwitches {
                switch_ohm: one_ohm,
                ring_ohm: said_ohm * SWITCH_OHM / one_ohm,
                between_ohm: self.ring.between_ohm(1),
            });
        }
        if bent > 0 || clipped > 0 {
            return;
        }
        for (electrode, part) in by_pair.iter().enumerate() {
            if part.abs() > SPREAD_LIMIT {
                let ohm = self.ring.ohm * (1.0 + part);
                found.push(Finding::Resistor { electrode, ohm });
            }
        }
        if (verdict.gain_ratio - 1.0).abs() > GAIN_LIMIT {
            found.push(Finding::Gain {
                ratio: verdict.gain_ratio,
            });
        }
        let count = left.iter().filter(|v| **v > SPREAD_LIMIT).count();
        if count > 0 {
            let worst = verdict.spread;
            found.push(Finding::Values { count, worst });
        }
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    match n {
        0 => f64::NAN,
        _ => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
    }
}
