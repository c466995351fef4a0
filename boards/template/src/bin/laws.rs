//! Every duty of the port, tried on the chip: run this first, and after every change.
#![no_std]
#![no_main]

use core::cell::Cell;
use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprintln};
use firmware::{Route, Sense, laws};
use protocol::Pair;
use template::{Chip, FrontEnd, INFO, Port, Ram};

#[entry]
fn main() -> ! {
    static mut MEMORY: Ram = Ram::new();
    let (port, time) = (Port::new(), Cell::new(0));
    let (Ok(mut front), Ok(mut chip)) = (FrontEnd::new(&port, &time), Chip::new(&time, MEMORY)) else {
        panic!("the board does not start");
    };
    // The source itself: the strongest signal, in phase whatever is on the sheet.
    let route = Route {
        drive: Pair { plus: 2, minus: 3 },
        sense: Sense::Source,
        gain: 0,
    };
    if let Err(e) = laws::check(&mut front, &route, 1, INFO.adc_bits, FrontEnd::stall) {
        panic!("front end: {e:?}");
    }
    if let Err(e) = laws::clock(&mut (front, &mut chip), |b| &mut b.0, |b| &mut b.1) {
        panic!("clock: {e:?}");
    }
    if let Err(e) = laws::store(&mut chip) {
        panic!("store: {e:?}");
    }
    if let Err(e) = laws::scratch(&mut chip) {
        panic!("scratch: {e:?}");
    }
    hprintln!("every duty kept");
    loop {
        debug::exit(debug::EXIT_SUCCESS);
    }
}
