//! Multiplexers with lines and with words.

use crate::bench::{Bench, Delay, Shared, every_pair};
use embedded_hal::digital::{ErrorType, OutputPin};
use embedded_hal::spi::{self, Operation, SpiDevice};
use parts::{Adg731, Fixed, Joined, Multiplexer, Mux4051, Mux4067, Switches};
use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;

const DEAD_NS: u32 = 60;

/// The chips of one wire: levels of their address and enable lines.
struct Chips {
    bench: Shared,
    wire: usize,
    /// Address lines of a chip: three, or four.
    lines: usize,
    address: Vec<Vec<bool>>,
    enable: Vec<bool>,
}

impl Chips {
    /// By the truth table: enable high: nothing; else the input that the lines are the binary number of.
    fn update(&self) {
        let mut electrodes = Vec::new();
        for (chip, enable) in self.enable.iter().enumerate() {
            if !*enable {
                let weights = [1, 2, 4, 8];
                let input: u8 = self.address[chip]
                    .iter()
                    .zip(weights)
                    .map(|(on, w)| u8::from(*on) * w)
                    .sum();
                electrodes.push(input + ((chip << self.lines) as u8));
            }
        }
        self.bench.borrow_mut().set(self.wire, electrodes);
    }
}

/// A pin of a chip: `None` is its enable line.
struct Pin {
    chips: Rc<RefCell<Chips>>,
    chip: usize,
    line: Option<usize>,
}

impl ErrorType for Pin {
    type Error = Infallible;
}

impl Pin {
    fn set(&mut self, high: bool) {
        let mut chips = self.chips.borrow_mut();
        match self.line {
            Some(line) if chips.address[self.chip][line] != high => {
                chips.bench.borrow_mut().addressed(chips.wire);
                chips.address[self.chip][line] = high;
            }
            Some(_) => {}
            None => chips.enable[self.chip] = high,
        }
        chips.update();
    }
}

impl OutputPin for Pin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.set(false);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.set(true);
        Ok(())
    }
}

fn chips(bench: &Shared, wire: usize, count: usize, lines: usize) -> Rc<RefCell<Chips>> {
    Rc::new(RefCell::new(Chips {
        bench: bench.clone(),
        wire,
        lines,
        address: vec![vec![false; lines]; count],
        enable: vec![true; count],
    }))
}

fn pins<const N: usize>(chips: &Rc<RefCell<Chips>>, chip: usize) -> ([Pin; N], Pin) {
    let pin = |line| Pin {
        chips: chips.clone(),
        chip,
        line,
    };
    (std::array::from_fn(|k| pin(Some(k))), pin(None))
}

fn switches<M: Multiplexer>(bench: &Shared, mux: impl Fn(usize) -> M) -> Switches<M, M, M, M, Fixed, Delay> {
    Switches {
        drive_plus: mux(0),
        drive_minus: mux(1),
        sense_plus: mux(2),
        sense_minus: mux(3),
        amplifier: Fixed,
        delay: Delay(bench.clone()),
        dead_ns: DEAD_NS,
    }
}

/// The dead time passes twice in every change.
fn waits(bench: &Shared) {
    let bench = bench.borrow();
    assert!(
        bench.before_address.unwrap() >= DEAD_NS.into(),
        "{:?}",
        bench.before_address
    );
    assert!(
        bench.before_closing.unwrap() >= DEAD_NS.into(),
        "{:?}",
        bench.before_closing
    );
}

#[test]
fn pairs_of_4051_connect_every_pair_and_break_before_they_make() {
    let bench = Rc::new(RefCell::new(Bench::new()));
    let mut router = switches(&bench, |wire| {
        let chips = chips(&bench, wire, 2, 3);
        let half = |chip| {
            let (address, enable) = pins::<3>(&chips, chip);
            Mux4051::new(address, enable).unwrap()
        };
        Joined::new(half(0), half(1))
    });
    every_pair(&mut router, &bench, 16);
    waits(&bench);
    router.release().unwrap();
}

#[test]
fn a_4067_connects_every_pair_and_breaks_before_it_makes() {
    let bench = Rc::new(RefCell::new(Bench::new()));
    let mut router = switches(&bench, |wire| {
        let (address, enable) = pins::<4>(&chips(&bench, wire, 1, 4), 0);
        Mux4067::new(address, enable).unwrap()
    });
    every_pair(&mut router, &bench, 16);
    waits(&bench);
}

/// The bench does find a multiplexer that changes its address while it is closed.
#[test]
fn an_address_under_a_closed_switch_is_found() {
    let bench = Rc::new(RefCell::new(Bench::new()));
    let (address, enable) = pins::<4>(&chips(&bench, 0, 1, 4), 0);
    let mut mux = Mux4067::new(address, enable).unwrap();
    mux.open().unwrap();
    mux.address(3).unwrap();
    mux.close().unwrap();
    mux.address(4).unwrap();
    assert!(
        bench
            .borrow()
            .faults
            .iter()
            .any(|f| f.contains("under a closed switch"))
    );
}

/// An ADG731 (ADG725/ADG731 data sheet): of the byte bit 7 opens everything, bit 6 leaves everything as it is, bits 4 to 0
/// are the input.
struct Word {
    bench: Shared,
    wire: usize,
}

impl spi::ErrorType for Word {
    type Error = spi::ErrorKind;
}

impl SpiDevice for Word {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), spi::ErrorKind> {
        let [Operation::Write([byte])] = operations else {
            panic!("{operations:?}");
        };
        let mut bench = self.bench.borrow_mut();
        if *byte & 0x80 != 0 {
            bench.set(self.wire, Vec::new());
        } else if *byte & 0x40 == 0 {
            bench.set(self.wire, vec![*byte & 0x1F]);
        }
        Ok(())
    }
}

#[test]
fn an_adg731_connects_every_pair_of_32_electrodes_and_breaks_before_it_makes() {
    let bench = Rc::new(RefCell::new(Bench::new()));
    let mut router = switches(&bench, |wire| {
        Adg731::new(Word {
            bench: bench.clone(),
            wire,
        })
        .unwrap()
    });
    every_pair(&mut router, &bench, 32);
    // Its word opens or connects at once: the whole dead time lies between.
    assert!(
        bench
            .borrow()
            .before_closing
            .is_some_and(|ns| ns >= 2 * u64::from(DEAD_NS))
    );
}
