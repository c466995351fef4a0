//! The bytes of protocol version 2. If one of these tests fails, boards in the field no longer understand this program:
//! undo the change, or make it a new major version.

use protocol::{
    Baseline, BoardError, Check, Command, Counters, Decoder, Flags, FoldedPeriod, Frame, FrameError, FromBoard,
    FrontEndFault, Heartbeat, Hello, Limits, MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN, MAX_VALUES, Notice, Pair,
    PeriodRequest, Plan, PlanError, Refusal, ResetCause, SCHEMA, Sampling, SelfTest, Slot, Status, Stored, ToBoard,
    Value, Variance, Version, Watch, WatchNumber, Watching, encode, text,
};
use serde::{Serialize, de::DeserializeOwned};
use std::fmt::Debug;

fn hex<M: Serialize>(message: &M) -> String {
    encode(message, &mut [0; MAX_FROM_BOARD_LEN])
        .unwrap()
        .iter()
        .map(|b| format!("{b:02x}"))
        .collect()
}

fn hello() -> Hello {
    Hello {
        version: Version { major: 2, minor: 0 },
        schema: 0x0102_0304,
        firmware: text("0.1"),
        git: text("c0ffee-dirty"),
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
            settle_quarters: 1000,
            integrate_periods: 65_535,
            amplitudes: 416,
            watch_slots: 8,
            watch_values: 48,
        },
        skew_ticks: 60,
        reset: ResetCause::Watchdog,
        last_panic: text("oh"),
    }
}

fn small_plan() -> Plan {
    Plan {
        id: 258,
        settle_quarters: 1,
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

fn small_watch() -> Watch {
    Watch {
        settle_quarters: 1,
        integrate_periods: 2,
        sampling: Sampling::Simultaneous,
        rest_quarters: 300,
        learn_scans: 64,
        threshold: 1000,
        frames_between: 8,
        quiet_scans: 3,
        heartbeat_scans: 500,
        slots: small_plan().slots.iter().copied().collect(),
    }
}

fn request() -> PeriodRequest {
    PeriodRequest {
        drive: Pair { plus: 0, minus: 1 },
        sense: Pair { plus: 3, minus: 2 },
        gain: 0,
        settle_quarters: 4,
        periods: 6,
    }
}

/// Every command there is, in order.
fn commands() -> Vec<ToBoard> {
    vec![
        ToBoard::Hello,
        ToBoard::Start,
        ToBoard::Stop,
        ToBoard::SetPlan(small_plan()),
        ToBoard::GetPlan,
        ToBoard::GetCounters,
        ToBoard::ResetCounters,
        ToBoard::SetWatch(Some(small_watch())),
        ToBoard::GetWatch,
        ToBoard::TakeBaseline,
        ToBoard::GetBaseline,
        ToBoard::SelfTest,
        ToBoard::GetPeriod(request()),
        ToBoard::SetExcitation(900),
        ToBoard::SetAutostart(true),
        ToBoard::SaveSettings,
        ToBoard::ForgetSettings,
        ToBoard::GetStatus,
    ]
}

/// Every answer there is, in order; errors and acknowledgements with their last variants.
fn answers() -> Vec<FromBoard> {
    let mut clipped = Flags::default();
    clipped.set(33);
    let frame = Frame {
        sequence: 300,
        time: 1 << 33,
        plan: 2,
        clipped,
        values: [1, -1, 32_760].map(Value::new).into_iter().collect(),
        quadrature: [0, 256, -32_768].map(Value::new).into_iter().collect(),
        noise: [Variance::new(0), Variance::new(256)].into_iter().collect(),
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
        watch_scans: 9,
        wakes: 10,
    };
    let refused = PlanError::Electrode {
        slot: 3,
        electrode: 16,
        count: 16,
    };
    let quadrature = PlanError::Quadrature { needed: 448, most: 416 };
    let last_plan_error = PlanError::NotWired {
        slot: 3,
        step: 2,
        gain: 1,
    };
    let last_number = Refusal::Watch {
        what: WatchNumber::HeartbeatScans,
        least: 1,
    };
    let error = |e| FromBoard::Error(e);
    vec![
        FromBoard::Hello(hello()),
        FromBoard::Plan(small_plan()),
        FromBoard::Frame(frame),
        FromBoard::Counters(counters),
        FromBoard::Ack(Command::ForgetSettings),
        error(BoardError::Command(FrameError::Unknown)),
        error(BoardError::Plan(refused)),
        error(BoardError::Plan(quadrature)),
        error(BoardError::Plan(last_plan_error)),
        error(BoardError::FrontEnd(FrontEndFault::Source)),
        error(BoardError::Watch(PlanError::Empty)),
        error(BoardError::Period(PlanError::Empty)),
        error(BoardError::Refused(last_number)),
        error(BoardError::Refused(Refusal::Store)),
        error(BoardError::Refused(Refusal::ReadBack)),
        error(BoardError::Refused(Refusal::NoSamples)),
        FromBoard::Watch(Some(small_watch())),
        FromBoard::Heartbeat(Heartbeat {
            time: 1 << 20,
            state: Watching::Awake,
            level: 256,
            scans: 7,
        }),
        FromBoard::Baseline(Baseline {
            scans: 64,
            values: [5, -5].map(Value::new).into_iter().collect(),
            variance: [110, 4].into_iter().collect(),
        }),
        FromBoard::SelfTest(SelfTest {
            failed: Check::Electrodes.bit(),
            source_permille: 1001,
            offset: Value::new(-3),
            noise: Variance::new(50),
            suspect: 6,
            drive_pairs: [-9000, -9001].map(Value::new).into_iter().collect(),
            gain: 1,
            source_offset: Value::new(7),
            sense_pairs: [26000, 25999].map(Value::new).into_iter().collect(),
            bent: 4,
        }),
        FromBoard::Period(FoldedPeriod {
            request: request(),
            time: 4000,
            clipped: true,
            bins: core::array::from_fn(|k| 1000 * k as u32),
        }),
        FromBoard::Status(Status {
            running: true,
            watching: Watching::Asleep,
            autostart: true,
            excitation_permille: 900,
            stored: Stored::Unusable,
        }),
        FromBoard::Notice(Notice::PassedOver { count: 300 }),
        FromBoard::Notice(Notice::Careful {
            resets: 3,
            settings: false,
        }),
        FromBoard::Notice(Notice::Source {
            permille: 700,
            began_permille: 1000,
            right: true,
        }),
        FromBoard::Status(Status {
            stored: Stored::Unread,
            ..Status::default()
        }),
    ]
}

/// Encodes to the golden bytes, and these decode to it.
fn is_golden<M: Serialize + DeserializeOwned + PartialEq + Debug>(messages: &[M], golden: &[&str]) {
    let now: Vec<String> = messages.iter().map(hex).collect();
    assert_eq!(now, golden, "now: {now:#?}");
    for (message, golden) in messages.iter().zip(golden) {
        let bytes: Vec<u8> = (0..golden.len() / 2)
            .map(|k| u8::from_str_radix(&golden[2 * k..2 * k + 2], 16).unwrap())
            .collect();
        let mut out: Vec<M> = Vec::new();
        Decoder::<MAX_FROM_BOARD_LEN>::new().push(&bytes, |m| out.push(m.unwrap()));
        assert_eq!(&out, std::slice::from_ref(message));
    }
}

#[test]
fn commands_keep_their_bytes() {
    is_golden(&commands(), &COMMANDS);
}

#[test]
fn answers_keep_their_bytes() {
    is_golden(&answers(), &ANSWERS);
}

#[test]
fn the_hash_of_all_messages_tells_that_one_was_changed() {
    // Changes whenever a message gains a field or a variant, which is right as long as it is appended: then write the new
    // number here, and a higher minor version where the old one was released.
    assert_eq!(format!("{SCHEMA:08x}"), "1b83f7e6");
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
        noise: (0..32).map(|_| Variance::new(u32::MAX)).collect(),
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
        settle_quarters: u16::MAX,
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
        noise: (0..16).map(|_| Variance::new(u32::MAX)).collect(),
        ..Frame::default()
    });
    let size = encode(&frame, &mut [0; MAX_FROM_BOARD_LEN]).unwrap().len();
    // 100,000 bytes a second carry 542 bytes at 184.2 frames a second; a seventh is to spare.
    assert!(size <= 464, "{size}");
}

