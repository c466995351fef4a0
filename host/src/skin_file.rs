//! The file of several skins, `--skins FILE`, and what a recording of several says of them.

use crate::run_arguments::SourceArguments;
use anyhow::{Context, Result, anyhow, bail};
use link::plans::PlanChoice;
use recording::{Pose, Reader, Topic};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use view::web::is_name;

/// Where a sheet is on the robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Place {
    /// The robot's frame that the place is given in.
    pub(crate) frame: String,
    /// The sheet's centre.
    pub(crate) position_mm: [f64; 3],
    /// Turns about the frame's x, then y, then z.
    #[serde(default)]
    pub(crate) roll_pitch_yaw_deg: [f64; 3],
}

impl Place {
    /// The frame's axes of the sheet: to its right, up on it, and out of it.
    fn axes(&self) -> [[f64; 3]; 3] {
        let [[sr, cr], [sp, cp], [sy, cy]] = self.roll_pitch_yaw_deg.map(|deg| {
            let (sin, cos) = deg.to_radians().sin_cos();
            [sin, cos]
        });
        [
            [cy * cp, sy * cp, -sp],
            [cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr],
            [cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr],
        ]
    }

    /// Where a point of the sheet is in the robot's frame, mm.
    pub(crate) fn point_mm(&self, [x, y]: [f64; 2]) -> [f64; 3] {
        let [right, up, _] = self.axes();
        [0, 1, 2].map(|k| self.position_mm[k] + x * right[k] + y * up[k])
    }

    /// Which way the sheet faces, of length 1.
    pub(crate) fn normal(&self) -> [f64; 3] {
        self.axes()[2]
    }

    /// The place as viewers have it.
    pub(crate) fn pose(&self) -> Pose {
        let half = self.roll_pitch_yaw_deg.map(|deg| (deg.to_radians() / 2.0).sin_cos());
        let [(sr, cr), (sp, cp), (sy, cy)] = half;
        Pose {
            frame: self.frame.clone(),
            position_m: self.position_mm.map(|mm| 1e-3 * mm),
            orientation: [
                sr * cp * cy - cr * sp * sy,
                cr * sp * cy + sr * cp * sy,
                cr * cp * sy - sr * sp * cy,
                cr * cp * cy + sr * sp * sy,
            ],
        }
    }
}

/// A skin of the file.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Skin {
    pub(crate) name: String,
    /// Of the board or of its adapter.
    serial: Option<String>,
    port: Option<String>,
    #[serde(default)]
    simulate: bool,
    /// Name of a scene, or its file.
    scene: Option<PathBuf>,
    sheet: Option<PathBuf>,
    #[serde(default)]
    wires: Vec<usize>,
    plan: Option<String>,
    calibration: Option<PathBuf>,
    pub(crate) place: Option<Place>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    skin: Vec<Skin>,
}

/// What a recording of several begins with.
#[derive(Serialize, Deserialize)]
pub(crate) struct SkinsRecord {
    skins: Vec<SkinRecord>,
}

impl SkinsRecord {
    /// That of these skins.
    pub(crate) fn of(skins: &[Skin]) -> Self {
        let record = |skin: &Skin| SkinRecord {
            name: skin.name.clone(),
            place: skin.place.clone(),
        };
        Self {
            skins: skins.iter().map(record).collect(),
        }
    }
}

#[derive(Serialize, Deserialize)]
struct SkinRecord {
    name: String,
    place: Option<Place>,
}

/// The names of the skins in a recording of several; none in one of a single skin.
///
/// # Errors
/// It cannot be read.
pub(crate) fn recorded(path: &Path) -> Result<Vec<String>> {
    let (of_file, _) = recording::split(path);
    let mut reader = Reader::open(&of_file)?;
    // It is the first message, or there is none.
    let Some(message) = reader.next()? else {
        return Ok(Vec::new());
    };
    if message.topic != Some(Topic::Skins) {
        return Ok(Vec::new());
    }
    let record: SkinsRecord =
        serde_json::from_slice(message.data).with_context(|| format!("{}: its first message", of_file.display()))?;
    Ok(record.skins.into_iter().map(|s| s.name).collect())
}

