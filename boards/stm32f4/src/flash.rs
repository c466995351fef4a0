//! Two sectors of the chip's flash memory, for the settings (RM0390 section 3, RM0090 section 3).

use crate::supply::supply_is_good;
use firmware::Sector;
use stm32f4xx_hal::pac;

/// Bytes of a sector.
pub const SECTOR_LEN: u32 = 16 * 1024;

/// The two keys that open the control register, in this order (RM0390 section 3.5.1, RM0090 section 3.6.1).
const KEY_1: u32 = 0x4567_0123;
const KEY_2: u32 = 0xCDEF_89AB;

/// It could not be written or erased, or there is no such place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashError;

/// Number and address of a sector.
const fn place(sector: Sector) -> (u8, u32) {
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
        // SAFETY: `range` has checked that all of `out` is inside the sector, which is memory-mapped flash on every STM32F4 and may
        // be read byte by byte. Volatile, since it changes behind the compiler's back.
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
    flash
        .cr()
        .write(|w| w.lock().unlocked().psize().psize8().pg().program());
    for (k, byte) in bytes.iter().enumerate() {
        // SAFETY: `range` has checked that all of `bytes` is inside the sector. The sector holds no program and no variable
        // (memory_map.x), and programming is on.
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
    flash.cr().write(|w| erasure(w, sector));
    flash.cr().write(|w| erasure(w, sector).strt().start());
    unlocked.wait()
}

/// Sector erase, 32 bits at a time (2.7 V and more), not started yet.
fn erasure(w: &mut pac::flash::cr::W, sector: Sector) -> &mut pac::flash::cr::W {
    w.lock().unlocked().psize().psize32().ser().sector_erase();
    // SAFETY: the number is 2 or 3. Every STM32F4 has these sectors, and here they hold the settings only.
    unsafe { w.snb().bits(place(sector).0) }
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
        while flash.sr().read().bsy().is_busy() {}
        flash.keyr().write(|w| w.key().set(KEY_1));
        flash.keyr().write(|w| w.key().set(KEY_2));
        // Errors left over from before, and the end of an operation.
        flash.sr().write(|w| {
            w.eop().clear().operr().clear().wrperr().clear();
            w.pgaerr().clear().pgperr().clear().pgserr().clear()
        });
        Ok(this)
    }

    fn registers(&self) -> &'static pac::flash::RegisterBlock {
        // SAFETY: the address is that of the flash controller's registers. `chip::start` is done with them before anything is stored,
        // and afterwards only the holder of an `Unlocked` writes them.
        unsafe { &*pac::FLASH::ptr() }
    }

    fn wait(&self) -> Result<(), FlashError> {
        let flash = self.registers();
        while flash.sr().read().bsy().is_busy() {}
        let status = flash.sr().read();
        let failed = status.operr().is_active()
            || status.wrperr().is_active()
            || status.pgaerr().is_active()
            || status.pgperr().is_active()
            || status.pgserr().is_active();
        if failed { Err(FlashError) } else { Ok(()) }
    }
}

impl Drop for Unlocked {
    fn drop(&mut self) {
        let flash = self.registers();
        flash.cr().write(|w| w.lock().locked());
        // What the data cache holds of the sector is old: off, emptied, as it was.
        let cached = flash.acr().read().dcen().is_enabled();
        flash.acr().modify(|_, w| w.dcen().disabled());
        flash.acr().modify(|_, w| w.dcen().disabled().dcrst().reset());
        flash.acr().modify(|_, w| w.dcen().bit(cached).dcrst().no_reset());
    }
}
