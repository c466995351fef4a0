//! A scene that waits at its beginning while the board runs.

use crate::common::{disc, framed};
use forward::{ElectrodeMatrix, ForwardError, Sheet};
use hil_sim::{Fault, FixedSheet, Pace, SceneFile, SheetModel, SimBoard, SimConfig, SimPort};
use protocol::ToBoard;
use std::io::{ErrorKind, Read, Write};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// A sheet that notes when it is looked at.
struct Noting(FixedSheet, Arc<Mutex<Vec<f64>>>);

impl SheetModel for Noting {
    fn electrode_matrix(&mut self, t_s: f64) -> Result<&ElectrodeMatrix, ForwardError> {
        self.1.lock().unwrap().push(t_s);
        self.0.electrode_matrix(t_s)
    }
}

fn faults(list: &[&str]) -> SimConfig {
    SimConfig {
        faults: list.iter().map(|f| f.parse::<Fault>().unwrap()).collect(),
        ..SimConfig::default()
    }
}

/// The noise depends on the board's time alone, hence the bytes can be compared.
#[test]
fn a_held_scene_is_the_sheet_at_its_first_instant_byte_for_byte() {
    let mut file = SceneFile::demo(Sheet::paper());
    let bytes = |board: SimBoard<_>| {
        let mut board = board;
        board.receive(&framed(&ToBoard::Start));
        board.run(2.5)
    };
    let held = bytes(file.board().unwrap().holding_scene());
    let running = bytes(file.board().unwrap());
    file.scene.touches.clear();
    let untouched = bytes(file.board().unwrap());
    assert!(held == untouched, "the held scene is not the untouched sheet");
    assert!(running != untouched, "the scene has no touch in this time");
}

#[test]
fn the_sheets_time_is_0_until_the_scene_begins_and_counts_from_there() {
    let looks = Arc::new(Mutex::new(Vec::new()));
    let sheet = Noting(FixedSheet(disc(16)), Arc::clone(&looks));
    let config = SimConfig {
        look_samples: Some(100),
        ..faults(&["board_reset@0.25+0.1"])
    };
    let mut board = SimBoard::new(config, sheet).unwrap().holding_scene();
    board.receive(&framed(&ToBoard::Start));
    board.run(1.7);
    assert!(looks.lock().unwrap().len() > 100);
    assert!(looks.lock().unwrap().iter().all(|t| *t == 0.0));
    assert_eq!(board.scene_began_s(), None);

    board.begin_scene();
    let began_s = board.scene_began_s().unwrap();
    assert_eq!(began_s, board.now_s());
    looks.lock().unwrap().clear();
    // Over a reset of the board: the scene does not begin again.
    board.run(0.2);
    board.begin_scene();
    board.run(0.3);
    board.receive(&framed(&ToBoard::Start));
    board.run(0.3);
    let looks = looks.lock().unwrap();
    let end_s = board.now_s() - began_s;
    assert!(looks.is_sorted() && *looks.last().unwrap() <= end_s, "{looks:?}");
    assert!(*looks.last().unwrap() > end_s - 0.01 && *looks.first().unwrap() < 0.01);
    assert_eq!(board.scene_began_s(), Some(began_s));
}

#[test]
fn faults_at_0_are_there_while_the_scene_is_held_and_later_ones_count_from_its_beginning() {
    let config = faults(&["electrode_open:3@0", "cable_pulled@0.5+0.2"]);
    let bytes = |config: SimConfig| {
        let mut board = SimBoard::new(config, FixedSheet(disc(16))).unwrap().holding_scene();
        board.receive(&framed(&ToBoard::Start));
        let bytes = board.run(1.0);
        (board, bytes)
    };
    let (mut board, held) = bytes(config);
    assert!(held == bytes(faults(&["electrode_open:3@0"])).1);
    assert!(held != bytes(SimConfig::default()).1);

    board.begin_scene();
    let mut plugged = |duration_s| {
        board.run(duration_s);
        board.plugged()
    };
    assert_eq!([0.45, 0.1, 0.2].map(&mut plugged), [Some(0), None, Some(1)]);
}

#[test]
fn a_scene_that_begins_at_power_up_gives_the_bytes_of_one_that_is_not_held() {
    let bytes = |board: SimBoard<FixedSheet>| {
        let mut board = board;
        board.receive(&framed(&ToBoard::Start));
        board.run(1.0)
    };
    let board = || SimBoard::new(faults(&["bytes_flipped:0.001@0.3+0.3"]), FixedSheet(disc(16))).unwrap();
    let mut held = board().holding_scene();
    held.begin_scene();
    assert!(bytes(held) == bytes(board()));
}

#[test]
fn a_port_begins_the_scene_of_its_board() {
    for pace in [Pace::Unpaced, Pace::RealTime] {
        let board = SimBoard::new(SimConfig::default(), FixedSheet(disc(16))).unwrap();
        let port = SimPort::new(board.holding_scene(), pace).unwrap();
        let mut reader = port.clone();
        reader.write_all(&framed(&ToBoard::Start)).unwrap();
        let mut read = || match reader.read(&mut [0; 4096]) {
            Ok(_) => {}
            Err(e) => assert!(matches!(e.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted)),
        };
        (0..20).for_each(|_| read());
        assert_eq!(port.scene_began_s(), None);
        port.begin_scene();
        // Only for a port that hangs.
        let start = Instant::now();
        while port.scene_began_s().is_none() {
            assert!(start.elapsed() < Duration::from_secs(120), "{pace:?}");
            read();
        }
        assert!(port.scene_began_s() > Some(0.0), "{pace:?}");
    }
}
