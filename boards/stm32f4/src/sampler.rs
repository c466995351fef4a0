//! Samples in step with the excitation: TIM2 starts a conversion of ADC1 and steps the DAC with one and the same pulse,
//! and DMA writes the codes round a ring. While a block of it is worked on, the next ones are filled.
//!
//! Nothing here needs an interrupt: the DMA stream tells how far the ring is filled.

use crate::ring::Shared;
use crate::source::Source;
use crate::timebase::{self, now};
use cortex_m::interrupt;
use firmware::{Block, ErrorKind, QUARTER_SAMPLES, Rails, SAMPLES_PER_PERIOD, Window};
use stm32f4xx_hal::pac;

/// Clock of TIM2, Hz.
pub const TIMER_HZ: u32 = 84_000_000;
/// 84 MHz / (16 * 1425) = 3684.2 Hz of excitation.
pub const TICKS_PER_SAMPLE: u32 = 1425;
/// Processor cycles from one sample to the next.
pub const CYCLES_PER_SAMPLE: u32 = 2 * TICKS_PER_SAMPLE;

/// Samples in the ring: four periods, 1.1 ms.
pub const RING: usize = 4 * SAMPLES_PER_PERIOD;
static SAMPLES: Shared<u16, RING> = Shared::new(0);

/// Timer ticks after which a conversion is over and in memory: 28 cycles of sampling and 12 of conversion at 21 MHz are
/// 160.
const CONVERTED_TICKS: u32 = 200;

/// Samples by which the stream must still be away from a block when the work on it ends. Nearer than that, the stream
/// may have overwritten some of the block.
const SPARE: u64 = 2;

/// A window that is being captured.
#[derive(Clone, Copy)]
struct Open {
    /// Time of its first sample, of the next one to lend, and of the one after its last.
    start: u64,
    next: u64,
    end: u64,
}

/// What the converter can look at: the inputs of ADC1 that are wired, by their channel numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Input {
    /// Behind the amplifier of gain 13, PA0.
    Amplified = 0,
    /// Behind the difference amplifier of gain 0.6, PA1.
    Divided = 1,
    /// The source itself, PA6.
    Source = 6,
}

/// The sampler; it runs from power-up on.
pub struct Sampler {
    sequence: u32,
    open: Option<Open>,
}

/// Timer, converter and DMA controller.
fn registers() -> (
    &'static pac::tim2::RegisterBlock,
    &'static pac::adc1::RegisterBlock,
    &'static pac::dma2::RegisterBlock,
) {
    // SAFETY: the addresses are those of the registers. TIM2, ADC1 and stream 0 of DMA2 are this module's alone. Of
    // DMA2 it writes no register that others write but one that clears flags; zeros there do nothing.
    unsafe { (&*pac::TIM2::ptr(), &*pac::ADC1::ptr(), &*pac::DMA2::ptr()) }
}

/// Samples of this round that are in memory.
#[inline]
pub fn position() -> usize {
    let (.., dma) = registers();
    let left = dma.st(0).ndtr().read().bits() as usize;
    (2 * RING - left) % RING
}

impl Sampler {
    pub const fn new() -> Self {
        Self {
            sequence: 0,
            open: None,
        }
    }

