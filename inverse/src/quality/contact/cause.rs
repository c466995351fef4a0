//! What changes a frame at the rim beside touches.

/// What may have changed since the baseline. Electrodes count from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cause {
    /// The contact of an electrode.
    Contact(usize),
    /// A leak between the wires of two electrodes near one another, the first before the second.
    Leak([usize; 2]),
}

impl Cause {
    /// The electrode whose contact it is; none of a leak.
    pub(crate) fn contact(self) -> Option<usize> {
        match self {
            Self::Contact(electrode) => Some(electrode),
            Self::Leak(_) => None,
        }
    }

    /// The electrodes between which it leaks; none of a contact.
    pub(crate) fn leak(self) -> Option<[usize; 2]> {
        match self {
            Self::Contact(_) => None,
            Self::Leak(pair) => Some(pair),
        }
    }

    /// Whether the values of all its electrodes are among those of these: then a frame tells nothing of it.
    pub(crate) fn is_of(self, electrodes: &[usize]) -> bool {
        match self {
            Self::Contact(electrode) => electrodes.contains(&electrode),
            Self::Leak(pair) => pair.iter().all(|l| electrodes.contains(l)),
        }
    }
}
