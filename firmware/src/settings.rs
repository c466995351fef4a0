//! What the board keeps while it is switched off, so that a power cut at any byte leaves the old or the new.
//!
//! Each of the two sectors of the [`Store`] is a log of records. A record is written behind the last one; when the sector is
//! full the other one is erased and the log goes on there. Whichever valid record has the highest number counts. So what
//! counts is never touched while its successor is being written: a cut leaves a record without its check sum behind, or an
//! other sector half erased, and both are passed over. What was written is read back and compared.
//!
//! Whatever a memory holds, the search for records feeds the watchdog before every place that it looks at.
//!
//! ```text
//! record: 0xA5, format, length u16, number u32, postcard(settings), CRC-32C of all that; little-endian
//! ```

use crate::support::{Sector, Store, Watchdog};
use postcard::de_flavors::Flavor as Source;
use postcard::ser_flavors::Flavor as Sink;
use protocol::{Plan, Watch};
use serde::{Deserialize, Serialize};

/// What is kept.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Settings {
    /// Whether to start by itself at power-up.
    pub autostart: bool,
    /// Amplitude of the excitation, in thousandths of full scale.
    pub excitation_permille: u16,
    /// What frames measure.
    pub plan: Plan,
    /// What is watched while nothing touches.
    pub watch: Option<Watch>,
}

impl Settings {
    /// Of a board that was told nothing: no plan yet.
    pub const NONE: Self = Self {
        autostart: false,
        excitation_permille: 1000,
        plan: Plan::NONE,
        watch: None,
    };
}

impl Settings {
    /// Takes over all of another's, without another copy on the stack.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.autostart = other.autostart;
        self.excitation_permille = other.excitation_permille;
        copy_plan(&mut self.plan, &other.plan);
        self.watch.clone_from(&other.watch);
    }
}

/// Makes a plan the same as another, without another copy on the stack.
pub(crate) fn copy_plan(to: &mut Plan, from: &Plan) {
    to.id = from.id;
    to.settle_quarters = from.settle_quarters;
    to.integrate_periods = from.integrate_periods;
    to.sampling = from.sampling;
    to.quadrature = from.quadrature;
    to.slots.clear();
    // Cannot fail: it is as long.
    let _ = to.slots.extend_from_slice(&from.slots);
}

/// Version of the stored format. A firmware that knows another one starts with its own settings.
const FORMAT: u8 = 1;
/// First byte of a record; erased memory reads 0xFF.
const MARK: u8 = 0xA5;
/// Bytes before a record's settings.
const HEADER: u32 = 8;
/// Bytes of the check sum after them.
const CRC_LEN: u32 = 4;
const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISCSI);
/// Bytes that are written at once, or one unit of the memory where that is more. A power cut may have written them without
/// a trace: a new record keeps this distance from the last one.
const GAP: u32 = 16;
/// The largest unit of a memory.
const MOST_WRITE_LEN: u32 = 32;
/// No settings are longer: a plan of 32 slots and a watch of 8.
const LONGEST: u32 = 512;

/// The store does not do what it should.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum StoreFault {
    /// It cannot be read, written or erased, or is too small.
    Failed,
    /// What was written is read as something else.
    ReadBack,
}

/// A record that was found.
#[derive(Clone, Copy, Debug)]
struct Record {
    sector: Sector,
    /// Where its settings are, and how long they are.
    offset: u32,
    len: u32,
    number: u32,
}

/// What is in a sector.
#[derive(Clone, Copy, Debug)]
struct Log {
    /// The last valid record.
    last: Option<Record>,
    /// From here on every byte is erased.
    free: u32,
}

/// The settings that count, if there are any.
///
/// # Errors
/// The store cannot be read.
pub fn load<S: Store + Watchdog>(store: &mut S) -> Result<Option<Settings>, StoreFault> {
    let mut out = None;
    load_with(store, |settings| out = Some(settings.clone()))?;
    Ok(out)
}

/// The same, lent where they are: they are large for a stack. Whether anything is stored; what another firmware wrote
/// may be nothing that can be taken.
///
/// # Errors
/// As [`load`].
pub fn load_with<S: Store + Watchdog>(store: &mut S, take: impl FnOnce(&Settings)) -> Result<bool, StoreFault> {
    let Some(record) = newest(store)? else {
        return Ok(false);
    };
    let reader = Reader {
        store,
        sector: record.sector,
        next: record.offset,
        end: record.offset + record.len,
    };
    let mut de = postcard::Deserializer::from_flavor(reader);
    // The sum was right, so it was written whole.
    if let Ok(settings) = &Settings::deserialize(&mut de) {
        take(settings);
    }
    Ok(true)
}

/// Writes settings and reads them back. After an error, or a power cut before this returns, either these count or those
/// before; after [`StoreFault::ReadBack`] those before.
///
/// # Errors
/// The store cannot be written, is too small, or does not keep what is written.
pub fn save<S: Store + Watchdog>(store: &mut S, settings: &Settings) -> Result<(), StoreFault> {
    append(store, Some(settings))
}

