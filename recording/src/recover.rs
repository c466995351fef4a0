//! From a file that was cut short, or is damaged, to one that is closed and whole.

use crate::error::RecordingError;
use crate::reader::{Ended, Reader};
use crate::sink::Target;
use crate::writer::Writer;
use std::collections::BTreeMap;
use std::io::Read;

/// What was recovered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recovered {
    /// Messages.
    pub messages: u64,
    /// When the first and the last was recorded, ns since 1970; none without messages.
    pub from_to_ns: Option<(u64, u64)>,
    /// How the file ended that it was recovered from.
    pub ended: Ended,
    /// Chunks of it that are damaged: what was in them is lost.
    pub damaged: usize,
    /// Bytes of the new file.
    pub bytes: u64,
}

/// Copies every message that can be read, in order, into a new file and closes it. `progress` is told how many bytes of the old one
/// were read.
///
/// # Errors
/// The old file cannot be read, or the new one cannot be written.
pub fn recover<R: Read, T: Target>(
    from: &mut Reader<R>,
    mut to: Writer<T>,
    mut progress: impl FnMut(u64),
) -> Result<Recovered, RecordingError> {
    let mut channels: BTreeMap<u16, u16> = BTreeMap::new();
    let mut messages = 0;
    let mut from_to_ns: Option<(u64, u64)> = None;
    let mut data = Vec::new();
    loop {
        let Some(message) = from.next()? else { break };
        let (channel, sequence, log_ns, publish_ns) =
            (message.channel, message.sequence, message.log_ns, message.publish_ns);
        data.clear();
        data.extend_from_slice(message.data);
        let known = match channels.get(&channel) {
            Some(known) => *known,
            None => {
                // A message of no channel cannot be told from damage.
                let Some(of) = from.channel(channel) else { continue };
                let schema = of
                    .schema
                    .as_ref()
                    .map(|(n, e, t)| (n.as_str(), e.as_str(), t.as_slice()));
                let known = to.channel(&of.name, &of.encoding, schema)?;
                channels.insert(channel, known);
                known
            }
        };
        to.write(known, sequence, log_ns, publish_ns, &data)?;
        messages += 1;
        from_to_ns = Some(from_to_ns.map_or((log_ns, log_ns), |(a, b)| (a.min(log_ns), b.max(log_ns))));
        progress(from.bytes());
    }
    Ok(Recovered {
        messages,
        from_to_ns,
        ended: from.ended().unwrap_or(Ended::Cut),
        damaged: from.damaged(),
        bytes: to.finish()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sink::full_disk::Disk;
    use crate::topic::Topic;
    use proptest::prelude::*;
    use std::io::Cursor;
    use std::sync::OnceLock;

    type Messages = Vec<(Topic, u64, Vec<u8>)>;

    fn disk() -> Disk {
        Disk {
            room: usize::MAX,
            ..Disk::default()
        }
    }

    /// A recording of some chunks, and its messages.
    fn whole() -> &'static (Vec<u8>, Messages) {
        static FILE: OnceLock<(Vec<u8>, Messages)> = OnceLock::new();
        FILE.get_or_init(|| {
            let disk = disk();
            let mut writer = Writer::of(disk.clone(), "whole".to_owned()).unwrap();
            let mut messages = Vec::new();
            for k in 0..300_u64 {
                let topic = Topic::ALL[(k % 10) as usize];
                let data: Vec<u8> = (0..50 + k % 60).map(|n| (n * n + k * 13) as u8).collect();
                writer.message(topic, 1_000 + k, 900 + k, &data).unwrap();
                messages.push((topic, 1_000 + k, data));
                if k % 40 == 39 {
                    writer.flush().unwrap();
                }
            }
            writer.finish().unwrap();
            let bytes = disk.bytes.lock().unwrap().clone();
            (bytes, messages)
        })
    }

    fn read(bytes: &[u8]) -> Result<(Messages, Ended), RecordingError> {
        let mut reader = Reader::new(Cursor::new(bytes), "file")?;
        let mut messages = Vec::new();
        while let Some(message) = reader.next()? {
            // A chunk that names a channel may be lost to damage.
            let Some(topic) = message.topic else { continue };
            messages.push((topic, message.log_ns, message.data.to_vec()));
        }
        Ok((messages, reader.ended().unwrap()))
    }

    /// What recovering the first bytes of the file gives.
    fn recovered(bytes: &[u8]) -> Result<(Messages, Recovered), RecordingError> {
        let disk = disk();
        let mut reader = Reader::new(Cursor::new(bytes), "prefix")?;
        let told = recover(&mut reader, Writer::of(disk.clone(), "new".to_owned())?, |_| ())?;
        let new = disk.bytes.lock().unwrap().clone();
        let (messages, ended) = read(&new)?;
        assert_eq!(ended, Ended::Whole);
        Ok((messages, told))
    }

    #[test]
    fn what_is_written_is_read() {
        let (bytes, messages) = whole();
        assert_eq!(&read(bytes).unwrap(), &(messages.clone(), Ended::Whole));
        let (again, told) = recovered(bytes).unwrap();
        assert_eq!(&again, messages);
        assert_eq!((told.messages, told.from_to_ns), (300, Some((1_000, 1_299))));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]
        /// Any beginning of a file gives the first messages: all of the chunks that are whole. Recovering never panics.
        #[test]
        fn any_prefix_gives_the_first_messages(part in 0.0..1.0_f64) {
            let (bytes, messages) = whole();
            let cut = (part * bytes.len() as f64) as usize;
            match recovered(&bytes[..cut]) {
                // Not even the header is there.
                Err(RecordingError::Foreign { .. }) => prop_assert!(cut < 64, "{cut}"),
                Err(why) => prop_assert!(false, "{why}"),
                Ok((first, told)) => {
                    prop_assert_eq!(told.ended, Ended::Cut);
                    prop_assert_eq!(&first[..], &messages[..first.len()]);
                    prop_assert!(first.len() % 40 == 0 || first.len() == 300, "{}", first.len());
                }
            }
        }
    }

    /// What is damaged in the middle of the file costs its own chunk, and that is told.
    #[test]
    fn a_damaged_chunk_costs_its_own_messages() {
        let (bytes, messages) = whole();
        for part in [0.3, 0.4, 0.5, 0.6, 0.7] {
            let mut bytes = bytes.clone();
            let at = (part * bytes.len() as f64) as usize;
            bytes[at] ^= 0x10;
            let (left, told) = recovered(&bytes).unwrap();
            assert_eq!((told.damaged, told.ended), (1, Ended::Whole), "{part}");
            let lost: Vec<usize> = (0..messages.len()).filter(|k| !left.contains(&messages[*k])).collect();
            assert!(lost.windows(2).all(|two| two[1] == two[0] + 1), "{lost:?}");
            assert!(lost.len() == 40 && lost[0].is_multiple_of(40), "{lost:?}");
        }
    }

    /// Topics are named in the first chunk that has them: without that their messages are lost, and counted.
    #[test]
    fn what_a_damaged_chunk_named_is_counted() {
        let (bytes, messages) = whole();
        let mut bytes = bytes.clone();
        // Within the first chunk.
        bytes[300] ^= 0x10;
        let mut reader = Reader::new(Cursor::new(bytes), "file").unwrap();
        let mut named = 0;
        while let Some(message) = reader.next().unwrap() {
            named += usize::from(message.topic.is_some());
        }
        assert_eq!((reader.damaged(), reader.ended()), (1, Some(Ended::Whole)));
        assert_eq!(named + reader.nameless() as usize, messages.len() - 40);
        assert!(reader.nameless() > 0);
    }

    /// Damage in the middle never panics either, and whatever is read is what was written, in its order: wherever one bit is turned.
    #[test]
    fn damage_invents_nothing() {
        let (bytes, messages) = whole();
        for at in 0..bytes.len() {
            let mut bytes = bytes.clone();
            for bit in [at % 8, (at / 8 + 3) % 8] {
                bytes[at] ^= 1 << bit;
                if let Ok((read, _)) = read(&bytes) {
                    let mut written = messages.iter();
                    assert!(
                        read.iter().all(|message| written.any(|m| m == message)),
                        "bit {bit} of byte {at}"
                    );
                }
            }
        }
    }
}
