//! Samples in step with the excitation. TIM2 starts three converters and steps the DAC with one and the same pulse, and DMA
//! writes the codes round three rings.
//!
//! ADC1 and ADC3 convert the sixteen amplifiers, eight one after the other each, side by side: channel k on ADC1 at the same
//! instant as channel k + 8 on ADC3. ADC2 converts what one channel sees: the amplifier behind the multiplexers, the
//! difference amplifier, and the source. All three always run; a block takes the columns that its route asks for. A
//! regular sequence cannot be changed while a converter waits for triggers (RM0433 section 25.4.10).
//!
//! Nothing here needs an interrupt. The DMA streams tell how far the rings are filled. The processor's cycle counter, which
//! runs from the same clock, tells how often they went round.

use crate::converter::{self, Converter};
use crate::dma::{self, Stream};
use crate::pac;
use crate::ring::Shared;
use crate::source::Source;
use core::cell::Cell;
use core::sync::atomic::{AtomicBool, Ordering};
use cortex_m::interrupt::{self, Mutex};
use cortex_m::peripheral::DWT;
use firmware::{Block, ErrorKind, MAX_CHANNELS, QUARTER_SAMPLES, Rails, SAMPLES_PER_PERIOD, Window};

/// Clock of TIM2, Hz.
pub const TIMER_HZ: u32 = 200_000_000;
/// 200 MHz / (16 * 3392) = 3685.1 Hz of excitation.
pub const TICKS_PER_SAMPLE: u32 = 3392;
/// From one conversion to the next of the same converter: 16.5 cycles of sampling and 8.5 of conversion at 25 MHz.
pub const SKEW_TICKS: u16 = 200;
/// Processor cycles from one sample to the next.
const CYCLES_PER_SAMPLE: u32 = 2 * TICKS_PER_SAMPLE;

/// Columns of a row that a converter writes: half of the channels, and of the third one.
const HALF_ROW: usize = MAX_CHANNELS / 2;
const SINGLES: usize = 3;
/// Rows in a ring: four periods, 1.1 ms.
const RING: usize = 4 * SAMPLES_PER_PERIOD;

// SAFETY (of the three sections): they are in memory that DMA reaches, and any codes are as good as none until a stream has
// written them.
#[unsafe(link_section = ".dma.first")]
static FIRST: Shared<u16, { RING * HALF_ROW }> = Shared::new(0);
#[unsafe(link_section = ".dma.second")]
static SECOND: Shared<u16, { RING * HALF_ROW }> = Shared::new(0);
#[unsafe(link_section = ".dma.third")]
static THIRD: Shared<u16, { RING * SINGLES }> = Shared::new(0);

/// Timer ticks after which a row is converted and in memory.
const CONVERTED_TICKS: u32 = SKEW_TICKS as u32 * HALF_ROW as u32 + 100;
const _: () = assert!(CONVERTED_TICKS < TICKS_PER_SAMPLE);

/// Rows by which a stream must still be away from a block when it has been copied.
const SPARE: u64 = 2;

/// What a block is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// The sixteen amplifiers.
    All,
    /// The amplifier of gain 13 behind the multiplexers, PF13.
    Amplified,
    /// The difference amplifier of gain 0.6, PF14.
    Divided,
    /// The source itself, PC1.
    Source,
}

/// A window that is being captured.
#[derive(Clone, Copy)]
struct Open {
    /// Time of the next row to lend, and of the one after the last.
    next: u64,
    end: u64,
}

/// Counts rows since power-up.
#[derive(Clone, Copy)]
struct Timebase {
    /// Rows taken and in memory, as of `cycles` on the cycle counter.
    total: u64,
    position: usize,
    cycles: u32,
}

/// There is one, so that all who ask agree.
static TIME: Mutex<Cell<Timebase>> = Mutex::new(Cell::new(Timebase {
    total: 0,
    position: 0,
    cycles: 0,
}));

/// The sampler; it runs from power-up on.
pub struct Sampler {
    sequence: u32,
    open: Option<Open>,
    input: Input,
    /// A period of rows, put together from the rings.
    rows: [u16; MAX_CHANNELS * SAMPLES_PER_PERIOD],
}

fn timer() -> &'static pac::tim2::RegisterBlock {
    // SAFETY: the address is that of the registers, which are this module's alone.
    unsafe { &*pac::TIM2::ptr() }
}

/// Samples taken and in memory since power-up.
///
/// The next call has to come within 10 s, in which the cycle counter goes round once. If the sampling stops, the time goes
/// on: a wait for samples has an end.
pub fn now() -> u64 {
    interrupt::free(|key| {
        let cell = TIME.borrow(key);
        let mut time = cell.get();
        if time.advance() {
            cell.set(time);
        }
        time.total
    })
}

