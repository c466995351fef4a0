//! What simulated time costs: processor time for a second of a streaming board, with and without flaws.
//!
//!     cargo run -p skin-hil-sim --example speed

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "an example")]

use forward::{ElectrodeMatrix, Sheet};
use hil_sim::{Electronics, FixedSheet, Line, Rubber, Scene, SheetModel, SimBoard, SimConfig};
use nalgebra::DMatrix;
use protocol::{MAX_TO_BOARD_LEN, ToBoard, encode};

const SECONDS: f64 = 10.0;

/// Processor time of this thread, s (Linux tells it in nanoseconds).
fn processor_s() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    let nanoseconds: f64 = text.split_whitespace().next().unwrap().parse().unwrap();
    1e-9 * nanoseconds
}

/// The least of three: others use the machine's caches too.
fn cost<S: SheetModel>(name: &str, electronics: &Electronics, sheet: impl Fn() -> S) {
    let mut least = f64::INFINITY;
    for _ in 0..3 {
        let config = SimConfig {
            electronics: electronics.clone(),
            ..SimConfig::default()
        };
        let mut board = SimBoard::new(config, sheet()).unwrap();
        board.receive(encode(&ToBoard::Start, &mut [0; MAX_TO_BOARD_LEN]).unwrap());
        let start_s = processor_s();
        let bytes = board.run(SECONDS).len();
        assert!(bytes as f64 > 40e3 * SECONDS, "{bytes}");
        least = least.min(processor_s() - start_s);
    }
    println!("{name:30} {:5.1} ms a second", 1e3 * least / SECONDS);
}

fn main() {
    let potentials = DMatrix::from_fn(16, 16, |i, j| {
        let half = std::f64::consts::PI * (i as f64 - j as f64) / 16.0;
        let distance_mm = if i == j { 2.5 } else { 195.0 * half.sin().abs() };
        -1000.0 / std::f64::consts::PI * distance_mm.ln()
    });
    let fixed = || FixedSheet(ElectrodeMatrix::from_potentials(potentials.clone()));
    let e = Electronics::default();
    cost("default electronics", &e, fixed);
    let without = |name: &str, electronics: Electronics| cost(name, &electronics, fixed);
    without("no noise", Electronics::ideal());
    without(
        "with 1/f noise",
        Electronics {
            flicker_codes: 1.0,
            ..e.clone()
        },
    );
    without(
        "with jitter",
        Electronics {
            jitter_s: 1e-8,
            ..e.clone()
        },
    );
    let interference = vec![Line::mains(50.0, 0.01)];
    without(
        "with the mains, 3 harmonics",
        Electronics {
            interference,
            ..e.clone()
        },
    );
    without(
        "with INL and DNL",
        Electronics {
            inl_codes: 1.0,
            dnl_codes: 0.5,
            ..e.clone()
        },
    );
    let sheet = Sheet::paper();
    cost("default, demo scene", &e, || {
        Rubber::new(&sheet, Scene::demo()).unwrap()
    });
}
