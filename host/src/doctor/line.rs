//! A line of the examination: what was looked at, a traffic light, and what to do.

use serde::Serialize;
use std::collections::BTreeMap;

/// How something is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Light {
    /// As it should be.
    Ok,
    /// Touches are found, but something should be looked at.
    Look,
    /// Unfit: touches are wrong or missing.
    Bad,
    /// It could not be looked at; the text says why.
    NotKnown,
}

impl Light {
    /// The word that is printed.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Look => "look",
            Self::Bad => "bad",
            Self::NotKnown => "not known",
        }
    }

    /// Its colour on a terminal: green, yellow, red; a thing that is not known is dim.
    fn colour(self) -> &'static str {
        match self {
            Self::Ok => "\x1b[32m",
            Self::Look => "\x1b[33m",
            Self::Bad => "\x1b[31m",
            Self::NotKnown => "\x1b[2m",
        }
    }
}

/// Whose matter it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Cause {
    /// Parts of the board or of the computer.
    Hardware,
    /// Cables, clamps, electrodes, the sheet.
    Wiring,
    /// Programs, settings and files.
    Software,
}

impl Cause {
    fn word(self) -> &'static str {
        match self {
            Self::Hardware => "hardware",
            Self::Wiring => "wiring",
            Self::Software => "software",
        }
    }
}

/// A line of the examination.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Line {
    /// What was looked at.
    pub(crate) name: &'static str,
    pub(crate) light: Light,
    /// What was found, or why nothing is known.
    pub(crate) text: String,
    /// Whose matter it is, where something is to be done.
    pub(crate) cause: Option<Cause>,
    /// What is to be done.
    #[serde(rename = "do")]
    pub(crate) advice: Option<String>,
    /// Electrodes that are to be looked at, from 1.
    pub(crate) electrodes: Vec<usize>,
    /// What was measured, by name with its unit (docs/doctor.schema.json).
    pub(crate) figures: BTreeMap<&'static str, f64>,
}

impl Line {
    fn new(name: &'static str, light: Light, text: String) -> Self {
        Self {
            name,
            light,
            text,
            cause: None,
            advice: None,
            electrodes: Vec::new(),
            figures: BTreeMap::new(),
        }
    }

    /// As it should be.
    pub(crate) fn ok(name: &'static str, text: impl Into<String>) -> Self {
        Self::new(name, Light::Ok, text.into())
    }

    /// Not looked at.
    pub(crate) fn not_known(name: &'static str, why: impl Into<String>) -> Self {
        Self::new(name, Light::NotKnown, why.into())
    }

    /// To be looked at.
    pub(crate) fn look(name: &'static str, text: impl Into<String>, cause: Cause, advice: impl Into<String>) -> Self {
        Self {
            cause: Some(cause),
            advice: Some(advice.into()),
            ..Self::new(name, Light::Look, text.into())
        }
    }

    /// Unfit.
    pub(crate) fn bad(name: &'static str, text: impl Into<String>, cause: Cause, advice: impl Into<String>) -> Self {
        Self::look_or_bad(true, name, text, cause, advice)
    }

    /// Unfit if so, else to be looked at.
    pub(crate) fn look_or_bad(
        bad: bool,
        name: &'static str,
        text: impl Into<String>,
        cause: Cause,
        advice: impl Into<String>,
    ) -> Self {
        let light = if bad { Light::Bad } else { Light::Look };
        Self {
            light,
            ..Self::look(name, text, cause, advice)
        }
    }

    /// With a figure; one that is not finite is left out.
    pub(crate) fn figure(mut self, name: &'static str, value: f64) -> Self {
        if value.is_finite() {
            self.figures.insert(name, value);
        }
        self
    }

    /// With the electrodes that are to be looked at, counted from 1.
    pub(crate) fn electrodes(mut self, electrodes: impl IntoIterator<Item = usize>) -> Self {
        self.electrodes = electrodes.into_iter().collect();
        self.electrodes.sort_unstable();
        self.electrodes.dedup();
        self
    }

    /// For people: one line, and what to do below it.
    pub(crate) fn words(&self, coloured: bool) -> String {
        let word = format!("{:<9}", self.light.word());
        let light = if coloured {
            format!("{}{word}\x1b[0m", self.light.colour())
        } else {
            word
        };
        let mut words = format!("{light}  {:<13}  {}\n", self.name.replace('_', " "), self.text);
        if let (Some(cause), Some(advice)) = (self.cause, &self.advice) {
            words += &format!("{:26}{}: {advice}\n", "", cause.word());
        }
        words
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_is_a_word_and_only_on_a_terminal_a_colour() {
        let line = Line::bad("contact", "electrode 3 is open", Cause::Wiring, "look at its clamp");
        assert_eq!(
            line.words(false),
            "bad        contact        electrode 3 is open\n                          wiring: look at its clamp\n"
        );
        let coloured = line.words(true);
        assert!(
            coloured.starts_with("\x1b[31mbad      \x1b[0m  contact"),
            "{coloured:?}"
        );
        let plain: String = coloured.replace("\x1b[31m", "").replace("\x1b[0m", "");
        assert_eq!(plain, line.words(false));
    }
}
