//! The files that people give to the program.

use crate::files::arrays::{self, Kind};
use crate::files::measurements::MeasurementTable;
use crate::files::{before, calibration_file, ordered, press_table};
use forward::Geometry;
use forward::file::{parse_sheet, sheet_text};
use forward::order::ValueOrder;
use hil_sim::SceneFile;
use link::flash::Image;

/// Tables of frames, of presses, and of what came before; arrays of numpy and MATLAB.
pub fn tables(data: &[u8]) {
    if let Ok(table) = MeasurementTable::parse("t", data, |_, _| ()) {
        assert!(!table.measurements.is_empty() && !table.columns.is_empty());
        for column in &table.columns {
            assert_eq!(column.values.len(), table.measurements.len());
            assert!(column.values.iter().all(|v| !v.is_infinite()));
        }
    }
    if let Ok((kind, found)) = arrays::parse("t", data) {
        for array in &found {
            assert_eq!(array.values.len(), array.rows * array.columns);
        }
        for order in ValueOrder::ALL {
            let _ = ordered::table(order, "t", kind, &found, &[]);
        }
    }
    if Kind::of(data) == Kind::Text
        && let Ok(text) = std::str::from_utf8(data)
    {
        let _ = before::parse("t", text);
        if let Ok(samples) = press_table::parse("t", text, Some(25.0)) {
            assert!(samples.iter().all(|s| s.time_s.is_finite() && s.total_mm2.is_finite()));
            // The fit is as long as the table; the reader is what is looked at here.
            if samples.len() < 64
                && let Ok(fit) = inverse::force::calibration::fit(&samples, true)
            {
                assert!(fit.calibration.solid.check().is_ok());
            }
        }
    }
}

/// Sheets, scenes and calibrations.
pub fn toml_files(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Ok((sheet, _)) = parse_sheet(text)
        && let Ok(geometry) = Geometry::new(&sheet)
    {
        let (low, high) = geometry.bounding_box();
        assert!(low.iter().chain(&high).all(|v| v.is_finite()));
        let written = sheet_text(&sheet).expect("every sheet can be written");
        assert_eq!(parse_sheet(&written).expect("what was written").0, sheet);
    }
    if let Ok(scene) = SceneFile::parse(text, None) {
        assert!(scene.duration_s.is_finite());
    }
    if let Ok(calibration) = calibration_file::parse("t", text) {
        let written = calibration_file::text(&calibration, None).expect("every calibration can be written");
        assert_eq!(
            calibration_file::parse("t", &written).expect("what was written"),
            calibration
        );
    }
}

/// Programs for a board (ELF).
pub fn programs(data: &[u8]) {
    if let Ok(image) = Image::read(data) {
        assert!(!image.is_empty());
    }
}
