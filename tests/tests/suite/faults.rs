//! The host against the simulated board's faults: of the line, of the cable, of the board, of electrodes and converter.

use forward::{Drive, Model, ModelOptions, Pattern, Sheet};
use hil_sim::{Electronics, Pace, Rubber, Scene, SimBoard, SimConfig, SimPort, Touch};
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::reference::imager::Imager;
use inverse::touches::touch::Touch as Found;
use link::plans::adjacent_plan;
use link::{LinkError, MeasuredFrame, Session};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// How long a frame is waited for before the board is reminded; a slow machine only takes longer.
const WAIT: Duration = Duration::from_millis(200);

fn board(electronics: Electronics, touches: Vec<Touch>, faults: &[&str]) -> SimBoard<Rubber> {
    static MODEL: OnceLock<Arc<Model>> = OnceLock::new();
    let model = MODEL.get_or_init(|| Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap()));
    let scene = Scene {
        touches,
        ..Scene::empty()
    };
    let config = SimConfig {
        electronics,
        faults: faults.iter().map(|text| text.parse().unwrap()).collect(),
        ..SimConfig::default()
    };
    SimBoard::new(config, Rubber::on_model(Arc::clone(model), scene).unwrap()).unwrap()
}

fn quiet() -> Electronics {
    Electronics {
        noise_codes: 0.0,
        ..Electronics::default()
    }
}

fn port(faults: &[&str]) -> SimPort {
    SimPort::new(board(Electronics::default(), vec![], faults), Pace::Unpaced).unwrap()
}

fn session(faults: &[&str]) -> Session {
    Session::start(Box::new(port(faults)), adjacent_plan).unwrap()
}

/// Frames until the board's time, or what ended the session.
fn frames(session: &Session, until_s: f64) -> Result<Vec<MeasuredFrame>, LinkError> {
    let mut out: Vec<MeasuredFrame> = Vec::new();
    while out.last().is_none_or(|f| f.time_s < until_s) {
        if let Some(frame) = session.frame(WAIT)? {
            out.push(frame);
        }
    }
    Ok(out)
}

/// A bridge to a port, one connection at a time; its address.
#[cfg(target_os = "linux")]
fn bridge(path: &str) -> String {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp://{}", listener.local_addr().unwrap());
    let path = path.to_owned();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let mut serial = std::fs::OpenOptions::new().read(true).write(true).open(&path).unwrap();
            let (mut back, mut from_board) = (stream.try_clone().unwrap(), serial.try_clone().unwrap());
            let out = std::thread::spawn(move || std::io::copy(&mut from_board, &mut back));
            // Until the client closes it; the board's next byte ends the way back.
            let _ = std::io::copy(&mut stream, &mut serial);
            let _ = stream.shutdown(std::net::Shutdown::Both);
            let _ = out.join();
        }
    });
    address
}

#[cfg(target_os = "linux")]
#[test]
fn a_session_over_a_pseudo_terminal_gets_what_one_over_the_simulated_port_gets() {
    use hil_sim::{Pty, PtyOptions};
    use link::{greet, ports};

    // Without noise all frames of a sheet that nobody touches are the same, whenever they are measured.
    let direct = SimPort::new(board(quiet(), vec![], &[]), Pace::Unpaced).unwrap();
    let direct = Session::start(Box::new(direct), adjacent_plan).unwrap();
    let expected = direct.frame(WAIT).unwrap().unwrap();
    let pty = Pty::start(board(quiet(), vec![], &[]), PtyOptions::default()).unwrap();
    let path = pty.path().unwrap().to_string_lossy().into_owned();
    let mut last = None;
    // The last three times through a bridge.
    let bridged = bridge(&path);
    for address in [&path, &path, &path, &bridged, &bridged, &bridged] {
        let session = Session::start(ports::open(address).unwrap(), adjacent_plan).unwrap();
        assert_eq!(session.hello(), direct.hello());
        assert_eq!(session.plan(), direct.plan());
        for frame in frames(&session, 0.0)
            .unwrap()
            .into_iter()
            .chain(session.frame(WAIT).unwrap())
        {
            assert_eq!(frame.values_v, expected.values_v);
            assert!(last < Some(frame.time_s));
            last = Some(frame.time_s);
        }
        // Dropped in mid-stream, with a frame half read: the next one begins anew.
    }
    // One program at a time, as on any serial port; and a break is taken and does no harm.
    let held = serialport::new(&path, ports::BAUD)
        .timeout(Duration::from_millis(20))
        .open()
        .unwrap();
    held.set_break().unwrap();
    held.clear_break().unwrap();
    let error = ports::open(&path).err().unwrap();
    assert!(error.contains("another program holds the port"), "{error}");
    drop(held);
    let link = link::Link::open(ports::open(&path).unwrap()).unwrap();
    assert_eq!(&greet(&link).unwrap(), direct.hello());
}