const COMMANDS: [&str; 18] = [
    "010551537d5200",
    "060152d016a000",
    "0602a62346b300",
    "0903820201020101010b0101fcff010184e64e2900",
    "06044ec4e79500",
    "06054d478c6700",
    "0606b9b4dc7400",
    "100701010201ac0240e8070803f403010b0101fcff01013c56568f00",
    "06089e0ba4d800",
    "06099d88cf2a00",
    "060a697b9f3900",
    "060b6af8f4cb00",
    "020c04010302070406654a419f00",
    "080d84071554290200",
    "070e015b66d1f700",
    "060f756f6e0c00",
    "06103e94234200",
    "06113d1748b000",
];

const ANSWERS: [&str; 26] = [
    "010202478486880803302e310c6330666665652d646972747901620137101080fa8628910b0ca0b5c90190aa89010288a401bc0520800210e807ffff03a00308303c05026f68836d148e00",
    "0901820201020101010b0101fcff0101861c53e600",
    "0b02ac02808080802002020402030106fffff87f03010102010380020640987fd3ac00",
    "15030102030405060708ffffffff0f090ae9f2951300",
    "070407e572216b00",
    "020506040102619c00",
    "0b050103031010ec30699500",
    "0c05010bc003a003acef899000",
    "0b05010c030201c36e988000",
    "080502030456ee6f00",
    "03050305873d1c6f00",
    "03050405c2f4711500",
    "0a0505020401b08ccfc800",
    "08050504aafb49c100",
    "08050505a978223300",
    "080505065d8b722000",
    "100601010201ac0240e8070803f403010b0101fcff010188b843d300",
    "0d07808040038002077dceccb200",
    "05084002050afbff026e04707bc2bf00",
    "100902e907fdff2c0602d8dcd7dc01070b0290658f65049b8b820c00",
    "020a04010302060406a01f0123e807d00fb817a01f8827f02ed836c03ea846904ef855e05dc865b06d98754344580b00",
    "0c0b0102018407037715857300",
    "020c07ac02bad2ec7300",
    "040c0103053523a75400",
    "0c0c02bc05e8070193a543ef00",
    "020b010101060450380ac400",
];