/// What of a recording is asked for: its only skin, the one that is named, or each of several with its name.
///
/// # Errors
/// It cannot be read.
pub(crate) fn asked(path: &Path) -> Result<Vec<(Option<String>, PathBuf)>> {
    let (of_file, named) = recording::split(path);
    let names = recorded(path)?;
    if names.is_empty() || named.is_some() {
        return Ok(vec![(None, path.to_owned())]);
    }
    let of = |name: String| {
        let mut file = of_file.clone().into_os_string();
        file.push(format!("#{name}"));
        (Some(name), file.into())
    };
    Ok(names.into_iter().map(of).collect())
}

/// The name of a new file made of a recording, beside it: its own with another ending, and the skin's name where one is named.
pub(crate) fn beside(path: &Path, ending: &str) -> PathBuf {
    let (of_file, skin) = recording::split(path);
    let stem = of_file.file_stem().unwrap_or_default().to_string_lossy();
    let skin = skin.map_or(String::new(), |skin| format!("-{skin}"));
    of_file.with_file_name(format!("{stem}{skin}.{ending}"))
}

/// Reads a file of skins. Other files that it names are beside it.
///
/// # Errors
/// It cannot be read or understood.
pub(crate) fn read(path: &Path) -> Result<Vec<Skin>> {
    let text = ::forward::whole::text(path).with_context(|| format!("{}: the file of skins", path.display()))?;
    parse(&text, path.parent().unwrap_or(Path::new(""))).with_context(|| path.display().to_string())
}

/// Reads the text of such a file.
///
/// # Errors
/// It cannot be understood.
pub(crate) fn parse(text: &str, folder: &Path) -> Result<Vec<Skin>> {
    let File { mut skin } = toml::from_str(text)?;
    if skin.is_empty() {
        bail!("no skin in it; begin one with [[skin]] and its name");
    }
    for k in 0..skin.len() {
        let name = &skin[k].name;
        if !is_name(name) {
            bail!("the name \"{name}\": give 1 to 32 letters, digits, - and _");
        }
        if skin[..k].iter().any(|before| before.name == *name) {
            bail!("there are two skins with the name {name}; give each its own");
        }
        let one = &mut skin[k];
        let sources = [
            one.serial.is_some(),
            one.port.is_some(),
            one.simulate,
            one.scene.is_some(),
        ];
        if sources.iter().filter(|given| **given).count() != 1 {
            bail!("{}: give one of serial, port, simulate and scene", one.name);
        }
        if one.scene.is_some() && one.sheet.is_some() {
            bail!("{}: a scene has its own sheet; leave sheet out", one.name);
        }
        for file in [&mut one.sheet, &mut one.calibration].into_iter().flatten() {
            *file = folder.join(&*file);
        }
        // A name of the library has no ending.
        if let Some(scene) = one.scene.as_mut().filter(|scene| scene.extension().is_some()) {
            *scene = folder.join(&*scene);
        }
    }
    Ok(skin)
}

impl Skin {
    /// Whether it is the one behind a port, with these serial numbers of a board or its adapter.
    pub(crate) fn is_behind(&self, port: &str, serials: &[&str]) -> bool {
        self.port.as_deref() == Some(port) || self.serial.as_deref().is_some_and(|serial| serials.contains(&serial))
    }

    /// The port that it names, where it names one.
    pub(crate) fn port(&self) -> Option<&str> {
        self.port.as_deref()
    }

    /// How its board is named, where it is a board's.
    pub(crate) fn board(&self) -> Option<String> {
        let serial = self.serial.as_ref().map(|serial| format!("serial number {serial}"));
        serial.or_else(|| self.port.as_ref().map(|port| format!("port {port}")))
    }

