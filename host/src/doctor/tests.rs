//! What no fault of the simulated board shows: facts that are changed, each with the line that must tell it.

use super::facts::{Facts, Measured, Origin, gather};
use super::line::{Light, Line};
use super::{Examination, NAMES};
use crate::board::Connected;
use crate::files::baseline_file::{self, Stored, Subject};
use crate::simulated_skin;
use ::forward::Sheet;
use hil_sim::Preset;
use inverse::reference::baseline::Baseline;
use link::{Link, greet};
use protocol::{Command, FromBoard, ResetCause, ToBoard};
use std::path::Path;
use std::time::{Duration, SystemTime};

/// Facts of a healthy simulated board, whose source is set to so much first.
fn facts(preset: Preset, excitation_permille: u16) -> Facts {
    let sheet = Sheet::paper();
    let link = Link::open(simulated_skin::bench(&sheet, preset, &[], None).unwrap()).unwrap();
    let hello = greet(&link).unwrap();
    let set = ToBoard::SetExcitation(excitation_permille);
    link.ask("its amplitude", set, Duration::from_secs(60), |m| {
        (m == FromBoard::Ack(Command::SetExcitation)).then_some(())
    })
    .unwrap();
    let source = "simulated".to_owned();
    gather(
        Connected { link, hello, source },
        Origin::Simulated,
        sheet,
        &[],
        1.0,
        None,
    )
}

fn line(facts: &Facts, state: Option<&Path>, name: &str) -> Line {
    let lines = Examination::of(facts, state).lines;
    lines.into_iter().find(|l| l.name == name).unwrap()
}

/// Changes every frame, and what follows from the frames.
fn change(facts: &mut Facts, mut how: impl FnMut(usize, usize, &mut f64)) {
    let measured: &mut Measured = facts.measured.as_mut().unwrap();
    for (frame, values) in measured.frames.iter_mut().map(|f| &mut f.values_v).enumerate() {
        values.iter_mut().enumerate().for_each(|(k, v)| how(frame, k, v));
    }
    let frames: Vec<&[f64]> = measured.frames.iter().map(|f| f.values_v.as_slice()).collect();
    measured.baseline = Baseline::plain(measured.pattern.len(), &frames);
}

/// Whether each value is sensed between electrodes 4 and 5.
fn sensed_there(facts: &Facts) -> Vec<bool> {
    let pattern = &facts.measured.as_ref().unwrap().pattern;
    let there = pattern.measurements().iter();
    there
        .map(|m| m.sense.plus.max(m.sense.minus) == 4 && m.sense.plus.min(m.sense.minus) == 3)
        .collect()
}

#[test]
fn there_is_a_line_for_everything_and_each_says_what_to_do_or_why_nothing_is_known() {
    let healthy = facts(Preset::DrawnBoard, 1000);
    let lines = Examination::of(&healthy, None).lines;
    assert_eq!(lines.iter().map(|l| l.name).collect::<Vec<_>>(), NAMES);
    for line in &lines {
        let has_advice = matches!(line.light, Light::Look | Light::Bad);
        assert_eq!(
            (line.cause.is_some(), line.advice.is_some()),
            (has_advice, has_advice),
            "{line:?}"
        );
        assert!(!line.text.is_empty());
    }
}

