//! Two sectors of the chip's flash memory, for the settings (RM0390 section 3, RM0090 section 3).

use crate::supply::supply_is_good;
use firmware::Sector;
use stm32f4xx_hal::pac;

/// Bytes of a sector.
pub const SECTOR_LEN: u32 = 16 * 1024;

/// It could not be written or erased, or there is no such place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashError;

/// Number and address of a sector.
const fn place(sector: Sector) -> (u32, u32) {
    match sector {
        Sector::A => (2, 0x0800_8000),
        Sector::B => (3, 0x0800_C000),
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

/// # Errors
/// It ends before that.
pub fn read(sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), FlashError> {
    let start = range(sector, offset, out.len())? as *const u8;
    for (k, byte) in out.iter_mut().enumerate() {
        // SAFETY: inside the sector. Volatile, since it changes behind the compiler's back.
        *byte = unsafe { start.add(k).read_volatile() };
    }
    Ok(())
}

/// # Errors
/// It ends before that, the supply is low, or the memory did not take it.
pub fn write(sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
    let start = range(sector, offset, bytes.len())? as *mut u8;
    let unlocked = Unlocked::new()?;
    let flash = unlocked.registers();
    // Programming, eight bits at a time: any supply voltage does.
    flash.cr().write(|w| unsafe { w.bits(1) });
    for (k, byte) in bytes.iter().enumerate() {
        // SAFETY: inside the sector, which holds no program; programming is on.
        unsafe { start.add(k).write_volatile(*byte) };
        unlocked.wait()?;
    }
    Ok(())
}

/// # Errors
/// The supply is low, or the memory could not be erased.
pub fn erase(sector: Sector) -> Result<(), FlashError> {
    let unlocked = Unlocked::new()?;
    let flash = unlocked.registers();
    // Sector erase, 32 bits at a time (2.7 V and more); then the start bit.
    let control = 2 << 8 | place(sector).0 << 3 | 1 << 1;
    flash.cr().write(|w| unsafe { w.bits(control) });
    flash.cr().write(|w| unsafe { w.bits(control | 1 << 16) });
    unlocked.wait()
}

/// The control register while it can be written; locked again when dropped.
struct Unlocked(());

impl Unlocked {
    fn new() -> Result<Self, FlashError> {
        if !supply_is_good() {
            return Err(FlashError);
        }
        let this = Self(());
        let flash = this.registers();
        while flash.sr().read().bits() & 1 << 16 != 0 {}
        flash.keyr().write(|w| unsafe { w.bits(0x4567_0123) });
        flash.keyr().write(|w| unsafe { w.bits(0xCDEF_89AB) });
        // Errors left over from before.
        flash.sr().write(|w| unsafe { w.bits(0xF3) });
        Ok(this)
    }

    fn registers(&self) -> &'static pac::flash::RegisterBlock {
        // SAFETY: nothing else uses them after the clocks are set up.
        unsafe { &*pac::FLASH::ptr() }
    }

    fn wait(&self) -> Result<(), FlashError> {
        let flash = self.registers();
        while flash.sr().read().bits() & 1 << 16 != 0 {}
        if flash.sr().read().bits() & 0xF2 != 0 {
            Err(FlashError)
        } else {
            Ok(())
        }
    }
}

impl Drop for Unlocked {
    fn drop(&mut self) {
        let flash = self.registers();
        flash.cr().write(|w| unsafe { w.bits(1 << 31) });
        // What the data cache holds of the sector is old: off, emptied, on.
        let access = flash.acr().read().bits();
        flash.acr().write(|w| unsafe { w.bits(access & !(1 << 10)) });
        flash.acr().write(|w| unsafe { w.bits(access & !(1 << 10) | 1 << 12) });
        flash.acr().write(|w| unsafe { w.bits(access) });
    }
}
