//! Laws of the framing: what goes in comes out, nothing else does, and it does not matter how the bytes are cut.

use proptest::collection::vec;
use proptest::prelude::*;
use protocol::{
    BoardError, Command, Counters, Decoder, Flags, Frame, FrameError, FromBoard, MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN,
    MAX_VALUES, Outgoing, Pair, Plan, Sampling, Slot, ToBoard, Value, Variance, Version, encode,
};

fn framed(message: &FromBoard) -> Vec<u8> {
    encode(message, &mut [0; MAX_FROM_BOARD_LEN]).unwrap().to_vec()
}

fn decoded<const N: usize>(pieces: &[&[u8]]) -> (Vec<Result<FromBoard, FrameError>>, Decoder<N>) {
    let mut out = Vec::new();
    let mut decoder = Decoder::<N>::new();
    for piece in pieces {
        decoder.push(piece, |m| out.push(m));
    }
    (out, decoder)
}

prop_compose! {
    fn frames()(
        sequence: u32, time: u64, plan: u16,
        flags in vec(0..MAX_VALUES, 0..8),
        values in vec(any::<i16>(), 0..=MAX_VALUES),
        quadrature: bool,
        noise in vec(any::<u32>(), 0..=32),
    ) -> FromBoard {
        let mut clipped = Flags::default();
        flags.iter().for_each(|k| clipped.set(*k));
        let values: protocol::heapless::Vec<Value, MAX_VALUES> = values.iter().map(|v| Value::new(*v)).collect();
        let quadrature = if quadrature { values.clone() } else { Default::default() };
        let noise = noise.into_iter().map(Variance::new).collect();
        FromBoard::Frame(Frame { sequence, time, plan, clipped, values, quadrature, noise })
    }
}

prop_compose! {
    fn plans()(
        id: u16, settle_quarters: u16, integrate_periods: u16, sequential: bool, quadrature: bool,
        slots in vec((any::<u8>(), any::<u8>(), any::<u8>(), any::<u32>(), any::<u8>()), 0..=32),
    ) -> Plan {
        Plan {
            id, settle_quarters, integrate_periods, quadrature,
            sampling: if sequential { Sampling::Sequential } else { Sampling::Simultaneous },
            slots: slots.iter().map(|(plus, minus, sense_step, sense, gain)| Slot {
                drive: Pair { plus: *plus, minus: *minus },
                sense_step: *sense_step, sense: *sense, gain: *gain,
            }).collect(),
        }
    }
}

fn messages() -> impl Strategy<Value = FromBoard> {
    prop_oneof![
        frames(),
        plans().prop_map(FromBoard::Plan),
        any::<[u32; 3]>().prop_map(|[frames, dropped, overruns]| {
            FromBoard::Counters(Counters {
                frames,
                dropped,
                overruns,
                ..Counters::default()
            })
        }),
        Just(FromBoard::Ack(Command::Stop)),
        Just(FromBoard::Error(BoardError::Command(FrameError::Crc))),
    ]
}

/// Streams with true frames in them, and bytes that often look like ones.
fn streams() -> impl Strategy<Value = Vec<u8>> {
    let short = prop_oneof![Just(0u8), Just(1), Just(2), Just(0xFF), any::<u8>()];
    vec(
        prop_oneof![vec(short, 0..40), messages().prop_map(|m| framed(&m))],
        0..6,
    )
    .prop_map(|parts| parts.concat())
}