/// Calls [`now`] every few hundredths of a second, so that nobody else has to.
pub fn keep_up() {
    static LAST: AtomicBool = AtomicBool::new(false);
    let bit = DWT::cycle_count() & 1 << 24 != 0;
    if LAST.load(Ordering::Relaxed) != bit {
        LAST.store(bit, Ordering::Relaxed);
        now();
    }
}

/// Whole rows of a ring that its stream has filled in this round.
fn filled(stream: Stream, columns: usize) -> usize {
    let left = usize::from(dma::stream(stream).ndtr().read().ndt().bits());
    (RING * columns).saturating_sub(left) / columns % RING
}

/// Rows of this round that are in memory in full. The three streams are a row apart at most; the last one counts.
fn position() -> usize {
    let second = filled(Stream::Second, HALF_ROW);
    [filled(Stream::First, HALF_ROW), filled(Stream::Third, SINGLES)]
        .into_iter()
        .fold(second, |last, other| {
            let behind = (last + RING - other) % RING;
            if behind < RING / 2 { other } else { last }
        })
}

impl Timebase {
    /// Brings it up to date; false if nothing has changed.
    fn advance(&mut self) -> bool {
        let (position, cycles) = (position(), DWT::cycle_count());
        if position == self.position && cycles.wrapping_sub(self.cycles) < RING as u32 / 2 * CYCLES_PER_SAMPLE {
            return false;
        }
        let further = (RING + position - self.position) % RING;
        // The cycle counter tells how many whole rounds that leaves out; it may be off by a few samples, not by half a
        // ring.
        let about = (cycles.wrapping_sub(self.cycles) / CYCLES_PER_SAMPLE) as usize;
        let rounds = (about + RING / 2).saturating_sub(further) / RING;
        let rows = further + rounds * RING;
        // Parts of a sample are not counted, and so must not be forgotten.
        if rows > 0 {
            self.total += rows as u64;
            self.position = position;
            self.cycles = cycles;
        }
        rows > 0
    }
}

impl Sampler {
    pub const fn new() -> Self {
        Self {
            sequence: 0,
            open: None,
            input: Input::All,
            rows: [0; MAX_CHANNELS * SAMPLES_PER_PERIOD],
        }
    }

    /// Starts timer, converters and source together, at phase 0 and at the time of the next whole period.
    pub fn start(&mut self, source: &Source) {
        let timer = timer();
        timer.cr1().write(|w| w.cen().disabled());
        now();
        interrupt::free(|key| {
            let cell = TIME.borrow(key);
            let time = cell.get();
            cell.set(Timebase {
                total: time.total.next_multiple_of(RING as u64),
                position: 0,
                ..time
            });
        });
        self.open = None;
        for (converter, stream, ring, len) in [
            (Converter::First, Stream::First, FIRST.address(), RING * HALF_ROW),
            (Converter::Second, Stream::Second, SECOND.address(), RING * HALF_ROW),
            (Converter::Third, Stream::Third, THIRD.address(), RING * SINGLES),
        ] {
            converter::stop(converter);
            dma::stop(stream);
            // From here the stream reads the converter's data register and writes the ring, a static of as many samples as
            // `ndtr` says. The processor only reads the ring, and `poll` finds out what was overwritten meanwhile.
            dma::address(stream, converter::data_register(converter), ring);
            dma::stream(stream).ndtr().write(|w| w.ndt().set(len as u16));
            dma::stream(stream).cr().write(|w| {
                w.pl().very_high().dir().peripheral_to_memory();
                w.psize().bits16().msize().bits16();
                w.minc().incremented().circ().enabled().en().enabled()
            });
            converter::wait_for_triggers(converter);
        }
        source.arm();

        // The update event is the trigger output. The first one comes a sample's time from now.
        timer.psc().write(|w| w.psc().set(0));
        let ticks = TICKS_PER_SAMPLE - u32::from(cfg!(feature = "fault-timer"));
        timer.arr().write(|w| w.arr().set(ticks - 1));
        timer.cnt().write(|w| w.cnt().set(0));
        timer.cr2().write(|w| w.mms().update());
        timer.cr1().write(|w| w.cen().enabled());
        // The first row is a sample's time away, and written to memory a moment later.
        interrupt::free(|key| {
            let cell = TIME.borrow(key);
            cell.set(Timebase {
                cycles: DWT::cycle_count(),
                ..cell.get()
            });
        });
    }

    /// What the next blocks are made of.
    pub fn set_input(&mut self, input: Input) {
        self.input = input;
    }

