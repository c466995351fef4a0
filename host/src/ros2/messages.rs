//! The messages of ROS 2 as they are sent and exported. Those of `skin_msgs` are defined in contrib/ros2/skin_msgs/msg; the others are
//! ROS 2's own. Lengths are metres there (REP-103).

use crate::files::cdr::Cdr;
use crate::skin_file::Place;
use forward::CellGrid;
use inverse::touches::touch::Touch;

const M_PER_MM: f64 = 1e-3;
const M2_PER_MM2: f64 = 1e-6;

/// When, ns since 1970, and in which frame.
#[derive(Clone, Copy)]
pub(crate) struct Header<'a> {
    pub(crate) unix_ns: u64,
    pub(crate) frame: &'a str,
}

impl Header<'_> {
    fn begin(self) -> Cdr {
        let mut message = Cdr::new();
        message.header(self.unix_ns, self.frame);
        message
    }
}

/// A time in s since 1970 as ROS 2 counts it.
pub(crate) fn unix_ns(unix_s: f64) -> u64 {
    (unix_s * 1e9) as u64
}

/// A skin's name as it may stand in a topic and a frame of ROS 2: letters, digits and `_`, and no digit first.
pub(crate) fn name(of_skin: &str) -> String {
    let name = of_skin.replace(|c: char| !c.is_ascii_alphanumeric(), "_");
    if name.starts_with(|c: char| c.is_ascii_digit()) {
        return format!("skin_{name}");
    }
    name
}

/// The frame of a skin's sheet.
pub(crate) fn sheet_frame(name: &str) -> String {
    format!("{name}_sheet")
}

/// `skin_msgs/Frame`.
pub(crate) fn frame(header: Header<'_>, sequence: u32, time_s: f64, values_v: &[f64]) -> Cdr {
    let mut message = header.begin();
    message.u32(sequence).f64(time_s).f64s(values_v);
    message
}

/// `skin_msgs/Touches`.
pub(crate) fn touches(header: Header<'_>, sequence: u32, time_s: f64, touches: &[Touch], doubt: &str) -> Cdr {
    let mut message = header.begin();
    message.u32(sequence).f64(time_s).u32(touches.len() as u32);
    for touch in touches {
        let m2 = |value: Option<f64>| value.unwrap_or(f64::NAN) * M2_PER_MM2;
        message
            // Numbers begin at 1.
            .u32(touch.id.unwrap_or(0))
            .array(&[touch.x_mm * M_PER_MM, touch.y_mm * M_PER_MM, 0.0])
            .array(&covariance_m2(touch))
            .f64(touch.rise)
            .array(&[m2(Some(touch.area_mm2)), m2(touch.area_sd_mm2)])
            .array(&[m2(Some(touch.total_mm2)), m2(touch.total_sd_mm2)])
            .f64(touch.force_n.unwrap_or(f64::NAN))
            .bool(touch.uncalibrated);
    }
    message.text(doubt);
    message
}

/// Row by row; the first is -1 where it is not known, as in messages of ROS 2.
fn covariance_m2(touch: &Touch) -> [f64; 9] {
    let mut out = [0.0; 9];
    match (touch.x_sd_mm, touch.y_sd_mm) {
        (Some(x), Some(y)) => [out[0], out[4]] = [x, y].map(|sd| (sd * M_PER_MM).powi(2)),
        _ => out[0] = -1.0,
    }
    out
}

/// `sensor_msgs/CompressedImage`.
pub(crate) fn picture(header: Header<'_>, png: &[u8]) -> Cdr {
    let mut message = header.begin();
    message.text("png").bytes(png);
    message
}

/// `sensor_msgs/Image` of the rise of every cell, 32FC1, its first row at the top; not a number beside the sheet.
pub(crate) fn image(header: Header<'_>, grid: &CellGrid, rise: &[f32]) -> Cdr {
    let (columns, rows) = grid.shape();
    let mut pixels = vec![f32::NAN; columns * rows];
    for ([column, row], rise) in grid.cells().iter().zip(rise) {
        let (column, from_top) = (*column as usize, rows - 1 - *row as usize);
        pixels[from_top * columns + column] = *rise;
    }
    let data: Vec<u8> = pixels.iter().flat_map(|pixel| pixel.to_le_bytes()).collect();
    let mut message = header.begin();
    message
        .u32(rows as u32)
        .u32(columns as u32)
        .text("32FC1")
        .u8(0)
        .u32(4 * columns as u32)
        .bytes(&data);
    message
}

