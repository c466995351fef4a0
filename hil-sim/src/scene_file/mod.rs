//! Scenes as TOML files: sheet, material, electronics, seed, actions and faults on a time line. docs/scenes.md describes
//! every key.

mod actions;
mod error;
mod number;
mod schema;

pub use error::{Located, SceneFileError};

use crate::board::{BoardError, SimBoard, SimConfig};
use crate::clock::samples;
use crate::electronics::Electronics;
use crate::front_end::SimFrontEndError;
use crate::library;
use crate::material::Material;
use crate::rubber::Rubber;
use crate::scene::Scene;
use crate::variation::{Ageing, Variation};
use error::Mistake;
use forward::file::parse_sheet;
use forward::{ForwardError, Sheet};
use schema::{BoardTable, File, MaterialKind, MaterialTable, PlanKey, SheetTable};
use std::path::Path;

/// A scene with all that it takes to run it.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFile {
    /// What it is called.
    pub title: String,
    /// What it shows.
    pub description: String,
    /// How long it is, s.
    pub duration_s: f64,
    /// The sheet, new and even.
    pub sheet: Sheet,
    /// What happens on it, and what it is made of.
    pub scene: Scene,
    /// The board with its electronics and their faults.
    pub config: SimConfig,
}

impl SceneFile {
    /// Reads a file, or a scene of the library by its name.
    ///
    /// # Errors
    /// [`SceneFileError`] names file, line and column, what is wrong there and what is allowed.
    pub fn load(path: &Path) -> Result<Self, SceneFileError> {
        let text = match forward::whole::text(path) {
            Ok(text) => text,
            Err(source) if source.kind() == std::io::ErrorKind::NotFound => {
                let name = path.to_string_lossy();
                if let Some(text) = library::text(&name) {
                    return Self::parse(text, None);
                }
                if name.contains(['/', '.']) {
                    let path = path.to_owned();
                    return Err(SceneFileError::Read { path, source });
                }
                return Err(SceneFileError::Unknown {
                    name: name.into_owned(),
                    known: library::names().collect::<Vec<_>>().join(", "),
                });
            }
            Err(source) => {
                let path = path.to_owned();
                return Err(SceneFileError::Read { path, source });
            }
        };
        Self::parse(&text, path.parent()).map_err(|error| match error {
            SceneFileError::At(mut located) => {
                located.file = Some(path.to_owned());
                SceneFileError::At(located)
            }
            other => other,
        })
    }

    /// Reads a scene's text; a sheet's file is looked for in `folder`.
    ///
    /// # Errors
    /// As for [`SceneFile::load`].
    pub fn parse(text: &str, folder: Option<&Path>) -> Result<Self, SceneFileError> {
        let file = toml::from_str::<File>(text).map_err(Mistake::from);
        file.and_then(|file| Self::from_file(file, text, folder))
            .map_err(|mistake| mistake.located(text))
    }

    fn from_file(file: File, text: &str, folder: Option<&Path>) -> Result<Self, Mistake> {
        let sheet = sheet(&file.sheet, folder)?;
        let mut config = board(&file.board, sheet.electrodes.len())?;
        if let Some(electronics) = file.electronics {
            config.electronics = changed(&config.electronics, text)?;
            let valid = config.electronics.validate();
            valid.map_err(|e| Mistake::new(electronics.span(), e))?;
        }
        config.electronics.seed = file.seed;
        for fault in file.fault {
            let checked = fault.get_ref().validate(sheet.electrodes.len());
            checked.map_err(|e| Mistake::new(fault.span(), e))?;
            config.faults.push(fault.into_inner());
        }
        let mut touches = Vec::new();
        for table in &file.touch {
            touches.push(actions::touch(table)?);
        }
        for table in &file.hand {
            touches.extend(actions::hand(table)?);
        }
        let ageing = &file.sheet.ageing;
        let scene = Scene {
            touches,
            loop_s: file.loop_s.map(|s| s.0),
            material: material(&file.material),
            preloaded: file.preloaded,
            stretches: file.stretch.iter().map(actions::stretch).collect::<Result<_, _>>()?,
            variation: Variation {
                resistivity_sd: file.sheet.resistivity_sd_percent.0 / 100.0,
                correlation_mm: file.sheet.correlation_mm.0,
                contact_sd: file.sheet.contact_sd_percent.0 / 100.0,
                seed: file.seed,
            },
            ageing: Ageing {
                resistivity_per_hour: ageing.resistivity_percent_per_hour.0 / 100.0,
                contact_per_hour: ageing.contact_percent_per_hour.0 / 100.0,
                contact_spread_per_hour: ageing.contact_spread_percent_per_hour.0 / 100.0,
                acceleration: ageing.acceleration.0,
            },
        };
        Ok(Self {
            title: file.title,
            description: file.description,
            duration_s: file.duration_s.0,
            sheet,
            scene,
            config,
        })
    }

