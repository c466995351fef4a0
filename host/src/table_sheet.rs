//! The sheet of a table: described on the command line, held against what the table itself says.

use crate::files::measurements::MeasurementTable;
use crate::files::sheet_line::SheetLine;
use crate::table_pattern::{TablePattern, foreign};
use crate::usage::Usage;
use crate::{number, sheet};
use ::forward::file::MOST_ELECTRODES;
use ::forward::{Electrode, Outline, Pattern, Place, Sheet};
use anyhow::{Context, Result, bail};
use clap::Args;
use inverse::solvers::Method;
use std::path::{Path, PathBuf};

/// The sheet, on the command line.
#[derive(Debug, Args)]
pub(crate) struct Geometry {
    /// The sheet, a TOML file as for `skin forward` [default: the paper's disc of 16 electrodes].
    #[arg(long, value_name = "FILE", conflicts_with_all = ["diameter_mm", "first_electrode_deg", "clockwise", "electrodes", "electrode_mm"])]
    sheet: Option<PathBuf>,
    /// Diameter of the sheet, mm [default: 195].
    #[arg(long, allow_negative_numbers = true, value_name = "MM", value_parser = length(), hide_short_help = true)]
    diameter_mm: Option<f64>,
    /// Angle of electrode 1, degrees counter-clockwise from +x.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_name = "DEGREES", value_parser = number::allowed("an angle in degrees", |_| true), hide_short_help = true)]
    first_electrode_deg: f64,
    /// The electrodes are numbered clockwise.
    #[arg(long, hide_short_help = true)]
    clockwise: bool,
    /// How many electrodes the disc has [default: 16].
    #[arg(long, value_name = "N", hide_short_help = true)]
    electrodes: Option<usize>,
    /// Width of an electrode, mm [default: 10 mm on a 195 mm disc, in proportion].
    #[arg(long, allow_negative_numbers = true, value_name = "MM", value_parser = length(), hide_short_help = true)]
    electrode_mm: Option<f64>,
    /// Side of the picture's cells, mm [default: 5 mm on a 195 mm disc, in proportion; 20 mm for lawson-hanson].
    #[arg(long, allow_negative_numbers = true, value_name = "MM", value_parser = length(), hide_short_help = true)]
    cell_mm: Option<f64>,
}

impl Geometry {
    /// The sheet of a file, or the paper's disc.
    pub(crate) fn of(sheet: Option<&Path>) -> Self {
        Self {
            sheet: sheet.map(Path::to_owned),
            diameter_mm: None,
            first_electrode_deg: 0.0,
            clockwise: false,
            electrodes: None,
            electrode_mm: None,
            cell_mm: None,
        }
    }

    /// The options that were given, by their names.
    pub(crate) fn given(&self) -> Vec<&'static str> {
        [
            (self.sheet.is_some(), "--sheet"),
            (self.diameter_mm.is_some(), "--diameter-mm"),
            (self.first_electrode_deg != 0.0, "--first-electrode-deg"),
            (self.clockwise, "--clockwise"),
            (self.electrodes.is_some(), "--electrodes"),
            (self.electrode_mm.is_some(), "--electrode-mm"),
            (self.cell_mm.is_some(), "--cell-mm"),
        ]
        .iter()
        .filter_map(|(given, name)| given.then_some(*name))
        .collect()
    }
}

/// A sheet in a line, where a table can be of it.
///
/// # Errors
/// The table's electrodes, pattern or header are not those of the sheet.
pub(crate) fn fitting(table: &MeasurementTable, sheet: &Sheet) -> Result<SheetLine> {
    let line = SheetLine::of(sheet)?;
    let describe = "describe the sheet that was measured with --sheet FILE";
    electrodes_fit(table, line.electrodes, "the sheet", describe)?;
    if let Some(difference) = table.sheet.as_ref().and_then(|named| named.differs(&line)) {
        bail!(
            "{}: its header names another sheet than the one used: {difference}; {describe}, or correct the header",
            table.file
        );
    }
    Ok(line)
}

/// Holds a table against the number of electrodes that its header names, where it does.
///
/// # Errors
/// The rows are of another number.
pub(crate) fn fits_its_header(table: &MeasurementTable) -> Result<()> {
    let remedy = "correct the header";
    match &table.sheet {
        Some(named) => electrodes_fit(table, named.electrodes, "the sheet of its header", remedy),
        None => Ok(()),
    }
}

fn electrodes_fit(table: &MeasurementTable, electrodes: usize, whose: &str, remedy: &str) -> Result<()> {
    let file = &table.file;
    if electrodes < table.electrodes {
        bail!(
            "{file}: it names electrodes up to {}, but {whose} has {electrodes}; {remedy}",
            table.electrodes
        );
    }
    // Neighbours across the highest number are neighbours on the sheet that was measured, and not on a larger one.
    let own = TablePattern::of_rows(table.electrodes, &table.measurements);
    if own.known && !TablePattern::of_rows(electrodes, &table.measurements).known {
        bail!(
            "{file}: its rows are a pattern of {} electrodes ({}), but {whose} has {electrodes}; {remedy}",
            table.electrodes,
            own.name
        );
    }
    Ok(())
}

fn length() -> impl Fn(&str) -> Result<f64, String> + Clone {
    number::positive("a length in mm above 0")
}

/// The sheet that a table is reconstructed on.
pub(crate) struct Chosen {
    /// The sheet.
    pub sheet: Sheet,
    /// In a line.
    pub line: SheetLine,
    /// The table's rows.
    pub pattern: Pattern,
    /// What they are, and what is missing.
    pub table_pattern: TablePattern,
    /// Side of the picture's cells, mm.
    pub cell_mm: f64,
    /// Whether nothing said which sheet it is: the paper's disc was assumed.
    pub assumed: bool,
}

