//! A flash memory of `embedded-storage` as the store, whose power goes at any unit.

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use firmware::settings::{self, Settings};
use firmware::{Sector, Store, Watchdog, laws};
use parts::{NorStore, WRONG_PLACE};
use protocol::{Plan, Watch};

/// A memory whose units can be written once after they were erased, as those with error correction.
#[derive(Clone)]
struct Flash<const UNIT: usize> {
    bytes: Vec<u8>,
    /// Of every unit, whether it was written since it was erased.
    written: Vec<bool>,
    /// Units until the power goes.
    left: Option<u32>,
}

const ERASED_AT_ONCE: usize = 1024;

impl<const UNIT: usize> Flash<UNIT> {
    fn new(len: usize) -> Self {
        Self {
            bytes: vec![0xFF; len],
            written: vec![false; len / UNIT],
            left: None,
        }
    }

    /// Whether there is still power for one unit more.
    fn spend(&mut self) -> Result<(), NorFlashErrorKind> {
        match &mut self.left {
            Some(0) => Err(NorFlashErrorKind::Other),
            Some(n) => {
                *n -= 1;
                Ok(())
            }
            None => Ok(()),
        }
    }
}

impl<const UNIT: usize> ErrorType for Flash<UNIT> {
    type Error = NorFlashErrorKind;
}

impl<const UNIT: usize> ReadNorFlash for Flash<UNIT> {
    const READ_SIZE: usize = UNIT;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        embedded_storage::nor_flash::check_read(self, offset, bytes.len())?;
        bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl<const UNIT: usize> NorFlash for Flash<UNIT> {
    const WRITE_SIZE: usize = UNIT;
    const ERASE_SIZE: usize = ERASED_AT_ONCE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        embedded_storage::nor_flash::check_erase(self, from, to)?;
        for unit in from as usize / UNIT..to as usize / UNIT {
            // A unit that is half erased reads as anything.
            self.bytes[unit * UNIT..][..UNIT].fill(0x5A);
            self.spend()?;
            self.bytes[unit * UNIT..][..UNIT].fill(0xFF);
            self.written[unit] = false;
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        embedded_storage::nor_flash::check_write(self, offset, bytes.len())?;
        for (unit, new) in (offset as usize / UNIT..).zip(bytes.chunks(UNIT)) {
            assert!(!self.written[unit], "unit {unit} is written twice");
            self.written[unit] = true;
            // A unit that is half written reads as anything.
            self.bytes[unit * UNIT..][..UNIT].fill(0xA5);
            self.spend()?;
            self.bytes[unit * UNIT..][..UNIT].copy_from_slice(new);
        }
        Ok(())
    }
}

/// A store that no watchdog waits for.
struct Unwatched<F>(NorStore<F>);

impl<F> Watchdog for Unwatched<F> {
    fn feed(&mut self) {}
}

impl<F: NorFlash> Store for Unwatched<F> {
    type Error = <NorStore<F> as Store>::Error;

    fn sector_len(&self) -> u32 {
        self.0.sector_len()
    }

    fn write_len(&self) -> u32 {
        self.0.write_len()
    }

    fn read(&mut self, sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), Self::Error> {
        self.0.read(sector, offset, out)
    }

    fn write(&mut self, sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.0.write(sector, offset, bytes)
    }

    fn erase(&mut self, sector: Sector) -> Result<(), Self::Error> {
        self.0.erase(sector)
    }
}

fn store<F: NorFlash>(flash: F) -> Unwatched<F> {
    Unwatched(store_of(flash).unwrap())
}

fn settings(k: u16) -> Settings {
    let mut plan = Plan::fast();
    plan.slots.truncate(1 + usize::from(k) % 16);
    Settings {
        autostart: k.is_multiple_of(2),
        excitation_permille: k,
        plan,
        watch: k.is_multiple_of(3).then(Watch::default),
    }
}

/// The laws, many turns of the log, and a cut at every unit of a saving, from many places of the log.
fn survives<const UNIT: usize>() {
    assert_eq!(laws::store(&mut store(Flash::<UNIT>::new(4096))), Ok(()), "{UNIT}");
    let mut flash = Flash::<UNIT>::new(4096);
    let (mut old_kept, mut cuts) = (0, 0);
    for k in 0..30 {
        for left in 0.. {
            let mut cut = flash.clone();
            cut.left = Some(left);
            let saved = settings::save(&mut store(&mut cut), &settings(k)).is_ok();
            cut.left = None;
            let found = settings::load(&mut store(&mut cut)).unwrap();
            let old = k.checked_sub(1).map(settings);
            assert!(
                found == Some(settings(k)) || found == old && !saved,
                "{UNIT} {k} {left}"
            );
            (old_kept, cuts) = (old_kept + u32::from(found == old), cuts + 1);
            // And the log goes on behind what the cut left.
            settings::save(&mut store(&mut cut), &settings(777)).unwrap();
            assert_eq!(
                settings::load(&mut store(&mut cut)),
                Ok(Some(settings(777))),
                "{UNIT} {k} {left}"
            );
            if saved {
                break;
            }
        }
        settings::save(&mut store(&mut flash), &settings(k)).unwrap();
    }
    println!("units of {UNIT}: {cuts} cuts, the old settings {old_kept} times");
    assert!(old_kept > 30 && old_kept < cuts);
}

fn store_of<F: NorFlash>(flash: F) -> Result<NorStore<F>, &'static str> {
    NorStore::new(flash, 2048, 1024)
}

#[test]
fn settings_survive_a_cut_at_every_unit_of_every_size() {
    survives::<1>();
    survives::<2>();
    survives::<4>();
    survives::<8>();
    survives::<16>();
    survives::<32>();
}

#[test]
fn a_place_that_cannot_be_is_refused_with_what_is_wrong() {
    for (start, len) in [(0, 0), (512, 1024), (0, 1000), (3072, 1024), (0, !1023)] {
        let found = NorStore::new(Flash::<8>::new(4096), start, len).map(|_| ());
        assert_eq!(found, Err(WRONG_PLACE), "{start} {len}");
    }
    assert!(store_of(Flash::<64>::new(4096)).is_err());
    // Half units, and beyond the end.
    let mut store = store_of(Flash::<8>::new(4096)).unwrap();
    assert!(store.write(Sector::A, 4, &[0; 8]).is_err());
    assert!(store.write(Sector::A, 0, &[0; 4]).is_err());
    assert!(store.write(Sector::A, 1024, &[0; 8]).is_err());
    assert!(store.read(Sector::B, 1020, &mut [0; 5]).is_err());
}
