//! Samples in step with the excitation. TIM2 starts three converters and steps the DAC with one and the same pulse, and DMA
//! writes the codes round three rings.
//!
//! ADC1 and ADC3 convert the sixteen amplifiers, eight one after the other each, side by side: channel k on ADC1 at the same
//! instant as channel k + 8 on ADC3. ADC2 converts what one channel sees: the amplifier behind the multiplexers, the
//! difference amplifier, and the source. All three always run; a block takes the columns that its route asks for. A
//! regular sequence cannot be changed while a converter waits for triggers (RM0433 section 25.4.10).
//!
//! Nothing here needs an interrupt: the DMA streams tell how far the rings are filled.

use crate::converter::{self, Converter};
use crate::dma::{self, Stream};
use crate::pac;
use crate::ring::Shared;
use crate::source::Source;
use crate::timebase::{self, now};
use firmware::{Block, ErrorKind, MAX_CHANNELS, QUARTER_SAMPLES, Rails, SAMPLES_PER_PERIOD, Window};

/// Clock of TIM2, Hz.
pub const TIMER_HZ: u32 = 200_000_000;
/// 200 MHz / (16 * 3392) = 3685.1 Hz of excitation.
pub const TICKS_PER_SAMPLE: u32 = 3392;
/// From one conversion to the next of the same converter: 16.5 cycles of sampling and 8.5 of conversion at 25 MHz.
pub const SKEW_TICKS: u16 = 200;
/// Processor cycles from one sample to the next.
pub const CYCLES_PER_SAMPLE: u32 = 2 * TICKS_PER_SAMPLE;

/// Columns of a row that a converter writes: half of the channels, and of the third one.
const HALF_ROW: usize = MAX_CHANNELS / 2;
const SINGLES: usize = 3;
/// Rows in a ring: four periods, 1.1 ms.
pub const RING: usize = 4 * SAMPLES_PER_PERIOD;

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

/// Rows of the first block of each period. The second has the rest: the less is left to do when a window ends, the sooner the
/// next route is set.
const EARLY_ROWS: u64 = 3 * QUARTER_SAMPLES as u64;

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

/// Whole rows of a ring that its stream has filled in this round.
fn filled(stream: Stream, columns: usize) -> usize {
    let left = usize::from(dma::stream(stream).ndtr().read().ndt().bits());
    (RING * columns).saturating_sub(left) / columns % RING
}

/// Rows of this round that are in memory in full. The three streams are a row apart at most; the last one counts.
pub fn position() -> usize {
    let second = filled(Stream::Second, HALF_ROW);
    [filled(Stream::First, HALF_ROW), filled(Stream::Third, SINGLES)]
        .into_iter()
        .fold(second, |last, other| {
            let behind = (last + RING - other) % RING;
            if behind < RING / 2 { other } else { last }
        })
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
        timebase::stopped();
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
        timebase::started();
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
        // A route that was set before the first row after a quarter was in memory counts as one at its end. A later one has less
        // time to settle than others, and begins with the next quarter.
        let quarter = QUARTER_SAMPLES as u64;
        let from = now().div_ceil(quarter);
        let settled = from + u64::from(window.settle_quarters) - u64::from(cfg!(feature = "fault-settling"));
        let start = settled.max(from) * quarter;
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

    /// Lends what there is of the window, a period in two blocks.
    pub fn poll<R>(&mut self, f: impl FnOnce(&Block<'_>) -> R) -> nb::Result<R, ErrorKind> {
        let Some(open) = self.open.filter(|o| o.next < o.end) else {
            return Err(nb::Error::WouldBlock);
        };
        let period = SAMPLES_PER_PERIOD as u64;
        let rows = if (open.end - open.next).is_multiple_of(period) {
            EARLY_ROWS
        } else {
            period - EARLY_ROWS
        };
        if now() < open.next + rows {
            // After a loss no more samples come: do not wait for a whole block. Where they are all there it is looked at below,
            // since the next drive has to be switched within a sample.
            if self.lost() {
                self.open = None;
                return Err(nb::Error::Other(ErrorKind::Overrun));
            }
            return Err(nb::Error::WouldBlock);
        }
        crate::multiplexer::work();
        self.copy((open.next % RING as u64) as usize, rows as usize);
        // What was overwritten meanwhile is found out afterwards; then nothing that was copied is used.
        if self.lost() || now() + SPARE > open.next + RING as u64 {
            self.open = None;
            return Err(nb::Error::Other(ErrorKind::Overrun));
        }
        let columns = self.columns();
        let result = f(&Block {
            samples: self.rows.get(..columns * rows as usize).unwrap_or_default(),
            channels: columns as u8,
            sequence: self.sequence,
            time: open.next,
            rails: Rails::Unknown,
        });
        self.sequence = self.sequence.wrapping_add(1);
        self.open = Some(Open {
            next: open.next + rows,
            end: open.end,
        });
        Ok(result)
    }

    /// Puts so many rows together, from a row of the rings on, which go round on the way.
    fn copy(&mut self, from: usize, rows: usize) {
        let until_end = (RING - from).min(rows);
        let columns = self.columns();
        let (early, late) = self.rows.split_at_mut(until_end * columns);
        for (place, start, rows) in [(early, from, until_end), (late, 0, rows - until_end)] {
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