#[test]
fn damage_on_the_line_costs_frames_is_counted_and_never_makes_a_wrong_one() {
    // Without noise every frame has the same values.
    let quiet = |faults: &[&str]| {
        let board = board(quiet(), vec![], faults);
        Session::start(Box::new(SimPort::new(board, Pace::Unpaced).unwrap()), adjacent_plan).unwrap()
    };
    let undamaged = quiet(&[]).frame(WAIT).unwrap().unwrap();
    for fault in ["bytes_lost", "bytes_flipped", "bytes_doubled"] {
        // From 1 s on one byte in a thousand: four in ten of the frames, of 451 bytes each.
        let session = quiet(&[&format!("{fault}:0.001@1+2")]);
        let seen = frames(&session, 4.0).unwrap();
        let counters = session.link().counters();
        assert!((10..50).contains(&counters.lost_frames), "{fault}: {counters:?}");
        let damaged = counters.decoder;
        assert!(
            damaged.crc + damaged.malformed + damaged.overflow >= 5,
            "{fault}: {counters:?}"
        );
        // After it all come.
        let after: Vec<_> = seen.iter().filter(|f| f.time_s > 3.1).collect();
        assert!(
            after.len() > 20 && after.windows(2).all(|w| w[1].sequence == w[0].sequence + 1),
            "{fault}"
        );
        // What came is what was measured.
        assert!(seen.iter().all(|f| f.values_v == undamaged.values_v), "{fault}");
    }
}

#[test]
fn a_break_is_counted_and_over_with_the_next_frame() {
    let session = session(&["line_break@1+0.2"]);
    let seen = frames(&session, 2.0).unwrap();
    let lost = session.link().counters().lost_frames;
    // A fifth of a second of 33 frames a second, and the one that was on its way.
    assert!((6..=9).contains(&lost), "{lost}");
    assert!(seen.iter().all(|f| f.values_v.iter().all(|v| *v > 0.0)));
}

#[test]
fn a_pulled_cable_is_said_and_a_new_session_goes_on() {
    let first = port(&["cable_pulled@1+0.5"]);
    let session = Session::start(Box::new(first.clone()), adjacent_plan).unwrap();
    let error = frames(&session, 10.0).unwrap_err();
    assert!(matches!(error, LinkError::Lost(_)), "{error}");
    drop(session);
    let again = loop {
        if let Ok(port) = first.reopen() {
            break port;
        }
    };
    let session = Session::start(Box::new(again), adjacent_plan).unwrap();
    let first_s = frames(&session, 0.0).unwrap()[0].time_s;
    assert!(first_s > 1.4, "{first_s}");
    assert!(frames(&session, first_s + 0.5).unwrap().len() > 14);
}

#[test]
fn a_board_that_is_reset_is_started_again() {
    for fault in ["board_reset@1", "board_reset@1+0.3"] {
        let session = session(&[fault]);
        let mut seen = frames(&session, 0.9).unwrap();
        // Its time begins anew.
        while seen.windows(2).all(|w| w[1].time_s > w[0].time_s) {
            seen.extend(session.frame(WAIT).unwrap());
        }
        seen.extend(frames(&session, 0.5).unwrap());
        let restart = seen.windows(2).position(|w| w[1].time_s < w[0].time_s).unwrap() + 1;
        assert!(seen[restart].sequence < 10 && seen.len() - restart > 5);
        assert!(session.link().counters().lost_frames < 50);
        assert!(seen.iter().all(|f| f.values_v.len() == 208));
    }
}

