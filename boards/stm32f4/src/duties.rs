//! The duties of front end and clock (`firmware::laws`), tried on the chip itself: what the programs `laws` of the boards share.

use crate::chip::Chip;
use crate::front_end::FrontEnd;
use crate::serial::Serial;
use core::fmt::Write;
use embedded_hal_nb::serial::Write as _;
use firmware::{Blocking, BoardInfo, Excitation, Route, Router, Sense, Window, laws};
use protocol::{Outgoing, PanicText};

/// The front end, and the chip with its clock.
pub struct Both(pub FrontEnd, pub Chip);

/// Tries the front end of a board on a route whose first channel sees the excitation in phase. Of what is broken, the first
/// is added to what was found. A stall has to be longer than the ring of samples.
#[inline(never)]
pub fn front_end(both: &mut Both, route: &Route, info: &BoardInfo<'_>, stall_cycles: u32, found: &mut PanicText) {
    let channels = match route.sense {
        Sense::All { .. } => info.channels,
        _ => 1,
    };
    // The filter behind the DAC has to swing in before its phase can be tried.
    let settle = Window {
        settle_quarters: 8,
        periods: 1,
        channels,
    };
    let swung_in = both
        .0
        .switch_on()
        .and_then(|()| both.0.select(route))
        .and_then(|()| Blocking(&mut both.0).capture(settle, |_| {}));
    if let Err(e) = swung_in {
        let _ = write!(found, "{e:?}");
    }
    // The watchdog must not bite: a stall is short, all else polls.
    if let Err(e) = laws::check(&mut both.0, route, channels, info.adc_bits, |_| {
        cortex_m::asm::delay(stall_cycles);
    }) {
        let _ = write!(found, "{e:?}");
    }
}

/// Tries the clock against the windows of the route that was tried last, which has one channel.
#[inline(never)]
pub fn clock(both: &mut Both, found: &mut PanicText) {
    if let Err(e) = laws::clock(both, |b| &mut b.0, |b| &mut b.1) {
        let _ = write!(found, "{e:?}");
    }
}

/// Says what was found, in an introduction.
#[inline(never)]
pub fn say(info: &BoardInfo<'_>, link: &mut Serial) {
    let hello = info.hello();
    let mut bytes = [0; 256];
    if let Ok(framed) = protocol::encode(&Outgoing::Hello(&hello), &mut bytes) {
        for byte in [0].iter().chain(framed.iter()) {
            while link.write(*byte).is_err() {}
        }
        while link.flush().is_err() {}
    }
}
