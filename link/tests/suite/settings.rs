//! Settings of a simulated board, through the link. Without pace, so that a slow machine only takes longer.

use forward::ElectrodeMatrix;
use hil_sim::{FixedSheet, Pace, SimBoard, SimConfig, SimPort};
use link::settings::{Change, change, learn, read, store};
use link::{Link, LinkError};
use link::{Session, greet};
use nalgebra::DMatrix;
use protocol::{Plan, Status, Stored, Watch, Watching};
use std::time::Duration;

fn board() -> SimPort {
    let matrix = DMatrix::from_fn(16, 16, |i, j| {
        let half = std::f64::consts::PI * (i as f64 - j as f64) / 16.0;
        let distance_mm = if i == j { 2.5 } else { 195.0 * half.sin().abs() };
        -1000.0 / std::f64::consts::PI * distance_mm.ln()
    });
    let sheet = FixedSheet(ElectrodeMatrix::from_potentials(matrix));
    SimPort::new(SimBoard::new(SimConfig::default(), sheet).unwrap(), Pace::Unpaced).unwrap()
}

fn everything() -> Change {
    Change {
        plan: Some(Plan::fastest()),
        watch: Some(Some(Watch::sequential())),
        excitation_permille: Some(900),
        autostart: Some(true),
    }
}

#[test]
fn what_is_set_is_read_back_stored_and_forgotten() {
    let port = board();
    let link = Link::open(Box::new(port.clone())).unwrap();
    greet(&link).unwrap();
    let before = read(&link).unwrap();
    assert_eq!((before.plan, before.watch), (Plan::fast(), None));
    change(&link, &everything()).unwrap();
    store(&link, true).unwrap();
    let after = read(&link).unwrap();
    assert_eq!((after.plan, after.watch), (Plan::fastest(), Some(Watch::sequential())));
    let status = Status {
        running: false,
        watching: Watching::Off,
        autostart: true,
        excitation_permille: 900,
        stored: Stored::InForce,
    };
    assert_eq!(after.status, status);
    // Nothing to change changes nothing.
    change(&link, &Change::default()).unwrap();
    assert_eq!(read(&link).unwrap().status, status);
    store(&link, false).unwrap();
    assert_eq!(read(&link).unwrap().status.stored, Stored::Nothing);
}

#[test]
fn a_board_that_measures_stores_too_and_goes_on() {
    let port = board();
    let session = Session::start(Box::new(port.clone()), |_| Ok(Plan::fast())).unwrap();
    store(session.link(), true).unwrap();
    let status = read(session.link()).unwrap().status;
    assert!(status.running && status.stored == Stored::InForce, "{status:?}");
    assert!(session.frame(Duration::from_secs(60)).unwrap().is_some());
}

#[test]
fn a_link_stops_the_board_unless_it_is_left_running() {
    let port = board();
    for (leave, running) in [(true, true), (false, false)] {
        let session = Session::start(Box::new(port.clone()), |_| Ok(Plan::fast())).unwrap();
        drop(session);
        let link = Link::open(Box::new(port.clone())).unwrap();
        change(&link, &everything()).unwrap();
        learn(&link).unwrap();
        assert!(!read(&link).unwrap().status.running);
        // Two links on one port would take each other's bytes.
        drop(link);
        drop(Session::start(Box::new(port.clone()), |_| Ok(Plan::fast())).unwrap());
        let mut link = Link::open(Box::new(port.clone())).unwrap();
        link.send(protocol::ToBoard::Start);
        while !read(&link).unwrap().status.running {}
        if leave {
            link.leave_running();
        }
        drop(link);
        let mut link = Link::open(Box::new(port.clone())).unwrap();
        link.leave_running();
        assert_eq!(read(&link).unwrap().status.running, running);
    }
}

#[test]
fn the_watchs_baseline_is_learned_on_demand() {
    let link = Link::open(Box::new(board())).unwrap();
    greet(&link).unwrap();
    // Without a watch there is none.
    assert!(matches!(learn(&link), Err(LinkError::Refused(_))));
    let watch = Watch::paper();
    let with_watch = Change {
        watch: Some(Some(watch.clone())),
        ..Change::default()
    };
    change(&link, &with_watch).unwrap();
    let baseline = learn(&link).unwrap();
    assert_eq!((baseline.scans, baseline.values.len()), (watch.learn_scans, 12));
    assert!(!read(&link).unwrap().status.running);
}

#[test]
fn what_the_board_cannot_do_is_refused_and_nothing_changed() {
    let link = Link::open(Box::new(board())).unwrap();
    greet(&link).unwrap();
    let mut watch = Watch::paper();
    watch.slots.clear();
    let impossible = Change {
        watch: Some(Some(watch)),
        autostart: Some(true),
        ..Change::default()
    };
    assert!(matches!(change(&link, &impossible), Err(LinkError::Refused(_))));
    let settings = read(&link).unwrap();
    assert_eq!((settings.watch, settings.status.autostart), (None, false));
}

#[test]
fn a_session_that_lets_the_board_watch_hears_that_it_is_asleep() {
    let session = Session::start(Box::new(board()), |_| Ok(Plan::fast())).unwrap();
    assert_eq!(session.watching(), Watching::Off);
    assert!(session.frame(Duration::from_secs(60)).unwrap().is_some());
    session.set_watch(Some(Watch::paper()));
    while session.watching() != Watching::Asleep {
        session.frame(Duration::from_secs(60)).unwrap();
    }
    // Signs of life, no frames.
    for _ in 0..3 {
        assert_eq!(session.frame(Duration::from_secs(60)).unwrap(), None);
        assert_eq!(session.watching(), Watching::Asleep);
    }
    session.set_watch(None);
    while session.frame(Duration::from_secs(60)).unwrap().is_none() {}
}