#[test]
fn overruns_of_the_converter_cost_frames_and_nothing_else() {
    let session = session(&["converter_overrun:0.002@0.5"]);
    let seen = frames(&session, 3.0).unwrap();
    // A frame that lost a sample is given up where it is, and the next begun: 82 of 98 to be expected undisturbed.
    let late = seen.windows(2).filter(|w| w[1].time_s - w[0].time_s > 0.031).count();
    assert!((4..40).contains(&late) && seen.len() > 60, "{late} of {}", seen.len());
    assert!(seen.iter().all(|f| f.values_v.iter().all(|v| *v > 0.0)));
}

/// What the live picture makes of a fault that comes at 2 s, after the baseline: how many values it believes at least, and
/// the frames with touches in them.
struct Seen {
    used: usize,
    pictures: usize,
    touched: Vec<Vec<Found>>,
    ended: Option<LinkError>,
}

fn live(touches: Vec<Touch>, faults: &[&str]) -> Seen {
    static IMAGER: OnceLock<Arc<Imager>> = OnceLock::new();
    let port = SimPort::new(board(Electronics::default(), touches, faults), Pace::Unpaced).unwrap();
    let session = Session::start(Box::new(port), adjacent_plan).unwrap();
    let imager = IMAGER.get_or_init(|| {
        Arc::new(
            Imager::new(
                &Sheet::paper(),
                Drive::PAPER,
                Pattern::from_pairs(session.electrodes(), session.measurements()).unwrap(),
                5.0,
            )
            .unwrap(),
        )
    });
    let mut live = Live::new(Arc::clone(imager), LiveOptions::default());
    let mut seen = Seen {
        used: 208,
        pictures: 0,
        touched: Vec::new(),
        ended: None,
    };
    loop {
        match session.frame(WAIT) {
            Ok(None) => {}
            Ok(Some(frame)) => {
                if frame.time_s > 2.4 {
                    return seen;
                }
                if let LiveFrame::Picture(result) = live.frame(frame.time_s, &frame.values_v).unwrap()
                    && frame.time_s > 2.05
                {
                    seen.pictures += 1;
                    seen.used = seen.used.min(result.used);
                    if !result.touches.is_empty() {
                        seen.touched.push(result.touches.clone());
                    }
                }
            }
            Err(e) => {
                seen.ended = Some(e);
                return seen;
            }
        }
    }
}

/// A finger from 1.5 s on, after the baseline.
fn finger() -> Touch {
    Touch::finger(&[(1.7, 20.0, -30.0), (9.0, 20.0, -30.0)], 20.0, 0.2)
}

#[test]
fn an_open_electrode_and_a_saturated_channel_are_left_out_and_the_finger_stays_where_it_is() {
    // An electrode is in three drives and three sense pairs of each: 52 of 208 values with all that are reciprocal to them.
    for (fault, used) in [("electrode_open:6@2", 156), ("saturation:7@2", 195)] {
        let seen = live(vec![], &[fault]);
        assert_eq!((seen.used, seen.touched.len()), (used, 0), "{fault}");
        let seen = live(vec![finger()], &[fault]);
        assert!(seen.ended.is_none() && seen.pictures > 8);
        assert_eq!((seen.used, seen.touched.len()), (used, seen.pictures), "{fault}");
        for touches in seen.touched {
            let off_mm = (touches[0].x_mm - 20.0).hypot(touches[0].y_mm + 30.0);
            assert!(touches.len() == 1 && off_mm < 8.0, "{fault}: {touches:?}");
        }
    }
}

#[test]
fn where_every_value_clips_nothing_is_drawn() {
    for fault in ["saturation@2", "adc_stuck:4095@2"] {
        let seen = live(vec![finger()], &[fault]);
        assert!(seen.ended.is_none() && seen.pictures > 8);
        assert_eq!((seen.used, seen.touched.len()), (0, 0), "{fault}");
    }
}
