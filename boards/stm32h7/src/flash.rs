//! Two sectors of the second bank of the chip's flash memory, for the settings (RM0433 section 4).
//!
//! The memory is written in words of 32 bytes, each once after it was erased, and has error correction. A word whose writing
//! was cut off reads as a bus fault. [`read`] survives that and gives zeros in its place, which no record begins with and
//! which do not look erased.

use crate::pac;
use crate::supply::supply_is_good;
use firmware::Sector;

/// Bytes of a sector that are used, of 128 KiB: a look through them is quick.
pub const SECTOR_LEN: u32 = 16 * 1024;
/// Bytes that are written at once.
pub const WORD_LEN: u32 = 32;

/// The two keys that open the control register, in this order (RM0433 section 4.5.1).
const KEY_1: u32 = 0x4567_0123;
const KEY_2: u32 = 0xCDEF_89AB;

/// It could not be written or erased, or there is no such place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashError;

/// The first address of the second bank; or of what the emulated chip has in its place, for its tests alone: rigless's flash
/// memory has no check bits.
const BANK: u32 = if cfg!(feature = "emulated-check-bits") {
    0x0820_0000
} else {
    0x0810_0000
};

/// Number in its bank and address of a sector.
const fn place(sector: Sector) -> (u8, u32) {
    match sector {
        Sector::A => (0, BANK),
        Sector::B => (1, BANK + 0x2_0000),
    }
}

/// The address of `len` bytes from `offset` on.
fn range(sector: Sector, offset: u32, len: usize) -> Result<u32, FlashError> {
    let end = offset
        .checked_add(u32::try_from(len).map_err(|_| FlashError)?)
        .ok_or(FlashError)?;
    if end > SECTOR_LEN {
        return Err(FlashError);
    }
    Ok(place(sector).1 + offset)
}

/// Reads from an offset on, in bytes.
///
/// # Errors
/// The sector ends before that.
pub fn read(sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), FlashError> {
    let mut place = range(sector, offset, out.len())?;
    let mut rest = out;
    while !rest.is_empty() {
        let len = rest.len().min((WORD_LEN - place % WORD_LEN) as usize);
        let part = rest.split_off_mut(..len).unwrap_or_default();
        if !read_word(place as *const u8, part) {
            part.fill(0);
        }
        place += len as u32;
    }
    Ok(())
}

/// Bytes of one word; false where it was never written in full.
fn read_word(place: *const u8, out: &mut [u8]) -> bool {
    let bank = registers().bank2();
    // An error that is left over from before says nothing of this word.
    bank.ccr().write(|w| w.clr_dbeccerr().set_bit());
    // SAFETY: `place` and as many bytes as `out` has are inside a sector, which is memory-mapped. Bus faults are ignored from
    // the first to the last of these lines, and nothing else runs meanwhile: with FAULTMASK set not even a fault's handler
    // does (DDI 0403, B1.5.4, B3.2.8).
    unsafe {
        let core = cortex_m::Peripherals::steal();
        core::arch::asm!("cpsid f", options(nostack, preserves_flags));
        if !cfg!(feature = "fault-read") {
            core.SCB.ccr.modify(|ccr| ccr | IGNORE_BUS_FAULTS);
        }
        cortex_m::asm::dsb();
        for (k, byte) in out.iter_mut().enumerate() {
            *byte = place.add(k).read_volatile();
        }
        cortex_m::asm::dsb();
        core.SCB.ccr.modify(|ccr| ccr & !IGNORE_BUS_FAULTS);
        core::arch::asm!("cpsie f", options(nostack, preserves_flags));
    }
    !bank.sr().read().dbeccerr().bit_is_set()
}

/// BFHFNMIGN in the configuration and control register.
const IGNORE_BUS_FAULTS: u32 = 1 << 8;

/// Writes from an offset on, in bytes: whole words. The place has to be erased.
///
/// # Errors
/// The sector ends before that, these are no whole words, or the memory did not take them.
pub fn write(sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
    let start = range(sector, offset, bytes.len())? as *mut u32;
    let (words, rest) = bytes.as_chunks::<{ WORD_LEN as usize }>();
    if !offset.is_multiple_of(WORD_LEN) || !rest.is_empty() {
        return Err(FlashError);
    }
    let unlocked = Unlocked::new()?;
    let bank = registers().bank2();
    for (k, word) in words.iter().enumerate() {
        // Programming, 64 bits at a time.
        // SAFETY: three is a value of the field.
        bank.cr().write(|w| unsafe { w.psize().bits(3).pg().set_bit() });
        for (j, four) in word.as_chunks::<4>().0.iter().enumerate() {
            // SAFETY: `range` has checked that all of `bytes` is inside the sector. The sector holds no program and no
            // variable (memory_map.x), and programming is on.
            unsafe { start.add(8 * k + j).write_volatile(u32::from_ne_bytes(*four)) };
        }
        cortex_m::asm::dsb();
        unlocked.wait()?;
    }
    Ok(())
}

/// Erases the sector: every byte becomes 0xFF.
///
/// # Errors
/// The memory could not be erased.
pub fn erase(sector: Sector) -> Result<(), FlashError> {
    let unlocked = Unlocked::new()?;
    let bank = registers().bank2();
    // SAFETY: the sector is the settings' own, and all values are ones that the fields take.
    bank.cr().write(|w| unsafe {
        w.psize().bits(3).ser().set_bit().snb().bits(place(sector).0);
        w.start().set_bit()
    });
    unlocked.wait()
}

fn registers() -> &'static pac::flash::RegisterBlock {
    // SAFETY: the address is that of the flash controller's registers. Of the second bank's only the holder of an
    // `Unlocked` writes any, but for a flag that `read_word` clears.
    unsafe { &*pac::FLASH::ptr() }
}

/// The control register of the second bank while it can be written; locked again when dropped.
struct Unlocked(());

impl Unlocked {
    fn new() -> Result<Self, FlashError> {
        if !supply_is_good() {
            return Err(FlashError);
        }
        let bank = registers().bank2();
        let this = Self(());
        while bank.sr().read().qw().bit_is_set() {}
        if bank.cr().read().lock().bit_is_set() {
            // SAFETY: the register takes any key.
            unsafe {
                bank.keyr().write(|w| w.bits(KEY_1));
                bank.keyr().write(|w| w.bits(KEY_2));
            }
        }
        // Errors left over from before, and the end of an operation.
        bank.ccr().write(|w| {
            w.clr_eop().set_bit().clr_wrperr().set_bit().clr_pgserr().set_bit();
            w.clr_strberr().set_bit().clr_incerr().set_bit().clr_operr().set_bit()
        });
        if bank.cr().read().lock().bit_is_set() {
            return Err(FlashError);
        }
        Ok(this)
    }

    fn wait(&self) -> Result<(), FlashError> {
        let bank = registers().bank2();
        while bank.sr().read().qw().bit_is_set() {}
        let status = bank.sr().read();
        let failed = status.wrperr().bit_is_set()
            || status.pgserr().bit_is_set()
            || status.strberr().bit_is_set()
            || status.incerr().bit_is_set()
            || status.operr().bit_is_set();
        if failed { Err(FlashError) } else { Ok(()) }
    }
}

impl Drop for Unlocked {
    fn drop(&mut self) {
        let bank = registers().bank2();
        // Programming off, and locked.
        bank.cr().modify(|_, w| w.pg().clear_bit().lock().set_bit());
    }
}