/// Makes the board begin with its own settings again, with the same promise.
///
/// # Errors
/// As [`save`].
pub fn forget<S: Store + Watchdog>(store: &mut S) -> Result<(), StoreFault> {
    match newest(store)? {
        Some(_) => append(store, None),
        None => Ok(()),
    }
}

/// Appends a record; one without settings means that there are none.
fn append<S: Store + Watchdog>(store: &mut S, settings: Option<&Settings>) -> Result<(), StoreFault> {
    let size = match settings {
        Some(s) => postcard::serialize_with_flavor(s, postcard::ser_flavors::Size::default())
            .map_err(|_| StoreFault::Failed)?,
        None => 0,
    };
    let len = u32::try_from(size).map_err(|_| StoreFault::Failed)?;
    let unit = store.write_len();
    if !(1..=MOST_WRITE_LEN).contains(&unit) {
        return Err(StoreFault::Failed);
    }
    let total = (HEADER + len + CRC_LEN).next_multiple_of(unit);
    let (a, b) = (scan(store, Sector::A)?, scan(store, Sector::B)?);
    let newest = newer(a.last, b.last);
    let number = newest.map_or(0, |r| r.number.wrapping_add(1));
    let here = newest.map_or(Sector::A, |r| r.sector);
    let (log, other) = match here {
        Sector::A => (a, Sector::B),
        Sector::B => (b, Sector::A),
    };
    if total > store.sector_len() || len > LONGEST {
        return Err(StoreFault::Failed);
    }
    let (sector, offset) = if log.free + total <= store.sector_len() {
        (here, log.free)
    } else {
        store.erase(other).map_err(|_| StoreFault::Failed)?;
        (other, 0)
    };
    for written in [false, true] {
        let writer = Writer {
            store: &mut *store,
            sector,
            next: offset,
            unit,
            chunk: heapless::Vec::new(),
            digest: CRC.digest(),
            written,
        };
        put_record(writer, settings, len, number)?;
    }
    Ok(())
}

/// Writes a record, or compares it with what is there.
fn put_record<S: Store>(
    mut writer: Writer<'_, S>,
    settings: Option<&Settings>,
    len: u32,
    number: u32,
) -> Result<(), StoreFault> {
    let [l0, l1, ..] = len.to_le_bytes();
    let [n0, n1, n2, n3] = number.to_le_bytes();
    for byte in [MARK, FORMAT, l0, l1, n0, n1, n2, n3] {
        writer.put(byte)?;
    }
    let Some(settings) = settings else {
        return writer.finish();
    };
    let written = writer.written;
    postcard::serialize_with_flavor(settings, writer).map_err(|_| {
        if written {
            StoreFault::ReadBack
        } else {
            StoreFault::Failed
        }
    })
}

/// The record that counts; `None` as well where it says that there are no settings.
fn newest<S: Store + Watchdog>(store: &mut S) -> Result<Option<Record>, StoreFault> {
    let record = newer(scan(store, Sector::A)?.last, scan(store, Sector::B)?.last);
    Ok(record.filter(|r| r.len > 0))
}

fn newer(a: Option<Record>, b: Option<Record>) -> Option<Record> {
    match (a, b) {
        // Numbers may wrap: the newer one is less than half the circle ahead.
        (Some(a), Some(b)) if a.number.wrapping_sub(b.number) < u32::MAX / 2 => Some(a),
        (Some(_), Some(b)) => Some(b),
        (a, b) => a.or(b),
    }
}

/// Reads through a sector's log.
fn scan<S: Store + Watchdog>(store: &mut S, sector: Sector) -> Result<Log, StoreFault> {
    let end = store.sector_len();
    let mut log = Log { last: None, free: 0 };
    // Everything behind the last byte that is not erased is free, whatever a cut left before it.
    let mut at = 0;
    let mut chunk = [0; 32];
    while at < end {
        let size = (end - at).min(chunk.len() as u32);
        let part = chunk.get_mut(..size as usize).unwrap_or_default();
        store.feed();
        store.read(sector, at, part).map_err(|_| StoreFault::Failed)?;
        if let Some(last) = part.iter().rposition(|b| *b != 0xFF) {
            let unit = store.write_len().max(1);
            log.free = (at + last as u32 + 1).next_multiple_of(unit) + GAP.max(unit);
        }
        at += size;
    }
    let mut at = 0;
    while at + HEADER + CRC_LEN <= log.free.min(end) {
        match record(store, sector, at)? {
            Some(found) => {
                log.last = Some(found);
                at = found.offset + found.len + CRC_LEN;
            }
            // What a cut left: the next record is somewhere behind it.
            None => at += 1,
        }
    }
    Ok(log)
}

