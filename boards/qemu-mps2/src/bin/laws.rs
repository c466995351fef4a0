//! The duties of a front end (`firmware::laws`), checked on the emulated processor.
#![no_std]
#![no_main]

use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprintln};
use firmware::{Route, Sense, laws};
use protocol::Pair;
use qemu_mps2::RemoteFrontEnd;

#[entry]
fn main() -> ! {
    let Ok(mut front) = RemoteFrontEnd::open() else {
        panic!("no front-end.request and front-end.reply in the working directory");
    };
    for sense in [Sense::One(Pair { plus: 9, minus: 8 }), Sense::All { step: 1 }] {
        let route = Route {
            drive: Pair { plus: 2, minus: 3 },
            sense,
            gain: 0,
        };
        if let Err(e) = laws::check(&mut front, &route, 16, 12, |f| {
            let _ = f.stall();
        }) {
            panic!("{sense:?}: {e:?}");
        }
    }
    hprintln!("every duty kept");
    loop {
        debug::exit(debug::EXIT_SUCCESS);
    }
}
