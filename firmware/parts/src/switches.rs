//! Four multiplexers and an amplifier as a router.

use crate::amplifier::Amplifier;
use crate::multiplexer::Multiplexer;
use embedded_hal::delay::DelayNs;
use firmware::{ErrorKind, ErrorType, Route, Router, Sense};

/// Routes by one multiplexer for each end of the drive and of the sense pair, input n being electrode n.
///
/// Every change is: all four open, the dead time, addresses and gain, the dead time, closed. So address lines may change
/// one after the other, and no third electrode is connected on the way.
#[derive(Debug)]
pub struct Switches<DP, DM, SP, SM, A, T> {
    /// Where the excitation enters the sheet.
    pub drive_plus: DP,
    /// Where it leaves it.
    pub drive_minus: DM,
    /// The positive end of the sense pair.
    pub sense_plus: SP,
    /// The negative one.
    pub sense_minus: SM,
    /// What is behind the sense pair.
    pub amplifier: A,
    /// Waits.
    pub delay: T,
    /// How long a switch takes to let go or to connect at most, nanoseconds: 60 for a 74HC4051 at 4.5 V.
    pub dead_ns: u32,
}

impl<DP, DM, SP, SM, A, T> ErrorType for Switches<DP, DM, SP, SM, A, T> {
    type Error = ErrorKind;
}

fn failed<E>(_: E) -> ErrorKind {
    ErrorKind::Route
}

impl<DP, DM, SP, SM, A, T> Switches<DP, DM, SP, SM, A, T>
where
    DP: Multiplexer,
    DM: Multiplexer,
    SP: Multiplexer,
    SM: Multiplexer,
    A: Amplifier,
    T: DelayNs,
{
    /// Connects nothing: for [`firmware::Excitation::switch_off`].
    ///
    /// # Errors
    /// One of the four could not be opened; all others were.
    pub fn release(&mut self) -> Result<(), ErrorKind> {
        let opened = [
            self.drive_plus.open().map_err(failed),
            self.drive_minus.open().map_err(failed),
            self.sense_plus.open().map_err(failed),
            self.sense_minus.open().map_err(failed),
        ];
        opened.into_iter().collect()
    }

    fn reaches(&self, route: &Route) -> bool {
        let drive = route.drive.plus < self.drive_plus.inputs() && route.drive.minus < self.drive_minus.inputs();
        drive
            && match route.sense {
                Sense::One(pair) => pair.plus < self.sense_plus.inputs() && pair.minus < self.sense_minus.inputs(),
                Sense::Source => true,
                Sense::All { .. } => false,
            }
    }
}

impl<DP, DM, SP, SM, A, T> Router for Switches<DP, DM, SP, SM, A, T>
where
    DP: Multiplexer,
    DM: Multiplexer,
    SP: Multiplexer,
    SM: Multiplexer,
    A: Amplifier,
    T: DelayNs,
{
    fn select(&mut self, route: &Route) -> Result<(), ErrorKind> {
        if !self.reaches(route) {
            return Err(ErrorKind::Route);
        }
        self.release()?;
        self.delay.delay_ns(self.dead_ns);
        self.drive_plus.address(route.drive.plus).map_err(failed)?;
        self.drive_minus.address(route.drive.minus).map_err(failed)?;
        let amplified = match route.sense {
            Sense::One(pair) => {
                self.sense_plus.address(pair.plus).map_err(failed)?;
                self.sense_minus.address(pair.minus).map_err(failed)?;
                self.amplifier.set_gain(route.gain)
            }
            _ => self.amplifier.look_at_source(),
        };
        if !amplified.map_err(failed)? {
            return Err(ErrorKind::Route);
        }
        self.delay.delay_ns(self.dead_ns);
        self.drive_plus.close().map_err(failed)?;
        self.drive_minus.close().map_err(failed)?;
        if matches!(route.sense, Sense::One(_)) {
            self.sense_plus.close().map_err(failed)?;
            self.sense_minus.close().map_err(failed)?;
        }
        Ok(())
    }
}