    /// The options of a session of this skin.
    pub(crate) fn arguments(&self, all: &SourceArguments) -> Result<SourceArguments> {
        let plan = self.plan.as_deref().map(str::parse::<PlanChoice>).transpose();
        let plan = plan.map_err(|why| anyhow!("the plan {}: {why}", self.plan.as_deref().unwrap_or_default()))?;
        Ok(SourceArguments {
            skins: None,
            serial: self.serial.clone(),
            port: self.port.clone(),
            simulate: self.simulate,
            scene: self.scene.clone(),
            sheet: self.sheet.clone(),
            wires: self.wires.clone(),
            calibration: self.calibration.clone(),
            plan: plan.unwrap_or(all.plan),
            ..all.clone()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn apart(a: [f64; 3], b: [f64; 3]) -> f64 {
        (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
    }

    /// One turn after the other about the robot's own axes, and by the quaternion, is the same point.
    #[test]
    fn a_place_turns_about_x_then_y_then_z_and_then_moves() {
        let place = Place {
            frame: "base".to_owned(),
            position_mm: [10.0, -20.0, 30.0],
            roll_pitch_yaw_deg: [25.0, -40.0, 110.0],
        };
        let turn = |[x, y, z]: [f64; 3], axis: usize, deg: f64| {
            let (s, c) = deg.to_radians().sin_cos();
            match axis {
                0 => [x, c * y - s * z, s * y + c * z],
                1 => [c * x + s * z, y, c * z - s * x],
                _ => [c * x - s * y, s * x + c * y, z],
            }
        };
        let turned = |p: [f64; 3]| (0..3).fold(p, |p, axis| turn(p, axis, place.roll_pitch_yaw_deg[axis]));
        let moved = |p: [f64; 3]| [0, 1, 2].map(|k| turned(p)[k] + place.position_mm[k]);
        assert!(apart(place.point_mm([31.0, -7.0]), moved([31.0, -7.0, 0.0])) < 1e-9);
        assert!(apart(place.normal(), turned([0.0, 0.0, 1.0])) < 1e-12);
        let Pose {
            orientation: [x, y, z, w],
            position_m,
            ..
        } = place.pose();
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [
                a[1] * b[2] - a[2] * b[1],
                a[2] * b[0] - a[0] * b[2],
                a[0] * b[1] - a[1] * b[0],
            ]
        };
        let p = [31.0, -7.0, 0.0];
        let once = cross([x, y, z], p);
        let twice = cross([x, y, z], [0, 1, 2].map(|k| once[k] + w * p[k]));
        let by_quaternion = [0, 1, 2].map(|k| p[k] + 2.0 * twice[k] + 1e3 * position_m[k]);
        assert!(apart(by_quaternion, place.point_mm([31.0, -7.0])) < 1e-9);
    }

    #[test]
    fn a_file_names_every_skin_once_and_says_where_it_is() {
        let text = "[[skin]]\nname = \"left\"\nserial = \"A7\"\nsheet = \"square.toml\"\n\
                    [skin.place]\nframe = \"base\"\nposition_mm = [1, 2, 3]\n[[skin]]\nname = \"right\"\nscene = \"hand\"\n";
        let skins = parse(text, Path::new("/etc/skin")).unwrap();
        assert_eq!(skins[0].sheet.as_deref(), Some(Path::new("/etc/skin/square.toml")));
        assert_eq!(skins[0].place.as_ref().unwrap().position_mm, [1.0, 2.0, 3.0]);
        assert_eq!(skins[1].scene.as_deref(), Some(Path::new("hand")));
        for (wrong, says) in [
            ("", "skin"),
            ("skin = []", "no skin in it"),
            ("[[skin]]\nname = \"a b\"\nsimulate = true", "letters"),
            ("[[skin]]\nname = \"a\"", "one of serial"),
            ("[[skin]]\nname = \"a\"\nsimulate = true\nport = \"x\"", "one of serial"),
            (
                "[[skin]]\nname = \"a\"\nsimulate = true\n[[skin]]\nname = \"a\"\nsimulate = true",
                "two skins",
            ),
            (
                "[[skin]]\nname = \"a\"\nscene = \"hand\"\nsheet = \"x.toml\"",
                "its own sheet",
            ),
            ("[[skin]]\nname = \"a\"\nserail = \"x\"", "serail"),
        ] {
            let why = format!("{:#}", parse(wrong, Path::new("")).unwrap_err());
            assert!(why.contains(says), "{why}");
        }
    }
}
