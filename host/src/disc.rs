//! The disc that a table was measured on, on the command line.

use crate::drive::DriveKind;
use crate::files::measurements::MeasurementTable;
use crate::number;
use ::forward::file::MOST_ELECTRODES;
use ::forward::{Drive, Electrode, Outline, Pattern, Place, Sheet};
use anyhow::{Context, Result, bail};
use clap::Args;

/// What the sheet was, and how it was driven.
#[derive(Debug, Args)]
pub(crate) struct Disc {
    /// How the sheet was driven.
    #[arg(long, value_enum, default_value_t = DriveKind::Voltage)]
    drive: DriveKind,
    /// Diameter of the sheet, mm.
    #[arg(long, default_value_t = 195.0, allow_negative_numbers = true, value_name = "MM", value_parser = length())]
    diameter_mm: f64,
    /// Angle of electrode 1, degrees counter-clockwise from +x.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_name = "DEGREES", value_parser = number::allowed("an angle in degrees", |_| true))]
    first_electrode_deg: f64,
    /// The electrodes are numbered clockwise.
    #[arg(long)]
    clockwise: bool,
    /// How many electrodes the sheet has [default: the highest number in the table].
    #[arg(long, value_name = "N")]
    electrodes: Option<usize>,
    /// Width of an electrode, mm [default: 10 mm on a 195 mm disc, in proportion].
    #[arg(long, allow_negative_numbers = true, value_name = "MM", value_parser = length())]
    electrode_mm: Option<f64>,
}

/// A parser for lengths.
pub(crate) fn length() -> impl Fn(&str) -> Result<f64, String> + Clone {
    number::positive("a length in mm above 0")
}

/// Diameter that the defaults for lengths are given for, mm.
const PAPER_MM: f64 = 195.0;

impl Disc {
    /// The drive.
    pub(crate) fn drive(&self) -> Drive {
        self.drive.drive()
    }

    /// A length for the paper's disc (mm) in proportion.
    pub(crate) fn scaled(&self, mm: f64) -> f64 {
        mm * self.diameter_mm / PAPER_MM
    }

    /// The measurements of a table on this disc.
    ///
    /// # Errors
    /// Fewer electrodes than the table names, or too many.
    pub(crate) fn pattern(&self, table: &MeasurementTable) -> Result<Pattern> {
        let electrodes = self.electrodes.unwrap_or(table.electrodes);
        if electrodes < table.electrodes || electrodes > MOST_ELECTRODES {
            bail!(
                "--electrodes {electrodes}: the table names electrodes up to {}; give that many or more, {MOST_ELECTRODES} at most",
                table.electrodes
            );
        }
        Pattern::from_list(electrodes, table.measurements.clone()).with_context(|| table.file.clone())
    }

    /// The disc with so many electrodes.
    pub(crate) fn sheet(&self, electrodes: usize) -> Sheet {
        let turn = if self.clockwise { -360.0 } else { 360.0 };
        let width_mm = self.electrode_mm.unwrap_or_else(|| self.scaled(10.0));
        Sheet {
            sheet_resistance_ohm: 1000.0,
            outline: Outline::Disc {
                diameter_mm: self.diameter_mm,
                centre_mm: [0.0, 0.0],
            },
            holes: Vec::new(),
            electrodes: (0..electrodes)
                .map(|l| Electrode {
                    place: Place::Angle {
                        angle_deg: self.first_electrode_deg + turn * l as f64 / electrodes as f64,
                        width_mm,
                    },
                    contact_mm: self.scaled(1.0),
                })
                .collect(),
        }
    }
}
