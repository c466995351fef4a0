//! A ring of equal resistors between neighbouring electrodes: what every pair sees, and how wrong wires look.

use std::fmt;

/// One of the board's multiplexers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Multiplexer {
    /// Where the source enters.
    DrivePlus,
    /// Where it leaves.
    DriveMinus,
    /// Positive input of the amplifier.
    SensePlus,
    /// Its negative input.
    SenseMinus,
}

impl Multiplexer {
    const ALL: [Self; 4] = [Self::DrivePlus, Self::DriveMinus, Self::SensePlus, Self::SenseMinus];
}

impl fmt::Display for Multiplexer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::DrivePlus => "drive +",
            Self::DriveMinus => "drive -",
            Self::SensePlus => "sense +",
            Self::SenseMinus => "sense -",
        })
    }
}

/// How electrodes may be connected. Electrodes from 0; texts count them from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wiring {
    /// As it should be.
    Right,
    /// The wires of two electrodes are swapped.
    Electrodes(usize, usize),
    /// Those from two electrodes to one multiplexer are swapped.
    At(Multiplexer, usize, usize),
    /// Two address lines of a multiplexer are swapped.
    Address(Multiplexer, u8, u8),
    /// A multiplexer stays on one electrode.
    Stuck(Multiplexer, usize),
}

impl fmt::Display for Wiring {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Right => f.write_str("the wires are as they should be"),
            Self::Electrodes(a, b) => write!(f, "the wires of electrodes {} and {} are swapped", a + 1, b + 1),
            Self::At(m, a, b) => write!(
                f,
                "the wires of electrodes {} and {} are swapped at multiplexer {m}",
                a + 1,
                b + 1
            ),
            Self::Address(m, a, b) => write!(f, "address lines A{a} and A{b} of multiplexer {m} are swapped"),
            Self::Stuck(m, n) => write!(f, "multiplexer {m} stays on electrode {}", n + 1),
        }
    }
}

impl Wiring {
    /// Everything that may be wrong with the wires of so many electrodes.
    pub fn wrong(electrodes: usize) -> impl Iterator<Item = Self> {
        let pairs = move || (0..electrodes).flat_map(move |b| (0..b).map(move |a| (a, b)));
        let at = move |m: Multiplexer| {
            let lines = [(0, 1), (0, 2), (1, 2)].map(|(a, b)| Self::Address(m, a, b));
            let stuck = (0..electrodes).map(move |n| Self::Stuck(m, n));
            pairs().map(move |(a, b)| Self::At(m, a, b)).chain(lines).chain(stuck)
        };
        let both = pairs().map(|(a, b)| Self::Electrodes(a, b));
        both.chain(Multiplexer::ALL.into_iter().flat_map(at))
    }

    /// The electrode that a multiplexer really connects.
    fn connected(self, multiplexer: Multiplexer, n: usize) -> usize {
        let swap = |a: usize, b: usize| match n {
            _ if n == a => b,
            _ if n == b => a,
            _ => n,
        };
        match self {
            Self::Electrodes(a, b) => swap(a, b),
            Self::At(m, a, b) if m == multiplexer => swap(a, b),
            Self::Address(m, a, b) if m == multiplexer => {
                let differ = (n >> a ^ n >> b) & 1;
                n ^ (differ << a | differ << b)
            }
            Self::Stuck(m, at) if m == multiplexer => at,
            _ => n,
        }
    }
}

/// A ring of resistors behind a source and two closed switches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ring {
    /// Resistors, and electrodes.
    pub electrodes: usize,
    /// Each of them, ohm.
    pub ohm: f64,
    /// One closed switch, ohm.
    pub switch_ohm: f64,
    /// Amplitude of the source, V.
    pub source_v: f64,
}

impl Ring {
    /// Resistance between two electrodes: `d` resistors on one side and `N - d` on the other.
    pub fn between_ohm(&self, d: usize) -> f64 {
        let n = self.electrodes as f64;
        self.ohm * d as f64 * (n - d as f64) / n
    }

    /// What a pair (plus, minus) sees of a drive (plus, minus), V. Along either side the voltage falls evenly.
    pub fn voltage_v(&self, wiring: Wiring, drive: [usize; 2], sense: [usize; 2]) -> f64 {
        let n = self.electrodes;
        let from = wiring.connected(Multiplexer::DrivePlus, drive[0]);
        let to = wiring.connected(Multiplexer::DriveMinus, drive[1]);
        let d = (to + n - from) % n;
        if d == 0 {
            return 0.0;
        }
        let own = self.between_ohm(d);
        let across_v = self.source_v * own / (own + 2.0 * self.switch_ohm);
        let height = |electrode: usize| {
            let j = (electrode + n - from) % n;
            if j <= d {
                1.0 - j as f64 / d as f64
            } else {
                (j - d) as f64 / (n - d) as f64
            }
        };
        let plus = height(wiring.connected(Multiplexer::SensePlus, sense[0]));
        let minus = height(wiring.connected(Multiplexer::SenseMinus, sense[1]));
        across_v * (plus - minus)
    }
}
