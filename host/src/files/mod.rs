//! Files that people write and read: tables of frames, arrays of other programs, tables of presses, calibrations, stored
//! baselines.

pub(crate) mod arrays;
pub(crate) mod baseline_file;
pub(crate) mod before;
pub(crate) mod calibration_file;
pub(crate) mod cdr;
pub(crate) mod columns;
pub(crate) mod malformed;
pub(crate) mod measurements;
pub(crate) mod names;
pub(crate) mod order;
pub(crate) mod ordered;
pub(crate) mod parquet;
pub(crate) mod positions;
pub(crate) mod press_table;
pub(crate) mod sheet_line;
pub(crate) mod zip;

pub(crate) use view::replace;