#[test]
fn a_channel_that_is_noisy_stuck_or_turned_is_named() {
    let signal_v = |f: &Facts| {
        let mut values: Vec<f64> = f
            .measured
            .as_ref()
            .unwrap()
            .baseline
            .values_v
            .iter()
            .map(|v| v.abs())
            .collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    for (part, light) in [(0.001, Light::Ok), (0.02, Light::Look), (0.2, Light::Bad)] {
        let mut noisy = facts(Preset::SixteenChannels, 1000);
        let (there, signal_v) = (sensed_there(&noisy), signal_v(&noisy));
        // Golden ratio steps: even, and without a jump that stays.
        change(&mut noisy, |frame, k, v| {
            let random = ((frame * 208 + k) as f64 * 0.618_033_988_75).fract() - 0.5;
            *v += if there[k] {
                12f64.sqrt() * part * signal_v * random
            } else {
                0.0
            };
        });
        let line = line(&noisy, None, "noise");
        assert_eq!(line.light, light, "{part}: {line:?}");
        let electrodes: &[usize] = if light == Light::Ok { &[] } else { &[4, 5] };
        assert_eq!(line.electrodes, electrodes, "{part}");
    }
    let mut stuck = facts(Preset::SixteenChannels, 1000);
    let there = sensed_there(&stuck);
    let first = stuck.measured.as_ref().unwrap().frames[0].values_v.clone();
    let one = there.iter().position(|there| *there);
    // A value that is missing in a frame does not hide it.
    change(&mut stuck, |frame, k, v| match (there[k], frame) {
        (true, 3) if Some(k) == one => *v = f64::NAN,
        (true, _) => *v = first[k],
        _ => {}
    });
    let stuck = line(&stuck, None, "noise");
    assert!(stuck.light == Light::Bad && stuck.electrodes == [4, 5], "{stuck:?}");

    // Of a converter whose steps are far larger than the noise some channels stay by chance.
    let mut coarse = facts(Preset::SixteenChannels, 1000);
    let step_v = 50.0 * coarse.measured.as_ref().unwrap().baseline.noise_v;
    change(&mut coarse, |_, _, v| *v = step_v * (*v / step_v).round());
    let coarse = line(&coarse, None, "noise");
    assert!(coarse.light == Light::Ok && coarse.electrodes.is_empty(), "{coarse:?}");

    let mut turned = facts(Preset::SixteenChannels, 1000);
    change(&mut turned, |_, k, v| *v = if there[k] { -*v } else { *v });
    let sheet = line(&turned, None, "sheet");
    assert!(sheet.light == Light::Look && sheet.electrodes == [4, 5], "{sheet:?}");
    let mut all = facts(Preset::SixteenChannels, 1000);
    change(&mut all, |_, _, v| *v = -*v);
    let sheet = line(&all, None, "sheet");
    assert!(
        sheet.light == Light::Look && sheet.text.contains("all values have the wrong sign"),
        "{sheet:?}"
    );
}

#[test]
fn values_that_change_while_they_are_measured_are_no_noise() {
    let mut touched = facts(Preset::SixteenChannels, 1000);
    let half = touched.measured.as_ref().unwrap().frames.len() / 2;
    change(&mut touched, |frame, _, v| *v *= if frame < half { 1.0 } else { 1.3 });
    let line = line(&touched, None, "noise");
    assert!(line.light == Light::Bad && line.text.contains("changed by"), "{line:?}");
}

#[test]
fn values_that_are_not_reciprocal_are_those_of_no_sheet() {
    let mut odd = facts(Preset::DrawnBoard, 1000);
    change(&mut odd, |_, k, v| *v *= if k % 2 == 0 { 1.2 } else { 0.9 });
    let line = line(&odd, None, "reciprocity");
    assert!(
        line.light == Light::Bad && line.figures["reciprocity"] > 0.02,
        "{line:?}"
    );
}

#[test]
fn a_source_that_is_set_low_is_said() {
    let low = line(&facts(Preset::DrawnBoard, 100), None, "source");
    assert!(
        low.light == Light::Look && (low.figures["source_part"] - 0.1).abs() < 0.01,
        "{low:?}"
    );
    assert_eq!(line(&facts(Preset::DrawnBoard, 500), None, "source").light, Light::Ok);
}

#[test]
fn why_a_board_started_and_what_it_speaks_is_looked_at() {
    let mut board = facts(Preset::DrawnBoard, 1000);
    for (reset, light) in [
        (ResetCause::PowerOn, Light::Ok),
        (ResetCause::BrownOut, Light::Look),
        (ResetCause::Watchdog, Light::Look),
        (ResetCause::Panic, Light::Look),
    ] {
        board.hello.as_mut().unwrap().reset = reset;
        assert_eq!(line(&board, None, "uptime").light, light, "{reset:?}");
    }
    let hello = board.hello.as_mut().unwrap();
    (hello.reset, hello.last_panic) = (ResetCause::Pin, protocol::text("no clock"));
    let said = line(&board, None, "uptime");
    assert!(said.light == Light::Look && said.text.contains("no clock"), "{said:?}");
    assert_eq!(line(&board, None, "firmware").light, Light::Ok);
    board.hello.as_mut().unwrap().schema ^= 1;
    assert_eq!(line(&board, None, "firmware").light, Light::Look);
}

#[test]
fn the_stored_baseline_is_missing_old_of_another_plan_or_differs() {
    let board = facts(Preset::DrawnBoard, 1000);
    let folder = tempfile::tempdir().unwrap();
    let state = Some(folder.path());
    let baseline = |facts: &Facts| line(facts, state, "baseline");
    assert_eq!(line(&board, None, "baseline").light, Light::NotKnown);
    let missing = baseline(&board);
    assert!(
        missing.light == Light::Look && missing.text.contains("none"),
        "{missing:?}"
    );

    let measured = board.measured.as_ref().unwrap();
    let subject = Subject::new(board.hello.as_ref().unwrap(), &board.sheet, &measured.plan);
    let file = baseline_file::path(folder.path(), &subject);
    let store = |hours: u64, factor: f64| {
        let mut baseline = measured.baseline.clone();
        // The common gain is no difference: every other value.
        baseline.values_v.iter_mut().step_by(2).for_each(|v| *v *= factor);
        let taken = SystemTime::now() - Duration::from_secs(3600 * hours);
        baseline_file::write(&file, &subject, &Stored { baseline, taken }).unwrap();
    };
    store(1, 1.0);
    let fresh = baseline(&board);
    assert!(
        fresh.light == Light::Ok && fresh.figures["baseline_age_s"] >= 3600.0,
        "{fresh:?}"
    );
    store(24, 1.0);
    let old = baseline(&board);
    assert!(old.light == Light::Look && old.text.contains("24 h old"), "{old:?}");
    store(1, 1.05);
    let differs = baseline(&board);
    assert!(
        differs.light == Light::Look && differs.text.contains("differs"),
        "{differs:?}"
    );
    std::fs::write(&file, "no baseline").unwrap();
    assert_eq!(baseline(&board).light, Light::Look);
}

#[test]
fn a_board_that_measures_nothing_is_unfit() {
    let mut board = facts(Preset::DrawnBoard, 1000);
    board.measured = Err("the board does not measure: the source is out of phase".to_owned());
    board.self_test = Err("no answer".to_owned());
    let examination = Examination::of(&board, None);
    assert!(!examination.fit);
    assert_eq!(examination.named(Light::Bad), ["frames"]);
}
