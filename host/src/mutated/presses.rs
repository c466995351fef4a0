//! What presses at known places are kept in: the list of places, and the calibration made of them.

use super::{feed, utf8};
use crate::presses::file::{self, ModelKeys, Of, ToldKeys};
use crate::presses::truth;
use ::forward::file::parse_sheet;
use ::forward::{Measurement, Pair};
use inverse::learned::{Gain, Press, Setting, learn};
use inverse::reference::ToldSheet;
use std::f64::consts::TAU;
use std::fmt::Write;
use std::sync::Arc;

/// Few: every key is there, and a file is read in milliseconds.
const ELECTRODES: usize = 6;
const RADIUS_MM: f64 = 50.0;
const RUBBER: &str =
    "\n[rubber]\ndelayed_ratio = 0.3\ntau_s = 5.0\nexponent = 1.0\nunit_rise_mpa = 0.25\nforce_sd_n = 0.1\n";

/// Places by the golden angle, in an order that jumps.
fn place(k: usize) -> [f64; 2] {
    let k = (k * 17) % 24;
    let (sin, cos) = (2.399_963 * k as f64).sin_cos();
    let radius = RADIUS_MM * ((k as f64 + 0.5) / 24.0).sqrt();
    [cos * radius, sin * radius]
}

/// What a press changes: most between the electrodes that drive and those that sense, with a fixed pattern instead of noise.
fn change(m: &Measurement, [x, y]: [f64; 2], press: usize) -> f64 {
    let near = |pair: Pair| {
        let angle = TAU * (pair.plus as f64 + 0.5) / ELECTRODES as f64;
        let (sin, cos) = angle.sin_cos();
        let square = (x - 0.6 * RADIUS_MM * cos).powi(2) + (y - 0.6 * RADIUS_MM * sin).powi(2);
        (-square / (2.0 * 25.0 * 25.0)).exp()
    };
    let pattern = (press * 7919 + m.drive.plus * 104_729 + m.sense.plus * 1_299_709) as f64;
    near(m.drive) * near(m.sense) + 0.01 * pattern.sin()
}

fn measurements() -> Vec<Measurement> {
    let pair = |k: usize| Pair::new(k % ELECTRODES, (k + 1) % ELECTRODES);
    let of = |drive: usize| {
        (2..ELECTRODES - 1).map(move |k| Measurement {
            drive: pair(drive),
            sense: pair(drive + k),
        })
    };
    (0..ELECTRODES).flat_map(of).collect()
}

/// Calibrations of the same presses: with the model's row, as changes alone, and with all parts that a file may have.
fn calibrations() -> Vec<Vec<u8>> {
    let measurements = measurements();
    let presses: Vec<Press> = (0..24)
        .map(|k| Press {
            place_mm: place(k),
            change: measurements.iter().map(|m| change(m, place(k), k)).collect(),
        })
        .collect();
    let setting = Setting {
        measurements: &measurements,
        electrodes: ELECTRODES,
        turn: 1,
        extent: None,
    };
    let (learned, found) = learn(&presses, &setting, |_, _| {}).unwrap();
    let sheet = "sheet_resistance_ohm = 800.0\noutline = { kind = \"disc\", diameter_mm = 100.0 }\n[electrode_ring]\ncount = 6\n\
                 width_mm = 10.0\ncontact_mm = 1.0\n";
    let model = ModelKeys {
        error_median_mm: 1.0,
        error_95th_percentile_mm: 2.0,
        better: true,
        sheet: sheet.to_owned(),
        told: Some(ToldKeys {
            untold_median_mm: 1.5,
            untold_95th_percentile_mm: 3.0,
            moved_mm: 0.7,
            of_sheet: ToldSheet {
                first_mm: [-50.0; 2],
                step_mm: 50.0,
                columns: 3,
                bumps: 0.6,
                unknowns: (0..37).map(|k| 0.01 * f64::from(k % 5)).collect(),
                sd_mm: vec![[0.1, 0.2]; 9],
            },
        }),
    };
    let forces: Vec<_> = (0..24).map(|k| (place(k), 1.0, 5.0 + 0.1 * k as f64)).collect();
    let gain = Gain::learn(&forces).unwrap();
    let of = Of::new(Some(&parse_sheet(sheet).unwrap().0), &measurements).unwrap();
    let all = of.with_board("b", "A7");
    let kinds = [
        (Some(&model), None, Of::default(), ""),
        (None, None, Of::default(), ""),
        (None, Some(&gain), all, RUBBER),
    ];
    let text = |(model, gain, of, more): (Option<&ModelKeys>, Option<&Gain>, Of, &str)| {
        let text = file::text(&file::Taught {
            learned: &learned,
            found: &found,
            model,
            gain,
            measurements: &measurements,
            electrodes: ELECTRODES,
            difference: model.is_none(),
            of,
        });
        (text.unwrap() + more).into_bytes()
    };
    kinds.map(text).to_vec()
}

#[test]
fn mutated_calibrations_from_presses() {
    let (measurements, at) = (measurements(), place(3));
    let change: Vec<f64> = measurements.iter().map(|m| change(m, at, 99)).collect();
    let mut holed = change.clone();
    holed[5] = f64::NAN;
    feed("calibration from presses", &calibrations(), true, |bytes| {
        let Ok(calibration) = file::parse("t".to_owned(), utf8(bytes).to_owned()) else {
            return false;
        };
        assert!(calibration.error_mm.is_finite());
        let learned = &calibration.learned;
        for (change, before) in [(&change, None), (&holed, Some([10.0, -20.0]))] {
            let presence = learned.locate(change, before);
            assert!(
                presence.explained.is_finite() && presence.misfit.is_finite(),
                "{presence:?}"
            );
            for press in &presence.presses {
                let numbers = [press.place_mm, press.covariance_mm2[0], press.covariance_mm2[1]];
                let strength = [press.strength, press.strength_sd];
                assert!(
                    numbers.iter().flatten().chain(&strength).all(|v| v.is_finite()),
                    "{press:?}"
                );
                let newtons = |gain: &Arc<Gain>| gain.newtons(press.place_mm, press.strength);
                assert!(calibration.gain.as_ref().map(newtons).is_none_or(f64::is_finite));
            }
        }
        assert!(learned.resolution_mm().is_finite());
        if let Some(rubber) = &calibration.rubber {
            rubber.solid.check().unwrap();
        }
        true
    });
}

#[test]
fn mutated_lists_of_presses() {
    let mut whole = "# a robot's\nframe,before,x_mm,y_mm,force_n\n".to_owned();
    for k in 0..24 {
        let [x, y] = place(k);
        writeln!(whole, "p{k},u{k},{x:.2},{y:.2},5").unwrap();
    }
    feed("list of presses", &[whole.into_bytes()], true, |bytes| {
        let Ok(list) = truth::parse("t", utf8(bytes)) else {
            return false;
        };
        assert!(
            list.iter()
                .all(|p| p.place_mm.iter().all(|v| v.is_finite()) && p.line > 0)
        );
        true
    });
}
