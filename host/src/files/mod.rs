//! Files that people write and read: tables of frames, tables of presses, calibrations, stored baselines.

pub(crate) mod baseline_file;
pub(crate) mod calibration_file;
pub(crate) mod malformed;
pub(crate) mod measurements;
pub(crate) mod press_table;
pub(crate) mod replace;
