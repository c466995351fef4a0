//! The recorder's thread on disks that are slow or full.

use super::*;
use crate::reader::{Ended, Reader};
use crate::sink::full_disk::Disk;
use std::io::{self, Cursor, Read, Write};
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

/// A port that gives one message of the wire at every read.
struct Board(u8);

impl Read for Board {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0 = self.0 % 250 + 1;
        let message = [self.0, self.0, 7, 0];
        buffer[..4].copy_from_slice(&message);
        Ok(4)
    }
}

impl Write for Board {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A disk that does not answer while somebody holds it, and says when it is waited for.
struct Slow {
    answers: Arc<Mutex<()>>,
    asked: Arc<AtomicBool>,
    disk: Disk,
}

impl Write for Slow {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.asked.store(true, Ordering::Release);
        let _held = self.answers.lock().unwrap();
        self.disk.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Target for Slow {
    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.disk.cut(length)
    }

    fn settle(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn messages(disk: &Disk) -> (Vec<Vec<u8>>, Ended) {
    let bytes = disk.bytes.lock().unwrap().clone();
    let mut reader = Reader::new(Cursor::new(bytes), "disk").unwrap();
    let mut out = Vec::new();
    while let Some(message) = reader.next().unwrap() {
        if message.topic == Some(Topic::Board) {
            out.push(message.data.to_vec());
        }
    }
    (out, reader.ended().unwrap())
}

/// Reads `reads` messages through a tap with a place for `places` items, while the disk is held.
fn through(reads: usize, places: usize, room: usize) -> (Tap, Disk, Result<u64, RecordingError>) {
    let (tap, queue) = Tap::holding(places);
    let disk = Disk {
        room,
        ..Disk::default()
    };
    let answers = Arc::new(Mutex::new(()));
    let asked = Arc::new(AtomicBool::new(false));
    let slow = Slow {
        answers: Arc::clone(&answers),
        asked: Arc::clone(&asked),
        disk: disk.clone(),
    };
    let writer = Writer::of(slow, "disk".to_owned()).unwrap();
    let held = answers.lock().unwrap();
    asked.store(false, Ordering::Release);
    let thread = std::thread::spawn(move || record(writer, &queue, Topic::Session, b"{}"));
    // From now on nothing is taken from the queue.
    while !asked.load(Ordering::Acquire) {
        std::thread::yield_now();
    }
    let mut port = tap.port(Board(0));
    let mut buffer = [0; 64];
    for _ in 0..reads {
        // Would hang here if it waited.
        assert_eq!(port.read(&mut buffer).unwrap(), 4);
    }
    drop(held);
    tap.end();
    (tap.clone(), disk, thread.join().unwrap())
}

#[test]
fn a_disk_that_does_not_answer_delays_nothing_and_what_is_lost_is_counted() {
    for (reads, places) in [(100, 256), (1_000, 64)] {
        let (tap, disk, outcome) = through(reads, places, usize::MAX);
        outcome.unwrap();
        let (kept, ended) = messages(&disk);
        assert_eq!(ended, Ended::Whole);
        let lost = counts(&tap.shared).lost_bytes;
        assert_eq!(lost % 4, 0);
        // Every loss tears the message after it too, since it cannot be told from half a one.
        let missing = reads as u64 - kept.len() as u64;
        assert!(
            missing >= lost / 4 && missing <= lost / 4 + lost.min(1),
            "{missing} {lost}"
        );
        assert_eq!(lost == 0, places > reads, "{lost}");
        assert!(kept.iter().all(|m| m.len() == 4 && m[0] == m[1] && m[3] == 0));
    }
}

#[test]
fn a_recording_is_closed_from_elsewhere_and_no_disk_is_waited_for() {
    let (tap, queue) = Tap::holding(64);
    let disk = Disk {
        room: usize::MAX,
        ..Disk::default()
    };
    let answers = Arc::new(Mutex::new(()));
    let slow = Slow {
        answers: Arc::clone(&answers),
        asked: Arc::default(),
        disk: disk.clone(),
    };
    let writer = Writer::of(slow, "disk".to_owned()).unwrap();
    let held = answers.lock().unwrap();
    let thread = std::thread::spawn(move || record(writer, &queue, Topic::Session, b"{}"));
    let mut port = tap.port(Board(0));
    let mut read = || assert_eq!(port.read(&mut [0; 64]).unwrap(), 4);
    (0..20).for_each(|_| read());
    let closer = Closer { tap: tap.clone() };
    assert!(!closer.close(Duration::from_millis(50)));
    drop(held);
    assert!(closer.close(Duration::from_secs(60)) && closer.is_closed());
    // Whoever recorded goes on meanwhile, and closes it too.
    read();
    tap.end();
    thread.join().unwrap().unwrap();
    let (kept, ended) = messages(&disk);
    assert_eq!((kept.len(), ended), (20, Ended::Whole));
    assert!(closer.close(Duration::ZERO));
}

#[test]
fn a_file_into_which_nothing_was_recorded_is_removed_once() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("new.mcap");
    // By whoever made it, or from elsewhere; what has that name afterwards is another file.
    for elsewhere in [false, true] {
        let mut recorder = Recorder::create(&file).unwrap();
        let closer = recorder.closer();
        assert!(file.exists() && !closer.is_closed());
        if elsewhere {
            assert!(closer.close(Duration::ZERO));
            recorder.begin(&()).unwrap();
        } else {
            drop(recorder);
        }
        assert!(closer.is_closed() && !file.exists());
        std::fs::write(&file, "another").unwrap();
        assert!(closer.close(Duration::ZERO) && file.exists());
        std::fs::remove_file(&file).unwrap();
    }
    let mut recorder = Recorder::create(&file).unwrap();
    recorder.begin(&()).unwrap();
    assert!(recorder.closer().close(Duration::from_secs(60)) && file.exists());
}

#[test]
fn a_full_disk_ends_the_recording_closed_and_says_so() {
    let (tap, disk, outcome) = through(5_000, 8_192, 2_500);
    assert!(outcome.is_err());
    let said = tap.shared.failed.lock().unwrap().clone().unwrap();
    assert!(said.contains("closed"), "{said}");
    assert_eq!(messages(&disk).1, Ended::Short);
}