    /// The sheet with what happens on it.
    ///
    /// # Errors
    /// The sheet makes no sense.
    pub fn rubber(&self) -> Result<Rubber, ForwardError> {
        Rubber::new(&self.sheet, self.scene.clone())
    }

    /// The whole board at power-up.
    ///
    /// # Errors
    /// Sheet and board do not fit together.
    pub fn board(&self) -> Result<SimBoard<Rubber>, BoardError> {
        let rubber = self.rubber().map_err(SimFrontEndError::from)?;
        SimBoard::new(self.config.clone(), rubber)
    }
}

fn sheet(table: &SheetTable, folder: Option<&Path>) -> Result<Sheet, Mistake> {
    let Some(name) = &table.file else {
        return Ok(Sheet::paper());
    };
    let path = folder.unwrap_or(Path::new("")).join(name.get_ref());
    let text = forward::whole::text(&path)
        .map_err(|e| Mistake::new(name.span(), format_args!("{}: cannot be read: {e}", path.display())))?;
    let parsed = parse_sheet(&text).map_err(|e| Mistake::of_sheet(name.span(), &path, &e))?;
    Ok(parsed.0)
}

fn material(table: &MaterialTable) -> Material {
    let kind = match table.kind {
        MaterialKind::Elastic => Material::default(),
        MaterialKind::Viscoelastic => Material::viscoelastic(),
    };
    Material {
        instant_per_mpa: table.instant_per_mpa.map_or(kind.instant_per_mpa, |v| v.0),
        delayed_per_mpa: table.delayed_per_mpa.map_or(kind.delayed_per_mpa, |v| v.0),
        retardation_s: table.retardation_s.map_or(kind.retardation_s, |v| v.0),
        gauge: table.gauge.map_or(kind.gauge, |v| v.0),
        exponent: table.exponent.map_or(kind.exponent, |v| v.0),
    }
}

/// Electronics with what the text's table `[electronics]` gives put over them. The table was read by itself before, so
/// that whatever is wrong with a key of it was said with its place.
fn changed(preset: &Electronics, text: &str) -> Result<Electronics, Mistake> {
    let unplaced = |e: toml::ser::Error| Mistake::new(0..0, e);
    let mut all = toml::Table::try_from(preset).map_err(unplaced)?;
    let file: toml::Table = toml::from_str(text)?;
    if let Some(toml::Value::Table(given)) = file.get("electronics") {
        all.extend(given.clone());
    }
    Ok(all.try_into()?)
}

fn board(table: &BoardTable, electrodes: usize) -> Result<SimConfig, Mistake> {
    let plan = match &table.plan {
        None => None,
        Some(key) => match key.get_ref() {
            PlanKey::Adjacent => None,
            PlanKey::Named(name) => {
                let plan = name.plan(u8::try_from(electrodes).unwrap_or(u8::MAX));
                Some(plan.map_err(|e| Mistake::new(key.span(), e))?)
            }
        },
    };
    Ok(SimConfig {
        electronics: table.preset.electronics(),
        plan,
        look_samples: table.look_s.map(|s| samples(s.0).max(1)),
        ..SimConfig::default()
    })
}
