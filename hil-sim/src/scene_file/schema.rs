//! What a scene's file may hold; docs/scenes.md says what it means.

use super::number::{Change, Finite, NotNegative, OneOrMore, Positive, Share};
use crate::electronics::Electronics;
use crate::fault::Fault;
use crate::preset::Preset;
use protocol::PlanName;
use serde::de::Error;
use serde::{Deserialize, Deserializer};
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct File {
    #[serde(default)]
    pub(super) title: String,
    #[serde(default)]
    pub(super) description: String,
    #[serde(default = "one")]
    pub(super) seed: u64,
    pub(super) duration_s: Positive,
    pub(super) loop_s: Option<Positive>,
    #[serde(default)]
    pub(super) preloaded: bool,
    #[serde(default)]
    pub(super) sheet: SheetTable,
    #[serde(default)]
    pub(super) material: MaterialTable,
    pub(super) electronics: Option<Spanned<Electronics>>,
    #[serde(default)]
    pub(super) board: BoardTable,
    #[serde(default)]
    pub(super) touch: Vec<Spanned<TouchTable>>,
    #[serde(default)]
    pub(super) hand: Vec<Spanned<HandTable>>,
    #[serde(default)]
    pub(super) stretch: Vec<Spanned<StretchTable>>,
    #[serde(default)]
    pub(super) fault: Vec<Spanned<Fault>>,
}

fn one() -> u64 {
    1
}

#[derive(Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct SheetTable {
    pub(super) file: Option<Spanned<String>>,
    pub(super) resistivity_sd_percent: NotNegative,
    pub(super) correlation_mm: Positive,
    pub(super) contact_sd_percent: NotNegative,
    pub(super) ageing: AgeingTable,
}

impl Default for SheetTable {
    fn default() -> Self {
        Self {
            file: None,
            resistivity_sd_percent: NotNegative(0.0),
            correlation_mm: Positive(40.0),
            contact_sd_percent: NotNegative(0.0),
            ageing: AgeingTable::default(),
        }
    }
}

#[derive(Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct AgeingTable {
    pub(super) resistivity_percent_per_hour: Change,
    pub(super) contact_percent_per_hour: Change,
    pub(super) contact_spread_percent_per_hour: NotNegative,
    pub(super) acceleration: NotNegative,
}

impl Default for AgeingTable {
    fn default() -> Self {
        Self {
            resistivity_percent_per_hour: Change(0.0),
            contact_percent_per_hour: Change(0.0),
            contact_spread_percent_per_hour: NotNegative(0.0),
            acceleration: NotNegative(1.0),
        }
    }
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct MaterialTable {
    pub(super) kind: MaterialKind,
    pub(super) instant_per_mpa: Option<Positive>,
    pub(super) delayed_per_mpa: Option<NotNegative>,
    pub(super) retardation_s: Option<Positive>,
    pub(super) gauge: Option<Positive>,
    pub(super) exponent: Option<OneOrMore>,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum MaterialKind {
    Elastic,
    #[default]
    Viscoelastic,
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct BoardTable {
    pub(super) preset: Preset,
    pub(super) plan: Option<Spanned<PlanKey>>,
    pub(super) look_s: Option<Positive>,
}

/// What a board measures until it is told otherwise: a ready-made plan, or `adjacent`, the board's own choice.
pub(super) enum PlanKey {
    Adjacent,
    Named(PlanName),
}

impl<'de> Deserialize<'de> for PlanKey {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        match String::deserialize(from)?.as_str() {
            "adjacent" => Ok(Self::Adjacent),
            name => name
                .parse()
                .map(Self::Named)
                .map_err(|e| D::Error::custom(format_args!("{e}, or adjacent"))),
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TouchTable {
    pub(super) shape: ShapeName,
    pub(super) radius_mm: Option<Positive>,
    pub(super) aspect: Option<Positive>,
    pub(super) full_size_n: Option<Positive>,
    pub(super) keys: Option<Vec<Spanned<KeyTable>>>,
    pub(super) press: Option<Press>,
    pub(super) tap: Option<Tap>,
    pub(super) slide: Option<Slide>,
    pub(super) repeat: Option<Repeat>,
}

#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "snake_case")]
pub(super) enum ShapeName {
    Disc,
    Finger,
    Pad,
    Palm,
}

/// What is left out is as in the key before; before the first all is 0.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct KeyTable {
    pub(super) t_s: NotNegative,
    pub(super) x_mm: Option<Finite>,
    pub(super) y_mm: Option<Finite>,
    pub(super) force_n: Option<NotNegative>,
    pub(super) angle_deg: Option<Finite>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Press {
    pub(super) at_s: NotNegative,
    pub(super) for_s: Option<Positive>,
    #[serde(default = "ramp")]
    pub(super) ramp_s: NotNegative,
    pub(super) x_mm: Finite,
    pub(super) y_mm: Finite,
    pub(super) force_n: Positive,
    #[serde(default)]
    pub(super) angle_deg: Finite,
}

fn ramp() -> NotNegative {
    NotNegative(0.1)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Tap {
    pub(super) at_s: NotNegative,
    #[serde(default = "tap_length")]
    pub(super) for_s: Positive,
    #[serde(default = "tap_ramp")]
    pub(super) ramp_s: NotNegative,
    pub(super) x_mm: Finite,
    pub(super) y_mm: Finite,
    pub(super) force_n: Positive,
}

fn tap_length() -> Positive {
    Positive(0.03)
}

fn tap_ramp() -> NotNegative {
    NotNegative(0.015)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Slide {
    pub(super) at_s: NotNegative,
    pub(super) for_s: Positive,
    #[serde(default = "ramp")]
    pub(super) ramp_s: NotNegative,
    pub(super) from_mm: [Finite; 2],
    pub(super) to_mm: [Finite; 2],
    pub(super) force_n: Positive,
    #[serde(default)]
    pub(super) from_deg: Finite,
    #[serde(default)]
    pub(super) to_deg: Finite,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Repeat {
    pub(super) at_s: NotNegative,
    pub(super) count: u16,
    pub(super) press_s: Positive,
    pub(super) rest_s: NotNegative,
    #[serde(default = "ramp")]
    pub(super) ramp_s: NotNegative,
    pub(super) x_mm: Finite,
    pub(super) y_mm: Finite,
    pub(super) force_n: Positive,
    #[serde(default)]
    pub(super) angle_deg: Finite,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct HandTable {
    #[serde(default = "palm")]
    pub(super) palm_width_mm: Positive,
    #[serde(default = "palm_share")]
    pub(super) palm_share_percent: Share,
    pub(super) keys: Option<Vec<Spanned<KeyTable>>>,
    pub(super) press: Option<Press>,
}

fn palm() -> Positive {
    Positive(72.0)
}

fn palm_share() -> Share {
    Share(60.0)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StretchTable {
    pub(super) x_mm: Option<Finite>,
    pub(super) y_mm: Option<Finite>,
    pub(super) radius_mm: Option<Positive>,
    pub(super) keys: Vec<Spanned<StretchKey>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StretchKey {
    pub(super) t_s: NotNegative,
    pub(super) strain_percent: Finite,
}
