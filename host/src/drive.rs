//! How the sheet is driven, on the command line.

use ::forward::Drive;
use clap::ValueEnum;

/// How the frames were driven.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum DriveKind {
    /// A voltage source behind switches, as on the board.
    Voltage,
    /// A constant current.
    Current,
}

impl DriveKind {
    /// Its name on the command line.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Voltage => "voltage",
            Self::Current => "current",
        }
    }

    /// The drive with its usual amplitude: only ratios of voltages matter.
    pub(crate) fn drive(self) -> Drive {
        match self {
            Self::Voltage => Drive::PAPER,
            Self::Current => Drive::Current { amplitude_a: 1e-3 },
        }
    }
}