/// Where a sheet is; without a place it lies in its own frame.
#[derive(Clone, Debug)]
pub(crate) struct Pose(Option<Place>);

impl Pose {
    pub(crate) fn of(place: Option<&Place>) -> Self {
        Self(place.cloned())
    }

    /// A point of the sheet, m.
    fn point(&self, sheet_mm: [f64; 2]) -> [f64; 3] {
        let [x, y] = sheet_mm;
        let mm = self.0.as_ref().map_or([x, y, 0.0], |place| place.point_mm(sheet_mm));
        mm.map(|mm| mm * M_PER_MM)
    }

    fn normal(&self) -> [f64; 3] {
        self.0.as_ref().map_or([0.0, 0.0, 1.0], Place::normal)
    }

    /// The sheet's turn, as x, y, z, w.
    fn turn(&self) -> [f64; 4] {
        self.0
            .as_ref()
            .map_or([0.0, 0.0, 0.0, 1.0], |place| place.pose().orientation)
    }
}

/// Numbers of a point, all float32, and one uint32.
const POINT: [&str; 9] = ["x", "y", "z", "normal_x", "normal_y", "normal_z", "force", "rise", "id"];

/// `sensor_msgs/PointCloud2` of the touches, in the frame that the pose leads to: place, normal out of the sheet, force, rise, id.
pub(crate) fn points(header: Header<'_>, pose: &Pose, touches: &[Touch]) -> Cdr {
    let [nx, ny, nz] = pose.normal();
    let mut data = Vec::with_capacity(4 * POINT.len() * touches.len());
    for touch in touches {
        let [x, y, z] = pose.point([touch.x_mm, touch.y_mm]);
        let force = touch.force_n.unwrap_or(f64::NAN);
        let numbers = [x, y, z, nx, ny, nz, force, touch.rise];
        data.extend(numbers.iter().flat_map(|number| (*number as f32).to_le_bytes()));
        data.extend(touch.id.unwrap_or(0).to_le_bytes());
    }
    let (float32, uint32) = (7, 6);
    let mut message = header.begin();
    message.u32(1).u32(touches.len() as u32).u32(POINT.len() as u32);
    for (k, name) in POINT.into_iter().enumerate() {
        let kind = if name == "id" { uint32 } else { float32 };
        message.text(name).u32(4 * k as u32).u8(kind).u32(1);
    }
    // A force that nothing tells makes no point invalid.
    message
        .bool(false)
        .u32(4 * POINT.len() as u32)
        .u32(data.len() as u32)
        .bytes(&data)
        .bool(true);
    message
}

/// `tf2_msgs/TFMessage`: where sheets are, each with its parent's frame and its own.
pub(crate) fn transforms(unix_ns: u64, of: &[(&str, &str, &Pose)]) -> Cdr {
    let mut message = Cdr::new();
    message.u32(of.len() as u32);
    for (parent, child, pose) in of {
        message
            .header(unix_ns, parent)
            .text(child)
            .array(&pose.point([0.0, 0.0]))
            .array(&pose.turn());
    }
    message
}

/// How something is, as ROS 2 grades it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Level {
    Ok = 0,
    Warn = 1,
    Error = 2,
    Stale = 3,
}

/// `diagnostic_msgs/DiagnosticStatus`.
pub(crate) struct Status {
    pub(crate) level: Level,
    pub(crate) name: String,
    pub(crate) message: String,
    pub(crate) values: Vec<(&'static str, String)>,
}

/// `diagnostic_msgs/DiagnosticArray`, of what has a serial number.
pub(crate) fn diagnostics(unix_ns: u64, hardware_id: &str, of: &[Status]) -> Cdr {
    let header = Header { unix_ns, frame: "" };
    let mut message = header.begin();
    message.u32(of.len() as u32);
    for status in of {
        message
            .u8(status.level as u8)
            .text(&status.name)
            .text(&status.message)
            .text(hardware_id)
            .u32(status.values.len() as u32);
        for (key, value) in &status.values {
            message.text(key).text(value);
        }
    }
    message
}

#[cfg(test)]
#[path = "messages_tests.rs"]
mod tests;
