//! What a recording keeps of its board: who it said it was, and what it was set to.

use crate::reading::Reading;
use crate::recorded::SessionRecord;
use anyhow::Result;
use clap::Args;
use protocol::{Decoder, FromBoard, Hello, MAX_FROM_BOARD_LEN, Notice, Plan, ResetCause, SelfTest, Status, Watch};
use recording::{Playback, Speed, Topic};
use std::path::{Path, PathBuf};

/// Why a recording has no such thing.
pub(crate) const ONLY_LIVE: &str = "not in the recording; only a live board can tell";

/// A recording in the place of a board, on the command line.
#[derive(Debug, Args)]
pub(crate) struct From {
    /// A recording: what its board said then.
    #[arg(long, value_name = "RECORDING", conflicts_with_all = ["port", "serial", "simulate", "sheet"], global = true)]
    from: Option<PathBuf>,
}

/// What a recorded board said. What it never said is none.
pub(crate) struct RecordedBoard {
    /// Where it was recorded from.
    pub(crate) source: String,
    /// Its first introduction.
    pub(crate) hello: Hello,
    /// Why it was started anew, every time while it was recorded.
    pub(crate) restarts: Vec<ResetCause>,
    /// What its last introduction said of its start, and its time at its last frame.
    last: (ResetCause, u64),
    /// The plan that frames are measured by.
    pub(crate) plan: Plan,
    /// The watch in force at the end; the inner one is none without a watch.
    pub(crate) watch: Option<Option<Watch>>,
    /// What it said last that it is set to.
    pub(crate) status: Option<Status>,
    /// Its last self-test.
    pub(crate) self_test: Option<SelfTest>,
    /// That it does less than it was told to keep.
    pub(crate) careful: Option<Notice>,
}

impl From {
    /// The recorded board that is asked for; none where a live one is.
    ///
    /// # Errors
    /// As of [`RecordedBoard::read`].
    pub(crate) fn board(&self) -> Result<Option<RecordedBoard>> {
        self.from.as_deref().map(RecordedBoard::read).transpose()
    }
}

impl RecordedBoard {
    /// Reads a recording from end to end.
    ///
    /// # Errors
    /// It cannot be read, or no board introduced itself in it.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let session = SessionRecord::read(path)?;
        let played = Playback::open(path, Speed::Unpaced)?;
        let hello = played.hello().clone();
        let mut board = Self {
            source: format!("recording of {}", session.source),
            last: (hello.reset, 0),
            hello,
            restarts: Vec::new(),
            plan: played.plan().clone(),
            watch: None,
            status: None,
            self_test: None,
            careful: None,
        };
        let mut reader = Reading::open(path)?;
        let mut decoder = Decoder::<MAX_FROM_BOARD_LEN>::new();
        while let Some(message) = reader.next()? {
            if message.topic == Some(Topic::Board) {
                decoder.push(message.data, |m: Result<FromBoard, _>| {
                    if let Ok(said) = m {
                        board.hear(said);
                    }
                });
            }
        }
        Ok(board)
    }
}

impl RecordedBoard {
    fn hear(&mut self, said: FromBoard) {
        match said {
            FromBoard::Hello(hello) => self.last.0 = hello.reset,
            // It introduces itself to whoever asks, too. Its time goes back only where it was started anew.
            FromBoard::Frame(frame) => {
                if frame.time < self.last.1 {
                    self.restarts.push(self.last.0);
                }
                self.last.1 = frame.time;
            }
            FromBoard::Watch(watch) => self.watch = Some(watch),
            FromBoard::Status(status) => self.status = Some(status),
            FromBoard::SelfTest(test) => self.self_test = Some(test),
            FromBoard::Notice(notice @ Notice::Careful { .. }) => self.careful = Some(notice),
            _ => {}
        }
    }
}