/// Diameter that the defaults for lengths are given for, mm.
const PAPER_MM: f64 = 195.0;
/// Electrodes of the paper's sheet.
const PAPER_ELECTRODES: usize = 16;

impl Geometry {
    /// The sheet's file, where one is given.
    pub(crate) fn file(&self) -> Option<&Path> {
        self.sheet.as_deref()
    }

    /// The sheet for a table.
    ///
    /// # Errors
    /// A table whose electrodes, pattern or header are not those of the sheet.
    pub(crate) fn choose(&self, table: &MeasurementTable, method: Method) -> Result<Chosen> {
        self.choose_with(table, method, None)
    }

    /// The same where the table itself knows its sheet, unless the command line says another.
    ///
    /// # Errors
    /// As [`Geometry::choose`].
    pub(crate) fn choose_with(&self, table: &MeasurementTable, method: Method, known: Option<Sheet>) -> Result<Chosen> {
        let file = &table.file;
        let known = known.filter(|_| !self.says_sheet());
        if known.is_some() && (self.clockwise || self.first_electrode_deg != 0.0) {
            let why = "its sheet is known, with the places of its electrodes: leave out --clockwise and --first-electrode-deg, or say the whole \
                       sheet with --sheet FILE or --diameter-mm";
            return Err(Usage(format!("{file}: {why}")).into());
        }
        let is_disc = self.sheet.is_none() && known.is_none();
        let assumed = !self.says_sheet() && known.is_none() && table.sheet.is_none();
        let (sheet, wanted) = match (&self.sheet, known) {
            (None, Some(known)) => (known, None),
            (Some(path), _) => {
                let (sheet, pattern) = sheet::load(Some(path))?;
                let stated = sheet::states_pattern(path)?;
                (sheet, stated.then_some(pattern))
            }
            (None, None) => (self.disc(table)?, None),
        };
        let electrodes = sheet.electrodes.len();
        let line = fitting(table, &sheet)?;
        let table_pattern = match &wanted {
            Some(wanted) => {
                if let Some((row, m)) = foreign(wanted, &table.measurements) {
                    bail!(
                        "{file}: row {row} (drive {}-{}, sense {}-{}) is not in the pattern of the sheet's file; correct [pattern] there, \
                         or leave it out to take the table's own",
                        m.drive.plus + 1,
                        m.drive.minus + 1,
                        m.sense.minus + 1,
                        m.sense.plus + 1
                    );
                }
                TablePattern::against("the sheet file's pattern", wanted, &table.measurements)
            }
            None if table.rows == Some(table.measurements.len()) => {
                TablePattern::whole(electrodes, &table.measurements)
            }
            None => TablePattern::of_rows(electrodes, &table.measurements),
        };
        let cell_mm = match (self.cell_mm, is_disc) {
            (Some(given), _) => given,
            (None, true) => method.cell_mm() * self.diameter_mm() / PAPER_MM,
            (None, false) => method.cell_mm_on(&sheet)?,
        };
        let pattern = Pattern::from_list(electrodes, table.measurements.clone()).with_context(|| file.clone())?;
        Ok(Chosen {
            sheet,
            line,
            pattern,
            table_pattern,
            cell_mm,
            assumed,
        })
    }

    fn says_sheet(&self) -> bool {
        self.sheet.is_some() || self.diameter_mm.is_some() || self.electrodes.is_some() || self.electrode_mm.is_some()
    }

    fn diameter_mm(&self) -> f64 {
        self.diameter_mm.unwrap_or(PAPER_MM)
    }

    /// The disc of the options. A number of electrodes other than the paper's is never assumed: how wide their disc is, and
    /// whether it is one, nobody can know.
    fn disc(&self, table: &MeasurementTable) -> Result<Sheet> {
        let named = table.electrodes;
        let electrodes = self.electrodes.unwrap_or(named);
        if electrodes < named || electrodes > MOST_ELECTRODES {
            bail!(
                "--electrodes {electrodes}: the table names electrodes up to {named}; give that many or more, {MOST_ELECTRODES} at most"
            );
        }
        let described = self.electrodes.is_some() && self.diameter_mm.is_some();
        if electrodes != PAPER_ELECTRODES && !described {
            bail!(
                "{}: it is of {electrodes} electrodes, and the default sheet is the paper's disc of {PAPER_ELECTRODES}; describe the sheet that was \
                 measured with --sheet FILE, or a disc with --electrodes {electrodes} --diameter-mm MM",
                table.file
            );
        }
        let scale = self.diameter_mm() / PAPER_MM;
        let turn = if self.clockwise { -360.0 } else { 360.0 };
        // In proportion to the disc, and to the room that an electrode has on it.
        let room = PAPER_ELECTRODES as f64 / electrodes.max(PAPER_ELECTRODES) as f64;
        let width_mm = self.electrode_mm.unwrap_or(10.0 * scale * room);
        Ok(Sheet {
            sheet_resistance_ohm: 1000.0,
            outline: Outline::Disc {
                diameter_mm: self.diameter_mm(),
                centre_mm: [0.0, 0.0],
            },
            holes: Vec::new(),
            electrodes: (0..electrodes)
                .map(|l| Electrode {
                    place: Place::Angle {
                        angle_deg: self.first_electrode_deg + turn * l as f64 / electrodes as f64,
                        width_mm,
                    },
                    contact_mm: scale,
                })
                .collect(),
        })
    }
}
