//! What a recording holds: topics and their schemas.

/// Number of the format. It grows when a reader of the number before would misunderstand a file.
pub const FORMAT: u32 = 1;
/// The profile in the file's header.
pub const PROFILE: &str = "skin";

/// The step on [`Topic::Live`] that the recorder itself writes: what follows came by a port that was opened again.
pub(crate) const PORT_STEP: &str = "port";

/// A topic. Messages of all but the first two are JSON.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Topic {
    /// What the board sent: one message of the wire, byte for byte, its closing zero included.
    Board,
    /// What the board was told, in the same way.
    Host,
    /// What was recorded, and how: sheet, calibration, options, board. The first message of a file.
    Session,
    /// What went into the baseline, and what was asked for: with the touches' frames all that a replay needs.
    Live,
    /// The touches of every picture.
    Touches,
    /// The touches as points, for viewers.
    Points,
    /// What is wrong with electrodes.
    Electrodes,
    /// What the program said.
    Log,
    /// The picture, now and then.
    Picture,
    /// Host's and board's clock, and what was lost.
    Clock,
    /// The skins of a recording of several, by name. The first message of such a file.
    Skins,
}

impl Topic {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Board,
        Self::Host,
        Self::Session,
        Self::Live,
        Self::Touches,
        Self::Points,
        Self::Electrodes,
        Self::Log,
        Self::Picture,
        Self::Clock,
        Self::Skins,
    ];

    /// Its name in the file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Board => "/board",
            Self::Host => "/host",
            Self::Session => "/session",
            Self::Live => "/live",
            Self::Touches => "/touches",
            Self::Points => "/touches/points",
            Self::Electrodes => "/electrodes",
            Self::Log => "/log",
            Self::Picture => "/picture",
            Self::Clock => "/clock",
            Self::Skins => "/skins",
        }
    }

    /// The topic of a name.
    pub fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|t| t.name() == name)
    }

    /// Its name in the file where it is one skin's of several: `/left/touches`.
    pub fn name_of(self, skin: Option<&str>) -> String {
        match skin {
            Some(skin) => format!("/{skin}{}", self.name()),
            None => self.name().to_owned(),
        }
    }

    /// The skin and the topic of a name in the file; no skin where the topic is of the whole recording.
    pub fn skin_of(name: &str) -> Option<(Option<&str>, Self)> {
        if let Some(topic) = Self::of(name) {
            return Some((None, topic));
        }
        let after = name.strip_prefix('/')?;
        let (skin, _) = after.split_once('/')?;
        Some((Some(skin), Self::of(&after[skin.len()..])?))
    }

    /// How its messages are encoded, as the file says it.
    pub fn encoding(self) -> &'static str {
        match self {
            // Postcard, CRC-32C and COBS (docs/protocol.md).
            Self::Board | Self::Host => "skin-wire",
            _ => "json",
        }
    }

    /// Name and JSON schema of its messages; none for bytes of the wire.
    pub fn schema(self) -> Option<(&'static str, &'static str)> {
        match self {
            Self::Board | Self::Host => None,
            Self::Session => Some(("skin.Session", include_str!("schemas/session.json"))),
            Self::Live => Some(("skin.Live", include_str!("schemas/live.json"))),
            Self::Touches => Some(("skin.Touches", include_str!("schemas/touches.json"))),
            Self::Points => Some(("foxglove.PointCloud", include_str!("schemas/point_cloud.json"))),
            Self::Electrodes => Some(("skin.Electrodes", include_str!("schemas/electrodes.json"))),
            Self::Log => Some(("foxglove.Log", include_str!("schemas/log.json"))),
            Self::Picture => Some((
                "foxglove.CompressedImage",
                include_str!("schemas/compressed_image.json"),
            )),
            Self::Clock => Some(("skin.Clock", include_str!("schemas/clock.json"))),
            Self::Skins => Some(("skin.Skins", include_str!("schemas/skins.json"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_told_apart_and_schemas_are_json() {
        for topic in Topic::ALL {
            assert_eq!(Topic::of(topic.name()), Some(topic));
            if let Some((name, text)) = topic.schema() {
                let schema: serde_json::Value = serde_json::from_str(text).unwrap();
                assert_eq!(schema["title"], name);
                assert_eq!(schema["type"], "object", "{name}");
            }
        }
        assert_eq!(Topic::of("/other"), None);
        for topic in Topic::ALL {
            for skin in [None, Some("left"), Some("touches"), Some("a-b_1")] {
                assert_eq!(Topic::skin_of(&topic.name_of(skin)), Some((skin, topic)));
            }
        }
        for other in ["/left/other", "left/board", "//", ""] {
            assert_eq!(Topic::skin_of(other), None, "{other}");
        }
    }
}
