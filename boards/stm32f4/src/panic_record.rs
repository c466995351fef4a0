//! The record of a panic or a fault. It is kept in memory that a restart does not clear, and the board's next
//! introduction tells it.

use crate::identity::hexadecimal;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr::{addr_of, addr_of_mut};

/// Longest text.
const LONGEST: usize = 64;
/// Marks a record; anything else is what memory holds after power-up.
const MAGIC: u32 = 0x534B_494E;
/// In its place: the board restarted because its supply sagged.
const SAGGED: u32 = 0x5341_4744;

/// Why the run before ended, if it said so.
pub enum Past {
    /// By a bug.
    Panic(Report),
    /// The supply sagged.
    Sag,
}

/// A report of the run before.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Report {
    magic: u32,
    len: u32,
    bytes: [u8; LONGEST],
    /// Sum of the bytes and the length, so that half a record is none.
    sum: u32,
}

impl Report {
    /// What it says.
    pub fn text(&self) -> &str {
        let bytes = self.bytes.get(..self.len as usize).unwrap_or_default();
        core::str::from_utf8(bytes).unwrap_or("a panic that cannot be read")
    }

    fn summed(&self) -> u32 {
        let bytes = self
            .bytes
            .iter()
            .fold(0u32, |sum, b| sum.rotate_left(5) ^ u32::from(*b));
        bytes ^ self.len
    }

    fn add(&mut self, text: &str) {
        for byte in text.bytes() {
            if let Some(place) = self.bytes.get_mut(self.len as usize) {
                *place = if byte.is_ascii() { byte } else { b'?' };
                self.len += 1;
            }
        }
    }
}

// SAFETY: the section holds variables that are not given a first value, which this type allows.
#[unsafe(link_section = ".uninit.record")]
static mut RECORD: MaybeUninit<Report> = MaybeUninit::uninit();

/// What the run before left, once.
pub fn take() -> Option<Past> {
    // SAFETY: the record is used here, and by functions that restart the chip and never return, one at a time. It lies
    // in RAM, aligned for a `Report`. That is made of integers only, so that any bytes are one, if perhaps not a valid
    // one.
    let report = unsafe { addr_of!(RECORD).cast::<Report>().read_volatile() };
    // SAFETY: as above; the first word of the record is the mark.
    unsafe { addr_of_mut!(RECORD).cast::<u32>().write_volatile(0) };
    let valid = report.magic == MAGIC && report.len as usize <= LONGEST && report.sum == report.summed();
    if report.magic == SAGGED {
        return Some(Past::Sag);
    }
    #[cfg(feature = "fault-panic")]
    PANICKED.store(valid, core::sync::atomic::Ordering::Relaxed);
    valid.then_some(Past::Panic(report))
}

/// Restarts, and lets the next run say why.
pub fn restart_after_a_sag() -> ! {
    // SAFETY: as in `take`. Nothing reads the record any more in this run.
    unsafe { addr_of_mut!(RECORD).cast::<u32>().write_volatile(SAGGED) };
    cortex_m::peripheral::SCB::sys_reset()
}

/// Keeps a report and restarts.
fn keep(mut report: Report) -> ! {
    // Nobody looks after the sheet any more.
    crate::multiplexer::release();
    report.sum = report.summed();
    // SAFETY: as in `take`. Nothing reads the record any more in this run.
    unsafe { addr_of_mut!(RECORD).cast::<Report>().write_volatile(report) };
    cortex_m::peripheral::SCB::sys_reset()
}

const EMPTY: Report = Report {
    magic: MAGIC,
    len: 0,
    bytes: [0; LONGEST],
    sum: 0,
};

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    log!(error, "panic: {}", defmt::Display2Format(info));
    let mut report = EMPTY;
    if let Some(place) = info.location() {
        let file = place.file();
        // The end of a long path says more than its beginning.
        let start = file.char_indices().rev().take(28).last().map_or(0, |(k, _)| k);
        report.add(file.get(start..).unwrap_or(file));
        report.add(":");
        let (mut digits, mut left, mut at) = ([b'0'; 5], place.line().min(99_999), 5);
        while left > 0 {
            at -= 1;
            if let Some(digit) = digits.get_mut(at) {
                *digit = b'0' + (left % 10) as u8;
            }
            left /= 10;
        }
        report.add(core::str::from_utf8(digits.get(at..).unwrap_or_default()).unwrap_or_default());
        report.add(" ");
    }
    // Texts put together at run time would need the formatter, which is larger than all the rest.
    report.add(info.message().as_str().unwrap_or("panic"));
    keep(report)
}

// The stack may be what went wrong: the handler begins with an empty one, and is told where the old one ended.
core::arch::global_asm!(
    ".section .HardFault.user, \"ax\"",
    ".global HardFault",
    ".type HardFault,%function",
    ".thumb_func",
    "HardFault:",
    "mov r0, sp",
    "ldr r1, =_stack_start",
    "mov sp, r1",
    "b {entry}",
    entry = sym hard_fault,
);

// SAFETY: the linker makes both; they are never read.
unsafe extern "C" {
    /// The stack's limits, from the memory map; only their addresses mean anything.
    static _stack_end: u32;
    static _stack_start: u32;
}

// SAFETY: only the entry above goes there, with the stack pointer at the fault as its argument.
unsafe extern "C" fn hard_fault(stack: u32) -> ! {
    cortex_m::interrupt::disable();
    let mut report = EMPTY;
    if !(addr_of!(_stack_end) as u32..addr_of!(_stack_start) as u32).contains(&stack) {
        report.add("stack overflow");
    } else {
        report.add("hard fault at 0x");
        // SAFETY: `stack` is the stack pointer at the fault, inside the stack. The processor has put eight registers
        // there; the program counter is the seventh.
        let place = unsafe { (stack as *const u32).add(6).read_volatile() };
        let mut digits = [0; 8];
        hexadecimal(place, &mut digits);
        report.add(core::str::from_utf8(&digits).unwrap_or_default());
    }
    keep(report)
}

/// Whether [`take`] found a panic.
#[cfg(feature = "fault-panic")]
static PANICKED: core::sync::atomic::AtomicBool = core::sync::atomic::AtomicBool::new(false);

/// The planted faults, each of which the emulated board has to find reported. In a program for use this does nothing.
///
/// The panic comes once: the run after it has a report to tell.
pub fn planted() {
    #[cfg(feature = "fault-panic")]
    if !PANICKED.load(core::sync::atomic::Ordering::Relaxed) {
        panic!("planted");
    }
}

/// Hangs some time after the start: the board has said who it is, and measured if it does so by itself.
#[cfg(feature = "fault-hang")]
pub fn hang_later(now: u64) {
    const SAMPLES: u64 = 20_000;
    if now > SAMPLES {
        loop {
            cortex_m::asm::nop();
        }
    }
}