/// The record that begins here, if it is whole.
fn record<S: Store + Watchdog>(store: &mut S, sector: Sector, at: u32) -> Result<Option<Record>, StoreFault> {
    // A hostile memory has what looks like a record at every second byte: its sums take longer than the watchdog waits.
    store.feed();
    let mut header = [0; HEADER as usize];
    store.read(sector, at, &mut header).map_err(|_| StoreFault::Failed)?;
    let [mark, format, l0, l1, n0, n1, n2, n3] = header;
    let len = u32::from(u16::from_le_bytes([l0, l1]));
    let fits = at + HEADER + len + CRC_LEN <= store.sector_len();
    if mark != MARK || format != FORMAT || len > LONGEST || !fits {
        return Ok(None);
    }
    let mut digest = CRC.digest();
    digest.update(&header);
    let (mut next, end) = (at + HEADER, at + HEADER + len);
    let mut chunk = [0; 32];
    while next < end {
        let size = (end - next).min(chunk.len() as u32);
        let part = chunk.get_mut(..size as usize).unwrap_or_default();
        store.read(sector, next, part).map_err(|_| StoreFault::Failed)?;
        digest.update(part);
        next += size;
    }
    let mut sum = [0; CRC_LEN as usize];
    store.read(sector, end, &mut sum).map_err(|_| StoreFault::Failed)?;
    Ok((digest.finalize() == u32::from_le_bytes(sum)).then_some(Record {
        sector,
        offset: at + HEADER,
        len,
        number: u32::from_le_bytes([n0, n1, n2, n3]),
    }))
}

/// Writes a record's bytes, a few at a time, or compares them with those that were written.
struct Writer<'a, S> {
    store: &'a mut S,
    sector: Sector,
    next: u32,
    /// Bytes of a unit of the memory.
    unit: u32,
    chunk: heapless::Vec<u8, { MOST_WRITE_LEN as usize }>,
    digest: crc::Digest<'static, u32>,
    /// Whether the record is there, and is compared.
    written: bool,
}

impl<S: Store> Writer<'_, S> {
    fn put(&mut self, byte: u8) -> Result<(), StoreFault> {
        self.digest.update(&[byte]);
        self.keep(byte)
    }

    fn keep(&mut self, byte: u8) -> Result<(), StoreFault> {
        if self.chunk.len() as u32 >= GAP.max(self.unit) {
            self.flush()?;
        }
        // Cannot fail: it holds the largest unit.
        let _ = self.chunk.push(byte);
        Ok(())
    }

    fn flush(&mut self) -> Result<(), StoreFault> {
        if self.written {
            let mut found = [0; MOST_WRITE_LEN as usize];
            let found = found.get_mut(..self.chunk.len()).unwrap_or_default();
            let read = self.store.read(self.sector, self.next, found);
            if read.is_err() || *found != *self.chunk {
                return Err(StoreFault::ReadBack);
            }
        } else {
            let done = self.store.write(self.sector, self.next, &self.chunk);
            done.map_err(|_| StoreFault::Failed)?;
        }
        self.next += self.chunk.len() as u32;
        self.chunk.clear();
        Ok(())
    }

    /// Writes the sum: from its last byte on the record counts.
    fn finish(mut self) -> Result<(), StoreFault> {
        let sum = self.digest.clone().finalize().to_le_bytes();
        for byte in sum {
            self.keep(byte)?;
        }
        // The rest of the unit stays as erased.
        while !(self.chunk.len() as u32).is_multiple_of(self.unit) && self.chunk.push(0xFF).is_ok() {}
        self.flush()
    }
}

impl<S: Store> Sink for Writer<'_, S> {
    type Output = ();

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.put(byte).map_err(|_| postcard::Error::SerializeBufferFull)
    }

    fn finalize(self) -> postcard::Result<()> {
        self.finish().map_err(|_| postcard::Error::SerializeBufferFull)
    }
}

/// Reads a record's bytes.
struct Reader<'a, S> {
    store: &'a mut S,
    sector: Sector,
    next: u32,
    end: u32,
}

impl<'de, S: Store> Source<'de> for Reader<'de, S> {
    type Remainder = ();
    type Source = ();

    fn pop(&mut self) -> postcard::Result<u8> {
        let mut byte = [0];
        let unexpected = postcard::Error::DeserializeUnexpectedEnd;
        if self.next >= self.end {
            return Err(unexpected);
        }
        self.store
            .read(self.sector, self.next, &mut byte)
            .map_err(|_| unexpected)?;
        self.next += 1;
        let [byte] = byte;
        Ok(byte)
    }

    fn try_take_n(&mut self, _n: usize) -> postcard::Result<&'de [u8]> {
        // Nothing in the settings is a text or bytes.
        Err(postcard::Error::WontImplement)
    }

    fn finalize(self) -> postcard::Result<()> {
        Ok(())
    }
}
