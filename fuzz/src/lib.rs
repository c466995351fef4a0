//! What the fuzz targets do with their bytes: plain functions that panic where a promise is broken.

#[path = "../../firmware/tests/suite/fake/mod.rs"]
mod fake;
#[path = "../../host/src/drive.rs"]
#[allow(dead_code, reason = "the readers only")]
mod drive;
#[path = "../../host/src/files/mod.rs"]
#[allow(dead_code, unreachable_pub, reason = "the readers only")]
mod files;

mod board;
mod readers;

pub use board::{commands, settings};
pub use readers::{programs, tables, toml_files};

use protocol::{Decoder, FromBoard, MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN, ToBoard, encode};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The wire: what is delivered does not depend on how the bytes were cut into pieces, and can be sent again.
pub fn decoder(data: &[u8]) {
    let Some((cut, bytes)) = data.split_first() else { return };
    one_way::<ToBoard, MAX_TO_BOARD_LEN>(*cut, bytes);
    one_way::<FromBoard, MAX_FROM_BOARD_LEN>(*cut, bytes);
    // With a check sum that fits: what random bytes never get past.
    message::<ToBoard, MAX_TO_BOARD_LEN>(bytes);
    message::<FromBoard, MAX_FROM_BOARD_LEN>(bytes);
}

fn one_way<M: DeserializeOwned + Serialize + PartialEq, const N: usize>(cut: u8, bytes: &[u8]) {
    let deliver = |pieces: usize| {
        let mut decoder = Decoder::<N>::new();
        let mut taken = Vec::new();
        for piece in bytes.chunks(pieces) {
            decoder.push::<M>(piece, |result| taken.extend(result.ok()));
        }
        (taken, decoder.counters)
    };
    let (whole, counters) = deliver(bytes.len().max(1));
    let (cut, cut_counters) = deliver(usize::from(cut).max(1));
    assert!(whole == cut && counters == cut_counters);
    assert_eq!(counters.messages as usize, whole.len());
    whole.iter().for_each(sent_again::<M, N>);
}

fn message<M: DeserializeOwned + Serialize + PartialEq, const N: usize>(bytes: &[u8]) {
    if let Ok(message) = postcard::from_bytes::<M>(bytes) {
        sent_again::<M, N>(&message);
    }
}

fn sent_again<M: DeserializeOwned + Serialize + PartialEq, const N: usize>(message: &M) {
    let mut buffer = [0; N];
    let bytes = encode(message, &mut buffer).expect("every message fits");
    let mut decoder = Decoder::<N>::new();
    let mut taken = Vec::new();
    decoder.push::<M>(bytes, |result| taken.extend(result.ok()));
    assert!(taken.len() == 1 && taken[0] == *message);
}
