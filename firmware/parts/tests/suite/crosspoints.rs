//! ADG2128 on one bus, by the data sheet's table of addresses.

use crate::bench::{Bench, Shared, WIRES, every_pair};
use embedded_hal::i2c::{self, ErrorType, I2c, NoAcknowledgeSource, Operation};
use firmware::{Route, Router, Sense};
use parts::{Crosspoint, FIRST_ADDRESS, Fixed};
use protocol::Pair;
use std::cell::RefCell;
use std::rc::Rc;

/// The codes of lines X0 to X11 in the data sheet's table; 0110, 0111, 1110 and 1111 are reserved.
const X_CODES: [u8; 12] = [
    0b0000, 0b0001, 0b0010, 0b0011, 0b0100, 0b0101, 0b1000, 0b1001, 0b1010, 0b1011, 0b1100, 0b1101,
];

/// Two chips, every switch of which may be closed at power-up of the processor.
struct Bus {
    bench: Shared,
    closed: Rc<RefCell<[[[bool; 8]; 12]; 2]>>,
    /// Messages until one is not acknowledged, once.
    fails_after: Rc<RefCell<Option<u32>>>,
}

impl ErrorType for Bus {
    type Error = i2c::ErrorKind;
}

impl Bus {
    fn update(&self) {
        let closed = self.closed.borrow();
        for wire in 0..WIRES {
            let on = |e: &u8| closed[usize::from(*e / 12)][usize::from(*e % 12)][wire];
            self.bench.borrow_mut().set(wire, (0..24).filter(on).collect());
        }
        assert!(
            closed.iter().flatten().all(|x| !x[WIRES..].contains(&true)),
            "a line that nothing is on"
        );
    }
}

impl I2c for Bus {
    fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), i2c::ErrorKind> {
        let mut left = self.fails_after.borrow_mut();
        if *left == Some(0) {
            *left = None;
            return Err(i2c::ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data));
        }
        *left = left.map(|n| n - 1);
        let [Operation::Write([word, load])] = operations else {
            panic!("{operations:?}");
        };
        assert_eq!(*load & 1, 1, "nothing would switch");
        let chip = usize::from(address - 0x70);
        let x = X_CODES
            .iter()
            .position(|c| *c == *word >> 3 & 15)
            .expect("a reserved code");
        self.closed.borrow_mut()[chip][x][usize::from(*word & 7)] = *word & 0x80 != 0;
        self.update();
        Ok(())
    }
}

fn bench() -> (Shared, Bus) {
    let bench = Rc::new(RefCell::new(Bench::new()));
    let bus = Bus {
        bench: bench.clone(),
        closed: Rc::default(),
        fails_after: Rc::default(),
    };
    (bench, bus)
}

#[test]
fn two_crosspoints_connect_every_pair_of_24_electrodes_and_break_before_they_make() {
    let (bench, bus) = bench();
    let mut router = Crosspoint::new(bus, Fixed, [FIRST_ADDRESS, FIRST_ADDRESS + 1]);
    assert_eq!(router.electrodes(), 24);
    every_pair(&mut router, &bench, 24);
}

fn route(plus: u8, minus: u8) -> Route {
    Route {
        drive: Pair { plus, minus },
        sense: Sense::One(Pair { plus: 5, minus: 17 }),
        gain: 0,
    }
}

#[test]
fn what_the_run_before_left_closed_is_opened_first() {
    let (bench, bus) = bench();
    bus.closed.borrow_mut()[1][7][2] = true;
    bus.closed.borrow_mut()[0][3][0] = true;
    bus.update();
    bench.borrow_mut().faults.clear();
    let closed = bus.closed.clone();
    let mut router = Crosspoint::new(bus, Fixed, [FIRST_ADDRESS, FIRST_ADDRESS + 1]);
    router.select(&route(0, 23)).unwrap();
    let count = closed.borrow().iter().flatten().flatten().filter(|on| **on).count();
    assert_eq!(
        (count, bench.borrow().faults.len()),
        (4, 0),
        "{:?}",
        bench.borrow().faults
    );
}

#[test]
fn after_a_bus_fault_at_any_message_the_next_route_is_right_again() {
    for fails_after in 0..8 {
        let (bench, bus) = bench();
        let (closed, fault) = (bus.closed.clone(), bus.fails_after.clone());
        let mut router = Crosspoint::new(bus, Fixed, [FIRST_ADDRESS, FIRST_ADDRESS + 1]);
        router.select(&route(0, 1)).unwrap();
        *fault.borrow_mut() = Some(fails_after);
        assert!(router.select(&route(2, 3)).is_err());
        router.select(&route(4, 22)).unwrap();
        let closed = closed.borrow();
        let on: Vec<(usize, usize)> = (0..24)
            .flat_map(|e| (0..8).map(move |y| (e, y)))
            .filter(|(e, y)| closed[e / 12][e % 12][*y])
            .collect();
        assert_eq!(on, [(4, 0), (5, 2), (17, 3), (22, 1)]);
        assert_eq!(bench.borrow().faults, Vec::<String>::new());
    }
}