proptest! {
    #[test]
    fn what_goes_in_comes_out(list in vec(messages(), 0..5)) {
        let stream: Vec<u8> = list.iter().flat_map(framed).collect();
        let (out, decoder) = decoded::<MAX_FROM_BOARD_LEN>(&[&stream]);
        prop_assert_eq!(decoder.counters.messages as usize, list.len());
        prop_assert_eq!(out, list.into_iter().map(Ok).collect::<Vec<_>>());
    }

    #[test]
    fn what_is_borrowed_is_sent_as_what_is_owned(m in messages()) {
        let mut buffer = [0; MAX_FROM_BOARD_LEN];
        let borrowed = encode(&Outgoing::from(&m), &mut buffer).unwrap();
        prop_assert_eq!(borrowed, &framed(&m)[..]);
    }

    #[test]
    fn commands_too(plan in plans()) {
        let command = ToBoard::SetPlan(plan);
        let mut buffer = [0; MAX_TO_BOARD_LEN];
        let bytes = encode(&command, &mut buffer).unwrap();
        let mut out = Vec::new();
        Decoder::<MAX_TO_BOARD_LEN>::new().push(bytes, |m| out.push(m));
        prop_assert_eq!(out, vec![Ok(command)]);
    }

    #[test]
    fn a_frame_holds_no_zero_but_its_last_byte(m in messages()) {
        let bytes = framed(&m);
        prop_assert_eq!(bytes.iter().position(|b| *b == 0), Some(bytes.len() - 1));
    }

    #[test]
    fn cutting_the_stream_changes_nothing(stream in streams(), cuts in vec(any::<prop::sample::Index>(), 0..12)) {
        let mut at: Vec<usize> = cuts.iter().map(|c| c.index(stream.len() + 1)).collect();
        at.extend([0, stream.len()]);
        at.sort_unstable();
        let pieces: Vec<&[u8]> = at.windows(2).map(|w| &stream[w[0]..w[1]]).collect();
        // Large enough for everything, and so small that most frames overflow.
        let (whole, a) = decoded::<MAX_FROM_BOARD_LEN>(&[&stream]);
        let (cut, b) = decoded::<MAX_FROM_BOARD_LEN>(&pieces);
        prop_assert_eq!(whole, cut);
        prop_assert_eq!(a.counters, b.counters);
        let (whole, a) = decoded::<12>(&[&stream]);
        let (cut, b) = decoded::<12>(&pieces);
        prop_assert_eq!(whole, cut);
        prop_assert_eq!(a.counters, b.counters);
    }

    #[test]
    fn garbage_costs_at_most_the_frame_it_touches(garbage in vec(any::<u8>(), 0..3000), m in messages()) {
        let mut stream = garbage;
        stream.extend(framed(&m));
        stream.extend(framed(&m));
        let (out, _) = decoded::<MAX_FROM_BOARD_LEN>(&[&stream]);
        prop_assert_eq!(out.last(), Some(&Ok(m)));
    }

    #[test]
    fn a_flipped_bit_never_makes_another_message(m in messages(), at: prop::sample::Index) {
        let good = framed(&m);
        let bit = at.index(good.len() * 8);
        let mut stream = good.clone();
        stream[bit / 8] ^= 1 << (bit % 8);
        stream.extend(&good);
        stream.extend(&good);
        let (out, _) = decoded::<{ 3 * MAX_FROM_BOARD_LEN }>(&[&stream]);
        let delivered: Vec<_> = out.iter().flatten().collect();
        prop_assert!(delivered.iter().all(|d| **d == m));
        // A flipped delimiter joins two frames and loses both; any other bit loses one.
        let last_byte = bit / 8 == good.len() - 1;
        prop_assert_eq!(delivered.len(), if last_byte { 1 } else { 2 });
        prop_assert_eq!(out.last(), Some(&Ok(m)));
    }
}

#[test]
fn every_flip_of_a_208_value_frame_is_refused() {
    let m = FromBoard::Frame(Frame {
        sequence: 77,
        time: 1 << 40,
        plan: 1,
        values: (0..208).map(|k| Value::new(k * 157 - 16_000)).collect(),
        ..Frame::default()
    });
    let good = framed(&m);
    for bit in 0..good.len() * 8 {
        let mut bad = good.clone();
        bad[bit / 8] ^= 1 << (bit % 8);
        let (out, _) = decoded::<MAX_FROM_BOARD_LEN>(&[&bad, &[0]]);
        assert!(!out.is_empty() && out.iter().all(Result::is_err), "bit {bit}");
    }
}

#[test]
fn an_overflow_leaves_no_phantom_behind() {
    // The tail of the long frame is itself a frame if one forgets that it is a tail.
    let mut tail = [0; 64];
    let ack = encode(&FromBoard::Ack(Command::Start), &mut tail).unwrap().to_vec();
    for filler in 1..200 {
        let mut stream = vec![0x55; filler];
        stream.extend(&ack);
        for cut in 0..=stream.len() {
            let (out, d) = decoded::<16>(&[&stream[..cut], &stream[cut..]]);
            assert!(out.iter().all(Result::is_err), "{filler} {cut}: {out:?}");
            assert_eq!(out.len(), 1);
            assert_eq!(d.counters.messages, 0);
        }
    }
}

#[test]
fn an_introduction_of_another_version_is_told_from_garbage() {
    let mut buffer = [0; 64];
    let old = encode(&(0u8, 1u8, 7u8, 0xFFFF_FFFFu32), &mut buffer).unwrap().to_vec();
    let (out, d) = decoded::<MAX_FROM_BOARD_LEN>(&[&old]);
    assert_eq!(out, [Err(FrameError::Unknown)]);
    assert_eq!(d.foreign, Some(Version { major: 1, minor: 7 }));
    for other in [vec![99u8, 1, 7], vec![0, 1]] {
        let mut buffer = [0; 64];
        let framed = match other[..] {
            [a, b, c] => encode(&(a, b, c), &mut buffer).unwrap().to_vec(),
            _ => encode(&(0u8, 1u8), &mut buffer).unwrap().to_vec(),
        };
        let (_, d) = decoded::<MAX_FROM_BOARD_LEN>(&[&framed]);
        assert_eq!(d.foreign, None);
    }
}
