//! Questions that a board answers, repeated until it does.

use crate::error::LinkError;
use crate::link::Link;
use protocol::{FromBoard, Hello, MAX_FROM_BOARD_LEN, ToBoard, Version};
use std::time::Duration;

/// How long a board that is there may take to answer, and how often it is reminded of what it was told.
pub(crate) const PATIENCE: Duration = Duration::from_millis(1000);
/// How often a command is sent before its answer is given up.
const TRIES: u32 = 3;

/// Asks a board who it is. Repeated, since the first bytes after opening may be lost.
///
/// # Errors
/// [`LinkError::Silent`] or [`LinkError::Version`].
pub fn greet(link: &Link) -> Result<Hello, LinkError> {
    let hello = insist(link, "a greeting", &ToBoard::Hello, PATIENCE / TRIES, |m| match m {
        FromBoard::Hello(hello) => Some(hello),
        _ => None,
    })?;
    if hello.version.major != Version::CURRENT.major {
        return Err(LinkError::Version {
            board: hello.version.major,
            ours: Version::CURRENT.major,
        });
    }
    Ok(hello)
}

/// Asks up to [`TRIES`] times for an answer that `accept` takes, each time for a while: a command or its answer may be
/// damaged on the way.
pub(crate) fn insist<T>(
    link: &Link,
    what: &'static str,
    command: &ToBoard,
    wait: Duration,
    mut accept: impl FnMut(FromBoard) -> Option<T>,
) -> Result<T, LinkError> {
    let mut answer = Err(LinkError::Silent { what, ms: 0 });
    for _ in 0..TRIES {
        answer = link.ask(what, command.clone(), wait, &mut accept);
        if !matches!(answer, Err(LinkError::Silent { .. } | LinkError::Refused(_))) {
            break;
        }
    }
    let ms = (wait * TRIES).as_millis();
    let bytes = link.counters().bytes_unread;
    answer.map_err(|e| match e {
        // More than what is on its way when a port is opened.
        LinkError::Silent { .. } if bytes > MAX_FROM_BOARD_LEN as u64 => LinkError::Damaged { ms, bytes },
        LinkError::Silent { what, .. } => LinkError::Silent { what, ms },
        e => e,
    })
}