    /// Starts timer, converter and source together, at phase 0 and at the time of the next whole period.
    pub fn start(&mut self, source: &Source) {
        let (timer, adc, dma) = registers();
        timer.cr1().write(|w| w.cen().disabled());
        timebase::stopped();
        self.open = None;

        adc.cr2().write(|w| w.adon().disabled());
        let stream = dma.st(0);
        stream.cr().write(|w| w.en().disabled());
        while stream.cr().read().en().is_enabled() {}
        dma.lifcr().write(|w| {
            w.cfeif0().clear().cdmeif0().clear().cteif0().clear();
            w.chtif0().clear().ctcif0().clear()
        });
        // SAFETY: from here the stream reads the converter's data register and writes the ring, a static of as many
        // samples as `ndtr` says. The processor only reads the ring, and `poll` finds out what was overwritten
        // meanwhile.
        unsafe {
            stream.par().write(|w| w.pa().bits(adc.dr().as_ptr() as u32));
            stream.m0ar().write(|w| w.m0a().bits(SAMPLES.address()));
        }
        stream.ndtr().write(|w| w.ndt().set(RING as u16));
        stream.cr().write(round_the_ring);
        stream.cr().write(|w| round_the_ring(w).en().enabled());

        // 28 cycles of sampling on every channel; one conversion of 12 bits a trigger.
        adc.sr().write(|w| {
            w.awd().clear().eoc().clear().jeoc().clear();
            w.jstrt().clear().strt().clear().ovr().clear()
        });
        adc.cr1().write(|w| w.res().twelve_bit().scan().disabled());
        adc.smpr2().write(|w| {
            w.smp0().cycles28().smp1().cycles28().smp2().cycles28();
            w.smp3().cycles28().smp4().cycles28().smp5().cycles28();
            w.smp6().cycles28().smp7().cycles28().smp8().cycles28();
            w.smp9().cycles28()
        });
        adc.sqr1().write(|w| w.l().set(0));
        // On the rising edge of TIM2's trigger; DMA without end.
        adc.cr2().write(|w| {
            w.exten().rising_edge().extsel().tim2trgo();
            w.dds().continuous().dma().enabled().adon().enabled()
        });
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

    /// Which of the converter's inputs is sampled from the next sample on.
    pub fn set_input(&mut self, input: Input) {
        let (timer, adc, _) = registers();
        if adc.sqr3().read().bits() == input as u32 {
            return;
        }
        // A write during a conversion would cost that sample, and every later sample would be counted one too early.
        // The write therefore waits until the conversion is over, and does not come just before the next one.
        const QUIET: core::ops::Range<u32> = CONVERTED_TICKS..TICKS_PER_SAMPLE - 60;
        let write = |_: &interrupt::CriticalSection| {
            let quiet = QUIET.contains(&timer.cnt().read().bits());
            if quiet {
                // SAFETY: the channel is one that the converter has, and its pin is analog since `chip::start`.
                adc.sqr3().write(|w| unsafe { w.sq1().bits(input as u8) });
            }
            quiet
        };
        while !interrupt::free(write) {}
    }

    /// Lets a conversion under way end: 2.4 us at most.
    fn wait_until_converted(&self) {
        let (timer, ..) = registers();
        while timer.cnt().read().bits() < CONVERTED_TICKS {}
    }

    /// Opens a window.
    pub fn begin(&mut self, window: Window) {
        self.wait_until_converted();
        let now = now();
        let quarter = QUARTER_SAMPLES as u64;
        // A call at most one sample after the end of a quarter still counts as one at that end.
        let from = (now + quarter - 2) / quarter;
        let settled = from + u64::from(window.settle_quarters) - u64::from(cfg!(feature = "fault-settling"));
        let start = settled.max(now.div_ceil(quarter)) * quarter;
        self.open = Some(Open {
            start,
            next: start,
            end: start + u64::from(window.periods) * SAMPLES_PER_PERIOD as u64,
        });
    }

    /// Lends what there is of the window, in whole periods, or in two pieces where the ring turns over.
    pub fn poll<R>(&mut self, f: impl FnOnce(&Block<'_>) -> R) -> nb::Result<R, ErrorKind> {
        let Some(open) = self.open.filter(|o| o.next < o.end) else {
            return Err(nb::Error::WouldBlock);
        };
        // After a loss no more samples come: do not wait for a whole period.
        if self.lost() {
            self.open = None;
            return Err(nb::Error::Other(ErrorKind::Overrun));
        }
        let filled = now().min(open.end);
        let period = SAMPLES_PER_PERIOD as u64;
        let whole = open.start + filled.saturating_sub(open.start) / period * period;
        if whole <= open.next {
            return Err(nb::Error::WouldBlock);
        }
        crate::multiplexer::work();
        let place = (open.next % RING as u64) as usize;
        let len = (whole - open.next).min((RING - place) as u64);
        // SAFETY: whether the stream wrote to it meanwhile is found out below; then nothing that was made of it is
        // used.
        let samples = unsafe { SAMPLES.lend(place, len as usize) };
        let block = Block {
            samples,
            channels: 1,
            sequence: self.sequence,
            time: open.next,
            rails: Rails::Unknown,
        };
        let result = f(&block);
        let now = now();
        if self.lost() || now + SPARE > open.next + RING as u64 {
            self.open = None;
            return Err(nb::Error::Other(ErrorKind::Overrun));
        }
        self.sequence = self.sequence.wrapping_add(1);
        self.open = Some(Open {
            next: open.next + len,
            ..open
        });
        Ok(result)
    }

    /// Whether the converter had to throw a sample away. It has to be started again then.
    pub fn lost(&self) -> bool {
        let (_, adc, dma) = registers();
        if adc.sr().read().ovr().is_overrun() {
            return true;
        }
        // Transfer and direct mode; the FIFO's error bit means nothing without a FIFO.
        let stream = dma.lisr().read();
        stream.teif0().is_error() || stream.dmeif0().is_error()
    }
}

/// From the converter (channel 0) round the ring for ever, 16 bits at a time and before all else; not enabled.
fn round_the_ring(w: &mut pac::dma2::st::cr::W) -> &mut pac::dma2::st::cr::W {
    w.chsel().set(0).pl().very_high().dir().peripheral_to_memory();
    w.psize().bits16().msize().bits16();
    w.minc().incremented().circ().enabled()
}
