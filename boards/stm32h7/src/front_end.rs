//! Multiplexers, source and sampler as `firmware`'s front end.

use crate::lines;
use crate::multiplexer;
use crate::sampler::{Input, Sampler};
use crate::source::Source;
use firmware::{Block, Capture, ErrorKind, ErrorType, Excitation, Route, Router, Sense, Window};

/// What one channel looks at for each gain of `BoardInfo`.
const GAIN_INPUTS: [Input; 2] = [Input::Amplified, Input::Divided];

/// The board's front end.
pub struct FrontEnd {
    source: Source,
    sampler: Sampler,
}

impl FrontEnd {
    /// Starts the sampling.
    pub fn start() -> Self {
        let (source, mut sampler) = (Source::new(), Sampler::new());
        sampler.start(&source);
        Self { source, sampler }
    }
}

impl ErrorType for FrontEnd {
    type Error = ErrorKind;
}

impl Router for FrontEnd {
    fn select(&mut self, route: &Route) -> Result<(), ErrorKind> {
        let input = match route.sense {
            Sense::Source => Input::Source,
            // The sixteen amplifiers have gain 0.
            Sense::All { .. } if route.gain == 0 => Input::All,
            Sense::All { .. } => return Err(ErrorKind::Route),
            Sense::One(_) => *GAIN_INPUTS.get(usize::from(route.gain)).ok_or(ErrorKind::Route)?,
        };
        self.sampler.set_input(input);
        multiplexer::select(route)
    }

    fn senses_all(&self, step: u8, gain: u8) -> bool {
        lines::senses_all(step) && gain == 0
    }
}

impl Excitation for FrontEnd {
    fn switch_on(&mut self) -> Result<(), ErrorKind> {
        self.source.set(true);
        Ok(())
    }

    fn set_amplitude(&mut self, permille: u16) -> Result<(), ErrorKind> {
        self.source.set_amplitude(permille)
    }

    fn switch_off(&mut self) -> Result<(), ErrorKind> {
        multiplexer::release();
        self.source.set(false);
        Ok(())
    }
}

impl Capture for FrontEnd {
    fn begin(&mut self, window: Window) -> Result<(), ErrorKind> {
        // The time first: the window has to begin within a sample of the last one's end.
        self.sampler.begin(window)?;
        if self.sampler.lost() || self.source.underrun() {
            self.sampler.start(&self.source);
            self.sampler.begin(window)?;
        }
        Ok(())
    }

    fn poll_block<R>(&mut self, f: impl FnOnce(&Block<'_>) -> R) -> nb::Result<R, ErrorKind> {
        self.sampler.poll(f)
    }
}
