//! Electronics by name.

use crate::electronics::Electronics;
use serde::Deserialize;
use std::str::FromStr;

/// Ready-made electronics. docs/simulator.md has their numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// A channel for every electrode, with the paper's noise: no such board has been drawn.
    #[default]
    SixteenChannels,
    /// The same without any flaw.
    Ideal,
    /// The board of docs/board.md.
    DrawnBoard,
    /// That with sixteen channels.
    DrawnSixteen,
}

impl Preset {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::SixteenChannels, Self::Ideal, Self::DrawnBoard, Self::DrawnSixteen];

    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::SixteenChannels => "sixteen_channels",
            Self::Ideal => "ideal",
            Self::DrawnBoard => "drawn_board",
            Self::DrawnSixteen => "drawn_sixteen",
        }
    }

    /// What it is.
    pub fn electronics(self) -> Electronics {
        match self {
            Self::SixteenChannels => Electronics::default(),
            Self::Ideal => Electronics::ideal(),
            Self::DrawnBoard => Electronics::drawn_board(),
            Self::DrawnSixteen => Electronics::drawn_sixteen(),
        }
    }
}

impl FromStr for Preset {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|p| p.name() == text).ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            format!("there are no electronics `{text}`; there are {names}")
        })
    }
}