    /// Opens a window.
    ///
    /// # Errors
    /// It wants other channels than the input has.
    pub fn begin(&mut self, window: Window) -> Result<(), ErrorKind> {
        if usize::from(window.channels) != self.columns() {
            return Err(ErrorKind::Other);
        }
        // Lets a row under way end: 9 us at most.
        while timer().cnt().read().bits() < CONVERTED_TICKS {}
        let now = now();
        let quarter = QUARTER_SAMPLES as u64;
        // A call at most one sample after the end of a quarter still counts as one at that end.
        let from = (now + quarter - 2) / quarter;
        let settled = from + u64::from(window.settle_quarters) - u64::from(cfg!(feature = "fault-settling"));
        let start = settled.max(now.div_ceil(quarter)) * quarter;
        self.open = Some(Open {
            next: start,
            end: start + u64::from(window.periods) * SAMPLES_PER_PERIOD as u64,
        });
        Ok(())
    }

    /// Samples in a row of a block.
    fn columns(&self) -> usize {
        if self.input == Input::All { MAX_CHANNELS } else { 1 }
    }

    /// Lends what there is of the window, a period at a time.
    pub fn poll<R>(&mut self, f: impl FnOnce(&Block<'_>) -> R) -> nb::Result<R, ErrorKind> {
        let Some(open) = self.open.filter(|o| o.next < o.end) else {
            return Err(nb::Error::WouldBlock);
        };
        // After a loss no more samples come: do not wait for a whole period.
        if self.lost() {
            self.open = None;
            return Err(nb::Error::Other(ErrorKind::Overrun));
        }
        let period = SAMPLES_PER_PERIOD as u64;
        if now() < open.next + period {
            return Err(nb::Error::WouldBlock);
        }
        crate::multiplexer::work();
        self.copy((open.next % RING as u64) as usize);
        // What was overwritten meanwhile is found out afterwards; then nothing that was copied is used.
        if self.lost() || now() + SPARE > open.next + RING as u64 {
            self.open = None;
            return Err(nb::Error::Other(ErrorKind::Overrun));
        }
        let columns = self.columns();
        let result = f(&Block {
            samples: self.rows.get(..columns * SAMPLES_PER_PERIOD).unwrap_or_default(),
            channels: columns as u8,
            sequence: self.sequence,
            time: open.next,
            rails: Rails::Unknown,
        });
        self.sequence = self.sequence.wrapping_add(1);
        self.open = Some(Open {
            next: open.next + period,
            end: open.end,
        });
        Ok(result)
    }

    /// Puts a period of rows together, from a row of the rings on, which go round on the way.
    fn copy(&mut self, from: usize) {
        let until_end = (RING - from).min(SAMPLES_PER_PERIOD);
        let columns = self.columns();
        let (early, late) = self.rows.split_at_mut(until_end * columns);
        for (place, start, rows) in [(early, from, until_end), (late, 0, SAMPLES_PER_PERIOD - until_end)] {
            match self.input {
                Input::All => {
                    // SAFETY: whether a stream wrote to it meanwhile is found out by `poll`, which then uses nothing of it.
                    let (first, second) = unsafe {
                        (
                            FIRST.lend(start * HALF_ROW, rows * HALF_ROW),
                            SECOND.lend(start * HALF_ROW, rows * HALF_ROW),
                        )
                    };
                    let halves = first
                        .as_chunks::<HALF_ROW>()
                        .0
                        .iter()
                        .zip(second.as_chunks::<HALF_ROW>().0);
                    for ([early, late], (first, second)) in place
                        .as_chunks_mut::<HALF_ROW>()
                        .0
                        .as_chunks_mut()
                        .0
                        .iter_mut()
                        .zip(halves)
                    {
                        (*early, *late) = (*first, *second);
                    }
                }
                Input::Amplified => single(place, start, rows, 0),
                Input::Divided => single(place, start, rows, 1),
                Input::Source => single(place, start, rows, 2),
            }
        }
    }

    /// Whether a converter had to throw a sample away. It has to be started again then.
    pub fn lost(&self) -> bool {
        converter::overrun() || dma::failed()
    }
}

/// Copies a column of the third ring.
fn single(place: &mut [u16], start: usize, rows: usize, column: usize) {
    // SAFETY: whether the stream wrote to it meanwhile is found out by `poll`, which then uses nothing of it.
    let singles = unsafe { THIRD.lend(start * SINGLES, rows * SINGLES) };
    for (place, row) in place.iter_mut().zip(singles.as_chunks::<SINGLES>().0) {
        *place = row.get(column).copied().unwrap_or(0);
    }
}
