//! Files that people write and read: tables of frames, tables of presses, calibrations.

pub(crate) mod calibration_file;
pub(crate) mod malformed;
pub(crate) mod measurements;
pub(crate) mod press_table;
