//! The bytes of protocol version 1. If one of these tests fails, boards in the field no longer understand this program:
//! undo the change, or make it a new major version.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

use protocol::{
    BoardError, Command, Counters, Flags, Frame, FrameError, FromBoard, FrontEndFault, Hello, Limits,
    MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN, MAX_VALUES, Pair, Plan, PlanError, Sampling, Slot, ToBoard, Value, Version,
    encode, text,
};

fn hex<M: serde::Serialize>(message: &M) -> String {
    encode(message, &mut [0; MAX_FROM_BOARD_LEN])
        .unwrap()
        .iter()
        .map(|b| format!("{b:02x}"))
        .collect()
}

fn hello() -> Hello {
    Hello {
        version: Version { major: 1, minor: 0 },
        firmware: text("0.1"),
        board: text("b"),
        serial: text("7"),
        electrodes: 16,
        samples_per_period: 16,
        timer_hz: 84_000_000,
        ticks_per_sample: 1425,
        adc_bits: 12,
        adc_span_uv: 3_300_000,
        excitation_uv: 2_250_000,
        gains_milli: [21_000, 700].into_iter().collect(),
        limits: Limits {
            slots: 32,
            values: 256,
            channels: 16,
            settle_periods: 1000,
            integrate_periods: 65_535,
        },
    }
}

fn small_plan() -> Plan {
    Plan {
        id: 258,
        settle_periods: 1,
        integrate_periods: 2,
        sampling: Sampling::Simultaneous,
        quadrature: true,
        slots: [Slot {
            drive: Pair { plus: 0, minus: 1 },
            sense_step: 1,
            sense: 0x7FFC,
            gain: 1,
        }]
        .into_iter()
        .collect(),
    }
}

#[test]
fn commands() {
    assert_eq!(hex(&ToBoard::Hello), GOLDEN[0]);
    assert_eq!(hex(&ToBoard::Start), GOLDEN[1]);
    assert_eq!(hex(&ToBoard::Stop), GOLDEN[2]);
    assert_eq!(hex(&ToBoard::SetPlan(small_plan())), GOLDEN[3]);
    assert_eq!(hex(&ToBoard::GetPlan), GOLDEN[4]);
    assert_eq!(hex(&ToBoard::GetCounters), GOLDEN[5]);
    assert_eq!(hex(&ToBoard::ResetCounters), GOLDEN[6]);
}

#[test]
fn answers() {
    let mut clipped = Flags::default();
    clipped.set(33);
    let frame = Frame {
        sequence: 300,
        time: 1 << 33,
        plan: 2,
        clipped,
        values: [1, -1, 32_760].map(Value::new).into_iter().collect(),
        quadrature: [0, 256, -32_768].map(Value::new).into_iter().collect(),
    };
    let counters = Counters {
        frames: 1,
        dropped: 2,
        overruns: 3,
        front_end_faults: 4,
        clipped: 5,
        commands: 6,
        refused: 7,
        receive_errors: 8,
        transmit_errors: u32::MAX,
    };
    let refused = PlanError::Electrode {
        slot: 3,
        electrode: 16,
        count: 16,
    };
    for (message, golden) in [
        (FromBoard::Hello(hello()), GOLDEN[7]),
        (FromBoard::Plan(small_plan()), GOLDEN[8]),
        (FromBoard::Frame(frame), GOLDEN[9]),
        (FromBoard::Counters(counters), GOLDEN[10]),
        (FromBoard::Ack(Command::ResetCounters), GOLDEN[11]),
        (FromBoard::Error(BoardError::Plan(refused)), GOLDEN[12]),
        (FromBoard::Error(BoardError::Command(FrameError::Unknown)), GOLDEN[13]),
        (FromBoard::Error(BoardError::FrontEnd(FrontEndFault::Other)), GOLDEN[14]),
    ] {
        assert_eq!(hex(&message), golden, "{message:?}");
    }
}

#[test]
fn the_largest_messages_fit_their_buffers() {
    let mut clipped = Flags::default();
    (0..MAX_VALUES).for_each(|k| clipped.set(k));
    let values: protocol::heapless::Vec<Value, MAX_VALUES> = (0..MAX_VALUES).map(|_| Value::MAX).collect();
    let frame = FromBoard::Frame(Frame {
        sequence: u32::MAX,
        time: u64::MAX,
        plan: u16::MAX,
        clipped,
        values: values.clone(),
        quadrature: values,
    });
    let size = encode(&frame, &mut [0; MAX_FROM_BOARD_LEN]).unwrap().len();
    assert!(size <= MAX_FROM_BOARD_LEN, "{size}");
    let slot = Slot {
        drive: Pair { plus: 255, minus: 255 },
        sense_step: 255,
        sense: u32::MAX,
        gain: 255,
    };
    let plan = Plan {
        id: u16::MAX,
        settle_periods: u16::MAX,
        integrate_periods: u16::MAX,
        sampling: Sampling::Simultaneous,
        quadrature: true,
        slots: (0..32).map(|_| slot).collect(),
    };
    let command = ToBoard::SetPlan(plan);
    assert!(encode(&command, &mut [0; MAX_TO_BOARD_LEN]).is_ok());
    let long = "ffffffffffffffffffffffffffffffff";
    let mut h = hello();
    (h.firmware, h.board, h.serial) = (text(long), text(long), text(long));
    assert!(encode(&FromBoard::Hello(h), &mut [0; MAX_FROM_BOARD_LEN]).is_ok());
}

#[test]
fn a_frame_of_208_values_leaves_room_on_the_link() {
    let frame = FromBoard::Frame(Frame {
        sequence: u32::MAX,
        time: 1 << 48,
        plan: 2,
        values: (0..208).map(|_| Value::MAX).collect(),
        ..Frame::default()
    });
    let size = encode(&frame, &mut [0; MAX_FROM_BOARD_LEN]).unwrap().len();
    // 100,000 bytes a second would carry 543 bytes at 184 frames a second; a fifth is to spare.
    assert!(size <= 448, "{size}");
}

const GOLDEN: [&str; 15] = [
    "010551537d5200",
    "060152d016a000",
    "0602a62346b300",
    "0903820201020101010b0101fcff010184e64e2900",
    "06044ec4e79500",
    "06054d478c6700",
    "0606b9b4dc7400",
    "0102012d03302e3101620137101080fa8628910b0ca0b5c90190aa89010288a401bc0520800210e807ffff0362328a0900",
    "0901820201020101010b0101fcff0101861c53e600",
    "0b02ac02808080802002020402030106fffff87f03010102010680e6498ca900",
    "13030102030405060708ffffffff0f2b32a94700",
    "070402f966d05e00",
    "0b050103031010ec30699500",
    "020506040102619c00",
    "0805020207d5859d00",
];
