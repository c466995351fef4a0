//! The file of several skins, `--skins FILE`, and what a recording of several says of them.

use crate::run_arguments::SourceArguments;
use anyhow::{Context, Result, anyhow, bail};
use link::plans::PlanChoice;
use recording::{Reader, Topic};
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
    let text = std::fs::read_to_string(path).with_context(|| format!("{}: the file of skins", path.display()))?;
    parse(&text, path.parent().unwrap_or(Path::new(""))).with_context(|| path.display().to_string())
}

fn parse(text: &str, folder: &Path) -> Result<Vec<Skin>> {
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
