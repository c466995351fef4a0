//! `skin forward`: what a touched sheet gives, as a table.

use crate::drive::DriveKind;
use crate::files::sheet_line::SheetLine;
use crate::usage::Usage;
use crate::{number, sheet};
use ::forward::{DiscTouch, Drive, Place, Sheet, touched_frame};
use anyhow::{Result, bail};
use clap::Args;
use std::io::Write;
use std::path::PathBuf;
use std::str::FromStr;

/// Arguments of `skin forward`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// The sheet, a TOML file [default: the paper's 195 mm disc with 16 electrodes].
    #[arg(long, value_name = "FILE")]
    sheet: Option<PathBuf>,
    /// A disc in which the resistivity is raised: centre x and y and radius in mm, relative rise (0.2 is +20 %). May be
    /// given several times; where discs overlap the rises add.
    #[arg(long, value_name = "X,Y,RADIUS,RISE", allow_hyphen_values = true)]
    touch: Vec<TouchArgument>,
    /// How the sheet is driven.
    #[arg(long, value_enum, default_value_t = DriveKind::Voltage)]
    drive: DriveKind,
    /// Amplitude of the voltage source, V [default: 2.25].
    #[arg(long, allow_negative_numbers = true, value_name = "V", value_parser = number::positive("an amplitude in volts above 0"))]
    amplitude_v: Option<f64>,
    /// Resistance of each of the two closed switches, ohm [default: 70].
    #[arg(long, allow_negative_numbers = true, value_name = "R", value_parser = number::allowed("a resistance in ohm, 0 or more", |v| v >= 0.0))]
    switch_ohm: Option<f64>,
    /// Contact impedance of every electrode, as mm of sheet [default: the sheet's own, 1].
    #[arg(long, allow_negative_numbers = true, value_name = "L", value_parser = number::positive("a length in mm above 0"))]
    contact_mm: Option<f64>,
    /// Width of every electrode on the rim, mm [default: the sheet's own, 10].
    #[arg(long, allow_negative_numbers = true, value_name = "W", value_parser = number::positive("a length in mm above 0"))]
    electrode_mm: Option<f64>,
    /// Only the table, without the comment lines before it.
    #[arg(long)]
    csv: bool,
}

#[derive(Clone, Copy, Debug)]
struct TouchArgument(DiscTouch);

impl FromStr for TouchArgument {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = text
            .split(',')
            .map(|n| n.trim().parse::<f64>().map_err(|_| format!("'{n}' is not a number")))
            .collect::<Result<_, _>>()?;
        let [x, y, radius_mm, rise] = numbers[..] else {
            return Err(format!(
                "expected four numbers X,Y,RADIUS,RISE, found {}",
                numbers.len()
            ));
        };
        if !numbers.iter().all(|n| n.is_finite()) {
            return Err("expected finite numbers".to_owned());
        }
        if radius_mm <= 0.0 {
            return Err(format!("the radius is {radius_mm} mm; give a positive one"));
        }
        if rise <= -1.0 {
            return Err(format!(
                "the relative rise is {rise}; resistivity stays positive only above -1"
            ));
        }
        Ok(Self(DiscTouch {
            centre_mm: [x, y],
            radius_mm,
            rise,
        }))
    }
}

/// Runs the command.
///
/// # Errors
/// A sheet or a drive that makes no sense.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let (mut sheet, pattern) = sheet::load(arguments.sheet.as_deref())?;
    for electrode in &mut sheet.electrodes {
        if let Some(contact) = arguments.contact_mm {
            electrode.contact_mm = contact;
        }
        if let (
            Some(width),
            Place::Angle { width_mm, .. } | Place::Arc { width_mm, .. } | Place::Point { width_mm, .. },
        ) = (arguments.electrode_mm, &mut electrode.place)
        {
            *width_mm = width;
        }
    }
    let drive = drive(arguments)?;
    let touches: Vec<DiscTouch> = arguments.touch.iter().map(|t| t.0).collect();
    look_for_touches_off(&sheet, &touches)?;
    let frame = touched_frame(&sheet, &pattern, drive, &touches)?;

    let mut out = crate::say::stdout();
    if !arguments.csv {
        let (quantity, how) = match drive {
            Drive::Voltage {
                amplitude_v,
                switch_ohm,
            } => (
                "amplitude, V",
                format!("voltage source {amplitude_v} V behind two switches of {switch_ohm} ohm"),
            ),
            Drive::Current { .. } => (
                "transfer impedance, ohm",
                format!("current, at {} ohm per square", sheet.sheet_resistance_ohm),
            ),
        };
        writeln!(
            out,
            "# simulated: complete electrode model, {} electrodes",
            sheet.electrodes.len()
        )?;
        writeln!(out, "# sheet: {}", SheetLine::of(&sheet)?)?;
        writeln!(out, "# rows: {}", pattern.len())?;
        writeln!(out, "# drive: {how}")?;
        writeln!(
            out,
            "# quantity: {quantity}; the current enters at drive_a, the value is U(sense_b) - U(sense_a)"
        )?;
        for t in &touches {
            let [x, y] = t.centre_mm;
            writeln!(
                out,
                "# touch: x {x} mm, y {y} mm, radius {} mm, relative rise {}",
                t.radius_mm, t.rise
            )?;
        }
    }
    writeln!(out, "drive_a,drive_b,sense_a,sense_b,value")?;
    for (m, value) in pattern.measurements().iter().zip(&frame) {
        let [da, db, sa, sb] = [m.drive.plus, m.drive.minus, m.sense.minus, m.sense.plus].map(|e| e + 1);
        writeln!(out, "{da},{db},{sa},{sb},{value:.9e}")?;
    }
    Ok(())
}

fn drive(arguments: &Arguments) -> Result<Drive> {
    let Drive::Voltage {
        amplitude_v,
        switch_ohm,
    } = Drive::PAPER
    else {
        bail!("the paper's drive is a voltage");
    };
    let given = [
        ("--amplitude-v", arguments.amplitude_v),
        ("--switch-ohm", arguments.switch_ohm),
    ];
    match (arguments.drive, given.iter().find(|(_, v)| v.is_some())) {
        (DriveKind::Current, Some((option, _))) => {
            let text = format!(
                "{option} is for --drive voltage; a current is the same whatever the switches, and its table is in ohm. Leave it out"
            );
            Err(Usage(text).into())
        }
        (DriveKind::Current, None) => Ok(Drive::Current { amplitude_a: 1.0 }),
        (DriveKind::Voltage, _) => Ok(Drive::Voltage {
            amplitude_v: arguments.amplitude_v.unwrap_or(amplitude_v),
            switch_ohm: arguments.switch_ohm.unwrap_or(switch_ohm),
        }),
    }
}

/// Warns of touches that change nothing.
fn look_for_touches_off(sheet: &Sheet, touches: &[DiscTouch]) -> Result<()> {
    let geometry = ::forward::Geometry::new(sheet)?;
    for (k, t) in touches.iter().enumerate() {
        if !geometry.reaches(t.centre_mm, t.radius_mm) {
            let [x, y] = t.centre_mm;
            eprintln!(
                "warning: touch {} at ({x}, {y}) mm with a radius of {} mm is off the sheet and changes nothing; {}",
                k + 1,
                t.radius_mm,
                sheet::extent(&geometry)
            );
        }
    }
    Ok(())
}
