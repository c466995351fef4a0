//! What is on the bench: which electrode each of the four wires is connected to, what went wrong, and how late it is.

use embedded_hal::delay::DelayNs;
use firmware::{Route, Router, Sense};
use protocol::Pair;
use std::cell::RefCell;
use std::rc::Rc;

/// Drive +, drive -, sense +, sense -.
pub(crate) const WIRES: usize = 4;

#[derive(Debug, Default)]
pub(crate) struct Bench {
    /// Electrodes on each wire.
    connected: [Vec<u8>; WIRES],
    /// Nanoseconds that were waited.
    pub(crate) now: u64,
    /// When a wire last lost its electrode.
    last_opened: u64,
    /// When an address last changed.
    pub(crate) last_addressed: u64,
    /// The shortest times from the last opening to an address, and from an address to the first closing.
    pub(crate) before_address: Option<u64>,
    pub(crate) before_closing: Option<u64>,
    /// What must never be.
    pub(crate) faults: Vec<String>,
    /// Whether all wires were open at once since the last of them opened.
    all_open: bool,
}

pub(crate) type Shared = Rc<RefCell<Bench>>;

impl Bench {
    /// With nothing connected.
    pub(crate) fn new() -> Self {
        Self {
            all_open: true,
            ..Self::default()
        }
    }

    /// A wire has these electrodes from now on.
    pub(crate) fn set(&mut self, wire: usize, electrodes: Vec<u8>) {
        if electrodes == self.connected[wire] {
            return;
        }
        if electrodes.len() > 1 {
            self.faults.push(format!("{electrodes:?} on one wire"));
        }
        let opened = electrodes.is_empty();
        let was = std::mem::replace(&mut self.connected[wire], electrodes);
        if opened {
            self.last_opened = self.now;
            self.all_open = self.connected.iter().all(Vec::is_empty);
            return;
        }
        if !was.is_empty() {
            self.faults
                .push(format!("wire {wire} changed from {was:?} without a break"));
        }
        if !self.all_open {
            self.faults.push(format!("wire {wire} closed before all were open"));
        }
        let waited = self.now - self.last_addressed;
        self.before_closing = Some(self.before_closing.map_or(waited, |w| w.min(waited)));
    }

    /// An address line of a wire changes, or a word is sent that chooses an input.
    pub(crate) fn addressed(&mut self, wire: usize) {
        if !self.connected[wire].is_empty() {
            self.faults
                .push(format!("address of wire {wire} changed under a closed switch"));
        }
        self.last_addressed = self.now;
        let waited = self.now - self.last_opened;
        self.before_address = Some(self.before_address.map_or(waited, |w| w.min(waited)));
    }

    /// The electrodes of the wires; `None`: open.
    fn electrodes(&self) -> [Option<u8>; WIRES] {
        self.connected.each_ref().map(|list| list.first().copied())
    }
}

/// Waiting is all that takes time.
pub(crate) struct Delay(pub(crate) Shared);

impl DelayNs for Delay {
    fn delay_ns(&mut self, ns: u32) {
        self.0.borrow_mut().now += u64::from(ns);
    }
}

/// Whatever a route asks for is connected and nothing else: every drive pair, each with every sense pair.
pub(crate) fn every_pair(router: &mut impl Router, bench: &Shared, electrodes: u8) {
    let pairs = || {
        (0..electrodes)
            .flat_map(move |a| (0..electrodes).map(move |b| (a, b)))
            .filter(|(a, b)| a != b)
    };
    // Of the drives of many electrodes those that differ in every line.
    let drives = pairs().filter(|(a, b)| electrodes <= 16 || a.abs_diff(*b) == 1 || a.abs_diff(*b) == electrodes / 2);
    for (plus, minus) in drives {
        for sense in pairs() {
            let route = Route {
                drive: Pair { plus, minus },
                sense: Sense::One(Pair {
                    plus: sense.0,
                    minus: sense.1,
                }),
                gain: 0,
            };
            router.select(&route).unwrap();
            let wanted = [plus, minus, sense.0, sense.1].map(Some);
            assert_eq!(bench.borrow().electrodes(), wanted, "{route:?}");
        }
    }
    let drive = Pair { plus: 3, minus: 1 };
    let route = |sense| Route { drive, sense, gain: 0 };
    router.select(&route(Sense::Source)).unwrap();
    assert_eq!(bench.borrow().electrodes(), [Some(3), Some(1), None, None]);
    // What it has not is refused, and what is connected stays.
    let beyond = Pair {
        plus: 0,
        minus: electrodes,
    };
    for wrong in [
        route(Sense::One(beyond)),
        route(Sense::All { step: 1 }),
        Route {
            drive: beyond,
            ..route(Sense::Source)
        },
    ] {
        assert!(router.select(&wrong).is_err(), "{wrong:?}");
        assert_eq!(bench.borrow().electrodes(), [Some(3), Some(1), None, None]);
    }
    assert_eq!(bench.borrow().faults, Vec::<String>::new());
}
