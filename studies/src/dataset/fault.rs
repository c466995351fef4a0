//! What broke since the baseline.

use super::draw::Distribution;
use super::error::DatasetError;
use super::file::FaultTable;
use hil_sim::{FaultKind, Multiplexer};
use rand::Rng;
use rand::rngs::StdRng;
use serde::Deserialize;

/// What can break in a dataset. Electrodes are drawn, each as often as the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKindName {
    /// A wire is off an electrode.
    ElectrodeOpen,
    /// A contact has become worse, by `ohm`.
    ContactRaised,
    /// The wires of two neighbouring electrodes touch, with `ohm` between them.
    ElectrodesShort,
    /// The source gives the part `part` of its amplitude.
    SourceSags,
    /// The source gives nothing.
    SourceLost,
    /// The drive's multiplexer stays on an electrode.
    MultiplexerStuck,
    /// The amplifier of one of several channels gives nothing.
    ChannelDead,
    /// The converter gives one code.
    AdcStuck,
    /// All amplifiers are against a rail.
    Saturation,
}

/// A fault of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// Which of the file's faults, from 0.
    pub of: usize,
    /// The electrode, or channel, that it is at, from 0; the first one of two.
    pub electrode: Option<u8>,
    /// Its size: ohm, or the part that is left.
    pub size: Option<f64>,
    /// What the simulator makes of it.
    pub kind: FaultKind,
}

impl FaultTable {
    fn needs_ohm(&self) -> bool {
        matches!(self.kind, FaultKindName::ContactRaised | FaultKindName::ElectrodesShort)
    }

    fn needs_part(&self) -> bool {
        self.kind == FaultKindName::SourceSags
    }

    pub(super) fn check(&self) -> Result<(), DatasetError> {
        let of = |key, needed: bool, given: Option<&Distribution>| match (needed, given) {
            (true, None) => Err(DatasetError::Key(key, format!("{:?} needs it", self.kind))),
            (false, Some(_)) => Err(DatasetError::Key(
                key,
                format!("{:?} has none; leave it out", self.kind),
            )),
            (true, Some(of)) => {
                let wrong = of
                    .wrong()
                    .or_else(|| (of.least() < 0.0).then(|| "give numbers of 0 or more".to_owned()));
                wrong.map_or(Ok(()), |text| Err(DatasetError::Key(key, text)))
            }
            (false, None) => Ok(()),
        };
        of("fault.ohm", self.needs_ohm(), self.ohm.as_ref())?;
        of("fault.part", self.needs_part(), self.part.as_ref())
    }
}

/// The fault of a frame, if any.
pub(super) fn draw(tables: &[FaultTable], electrodes: usize, rng: &mut StdRng) -> Result<Option<Label>, DatasetError> {
    let mut left: f64 = rng.random();
    let Some(of) = tables.iter().position(|table| {
        let is_it = left < table.chance;
        left -= table.chance;
        is_it
    }) else {
        return Ok(None);
    };
    let table = &tables[of];
    let count = u8::try_from(electrodes).unwrap_or(u8::MAX).max(1);
    let electrode = rng.random_range(0..count);
    let drawn = |of: &Option<Distribution>, rng: &mut StdRng| of.as_ref().map_or(0.0, |of| of.draw(rng));
    let (kind, at, size) = match table.kind {
        FaultKindName::ElectrodeOpen => (FaultKind::ElectrodeOpen { electrode }, Some(electrode), None),
        FaultKindName::ContactRaised => {
            let ohm = drawn(&table.ohm, rng);
            (FaultKind::ContactRaised { electrode, ohm }, Some(electrode), Some(ohm))
        }
        FaultKindName::ElectrodesShort => {
            let ohm = drawn(&table.ohm, rng);
            let electrodes = [electrode, (electrode + 1) % count];
            (
                FaultKind::ElectrodesShort { electrodes, ohm },
                Some(electrode),
                Some(ohm),
            )
        }
        FaultKindName::SourceSags => {
            let part = drawn(&table.part, rng);
            (FaultKind::SourceSags { part }, None, Some(part))
        }
        FaultKindName::SourceLost => (FaultKind::SourceLost, None, None),
        FaultKindName::MultiplexerStuck => {
            let multiplexer = Multiplexer::DrivePlus;
            (
                FaultKind::MultiplexerStuck { multiplexer, electrode },
                Some(electrode),
                None,
            )
        }
        FaultKindName::ChannelDead => {
            let channel = electrode.min(15);
            (FaultKind::ChannelDead { channel }, Some(channel), None)
        }
        FaultKindName::AdcStuck => (
            FaultKind::AdcStuck {
                code: rng.random_range(0..4096),
            },
            None,
            None,
        ),
        FaultKindName::Saturation => (FaultKind::Saturation { channel: None }, None, None),
    };
    Ok(Some(Label {
        of,
        electrode: at,
        size,
        kind,
    }))
}
