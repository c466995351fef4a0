//! What is broken when the baseline is taken is named, nothing else is, and touches stay where they are.

use forward::field::conductivity_of;
use forward::{DiscTouch, Drive, Model, ModelOptions, Solver};
use inverse::reference::baseline::Baseline;
use inverse::reference::electrode_fit;
use inverse::reference::imager::Imager;
use inverse::reference::inspection::{InspectionOptions, inspect};
use inverse::reference::screening::{Finding, FindingKind, ScreeningOptions, screen};
use inverse::reference::wiring::{self, WiringOptions};
use rand::Rng;
use rand::rngs::StdRng;
use std::sync::{Arc, OnceLock};
use studies::reliability::{BaselineFault, same_values, trial, wired};
use studies::{TestSheet, imager, misplaced, quantile, rng};

fn nominal() -> &'static Arc<Imager> {
    static IMAGER: OnceLock<Arc<Imager>> = OnceLock::new();
    IMAGER.get_or_init(|| imager(Drive::PAPER, 10.0).unwrap())
}

/// A sheet on a mesh of its own, its electrodes off by 0.5 mm.
fn built(seed: u64) -> Vec<f64> {
    TestSheet::new(nominal(), Drive::PAPER, 0.5, 0.3, &mut rng(seed))
        .unwrap()
        .baseline
}

fn screened(baseline: &[f64]) -> Vec<Finding> {
    let screening = screen(
        &nominal().model_v,
        &nominal().pattern,
        baseline,
        &ScreeningOptions::default(),
    );
    assert!(screening.conclusive);
    let out = screening.used.iter().filter(|used| !**used).count();
    let named: usize = screening.findings.iter().filter(|f| f.left_out).map(|f| f.values).sum();
    assert_eq!(out, named, "{:?}", screening.findings);
    screening.findings
}

fn with(fault: &BaselineFault, baseline: &[f64], rng: &mut StdRng) -> Vec<f64> {
    let mut broken = baseline.to_vec();
    fault.apply(&mut broken, &nominal().pattern, true, rng);
    broken
}

/// The electrodes that are named dead, from 0, if nothing else is named.
fn dead(findings: &[Finding]) -> Option<Vec<usize>> {
    let mut electrodes = Vec::new();
    for f in findings {
        if f.kind != FindingKind::Electrode {
            return None;
        }
        electrodes.push(f.electrodes[0] - 1);
    }
    electrodes.sort_unstable();
    Some(electrodes)
}

/// Whether the dead electrodes are named, and nothing else: no more electrodes than there are, with the same values. Of an
/// electrode between two dead ones no value tells whether it is dead.
fn explains(findings: &[Finding], truth: &[usize]) -> bool {
    dead(findings).is_some_and(|named| same_values(&nominal().pattern, &named, truth))
}

#[test]
fn dead_electrodes_are_named_wherever_they_are() {
    let mut rng = rng(91);
    let baseline = built(91);
    let mut faults: Vec<BaselineFault> = (0..16).map(|l| BaselineFault::Dead(vec![l])).collect();
    faults.extend((0..60).map(|_| BaselineFault::dead(2, 16, &mut rng)));
    faults.extend((0..60).map(|_| BaselineFault::dead(3, 16, &mut rng)));
    for fault in faults {
        let BaselineFault::Dead(truth) = &fault else { continue };
        let found = screened(&with(&fault, &baseline, &mut rng));
        assert!(explains(&found, truth), "{truth:?}: {found:?}");
        // The same without any signal, and without any value.
        for nothing in [1e-6, f64::NAN] {
            let mut broken = with(&fault, &baseline, &mut rng);
            for (v, m) in broken.iter_mut().zip(nominal().pattern.measurements()) {
                let of = [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus];
                if of.iter().any(|l| truth.contains(l)) {
                    *v *= nothing;
                }
            }
            let found = screened(&broken);
            assert!(explains(&found, truth), "{nothing} {truth:?}: {found:?}");
        }
    }
}

/// One dead electrode takes part in 52 of 208 values, two that are not neighbours in 96 (they share 8).
#[test]
fn what_is_left_out_is_counted() {
    let mut rng = rng(92);
    let baseline = built(92);
    let found = screened(&with(&BaselineFault::Dead(vec![5]), &baseline, &mut rng));
    assert_eq!(
        found[0].to_string(),
        "electrode 6 gives no signal in the baseline: 52 of 208 values are left out"
    );
    let found = screened(&with(&BaselineFault::Dead(vec![5, 13]), &baseline, &mut rng));
    assert_eq!(found.iter().map(|f| f.values).sum::<usize>(), 96);
}

#[test]
fn single_values_are_named() {
    let mut rng = rng(93);
    let baseline = built(93);
    for _ in 0..60 {
        let k = rng.random_range(0..208);
        for factor in [10.0, -1.0, 0.1] {
            let found = screened(&with(&BaselineFault::Value(k, factor), &baseline, &mut rng));
            assert_eq!((found.len(), found[0].value), (1, Some(k)), "{k} x{factor}: {found:?}");
            let said = found[0].factor.unwrap();
            assert!((said / factor - 1.0).abs() < 0.2, "{k} x{factor}: {said}");
        }
    }
    // What half the tolerance hides the fit of the electrodes finds.
    for k in [0, 6, 77, 150] {
        let broken = with(&BaselineFault::Value(k, 1.5), &baseline, &mut rng);
        assert!(screened(&broken).is_empty());
        let whole = Baseline::of_frames(208, &[&broken]);
        let found = inspect(nominal(), whole, true, &InspectionOptions::default());
        assert_eq!(
            (found.findings.len(), found.findings[0].value),
            (1, Some(k)),
            "{:?}",
            found.findings
        );
        assert!(found.baseline.values_v[k].is_nan());
        let without = electrode_fit::find(nominal(), &found.baseline.values_v).unwrap();
        assert_eq!(found.electrodes.unwrap().moved_mm, without.moved_mm);
    }
}

#[test]
fn turned_signs_are_named_and_nothing_is_left_out() {
    let mut rng = rng(94);
    let baseline = built(94);
    let mut faults = vec![(BaselineFault::AllSigns, FindingKind::AllSigns, vec![])];
    for l in 0..16 {
        let pair = vec![l.min((l + 1) % 16) + 1, l.max((l + 1) % 16) + 1];
        faults.push((BaselineFault::DriveSign(l), FindingKind::DriveSign, pair.clone()));
        faults.push((BaselineFault::SenseSign(l), FindingKind::SenseSign, pair));
    }
    for (fault, kind, pair) in faults {
        let turned = with(&fault, &baseline, &mut rng);
        let found = screened(&turned);
        assert_eq!(found.len(), 1, "{fault:?}: {found:?}");
        assert_eq!((found[0].kind, found[0].left_out), (kind, false), "{fault:?}");
        let looked = inspect(
            nominal(),
            Baseline::of_frames(208, &[&turned]),
            false,
            &InspectionOptions::default(),
        );
        assert_eq!(looked.fault, None, "{fault:?}");
        assert_eq!(found[0].electrodes, pair, "{fault:?}");
    }
    // The electrodes are found as with the right signs.
    let find = |b: &[f64]| {
        let found = inspect(
            nominal(),
            Baseline::of_frames(208, &[b]),
            true,
            &InspectionOptions::default(),
        );
        found.electrodes.unwrap().moved_mm
    };
    let broken = with(&BaselineFault::AllSigns, &baseline, &mut rng);
    assert_eq!(find(&broken), find(&baseline));
}

/// Electrodes off by 1 mm, a sheet uneven by 10 %: nothing is named, and the electrodes are those of the plain fit.
#[test]
fn nothing_is_named_on_a_sheet_without_faults() {
    for seed in 0..12 {
        let mut rng = rng(9500 + seed);
        let sheet = misplaced(1.0, 0.3, &mut rng);
        let options = ModelOptions {
            accuracy: 1e-4,
            ..ModelOptions::default()
        };
        let model = Arc::new(Model::new(&sheet, &options).unwrap());
        let mut solver = Solver::new(Arc::clone(&model)).unwrap();
        let (kx, ky) = (rng.random_range(-0.04..0.04), rng.random_range(-0.04..0.04));
        let uneven = if seed < 4 { 0.0 } else { 0.1 };
        // A plane wave of 10 % rms.
        let rise = |p: [f64; 2]| uneven * std::f64::consts::SQRT_2 * (kx * p[0] + ky * p[1]).sin();
        let matrix = solver.solve(&conductivity_of(model.mesh(), rise)).unwrap();
        let baseline = Drive::PAPER.frame_v(matrix, &nominal().pattern);
        let whole = Baseline::of_frames(208, &[&baseline]);
        let found = inspect(nominal(), whole.clone(), true, &InspectionOptions::default());
        assert!(found.conclusive && found.wiring.is_none(), "{seed}");
        assert_eq!(found.findings, [], "{seed}");
        assert_eq!(found.baseline, whole);
        // What is left over shows the unevenness, and only that.
        let least = if uneven > 0.0 { 0.01 } else { 0.0 };
        assert!((least..0.2).contains(&found.misfit), "{seed}: {}", found.misfit);
        assert!(
            uneven > 0.0 || found.misfit < 2.0 * found.expected,
            "{seed}: {}",
            found.misfit
        );
    }
}

/// Of sheets whose electrodes were found with up to three dead ones, every touch is counted and found.
#[test]
fn touches_stay_where_they_are() {
    let mut errors = Vec::new();
    let mut rng = rng(96);
    for count in [1, 1, 2, 2, 3, 3] {
        let fault = BaselineFault::dead(count, 16, &mut rng);
        let (found, score) = trial(nominal(), &fault, 0.5, 4, 960 + errors.len() as u64).unwrap();
        let BaselineFault::Dead(truth) = &fault else { continue };
        assert!(explains(&found.findings, truth), "{truth:?}: {:?}", found.findings);
        assert_eq!(score.counted, score.scenes, "{fault:?}");
        errors.extend(score.errors_mm);
    }
    assert!(quantile(&errors, 0.5) < 0.15, "{errors:?}");
    // Exchanged wires are left out where their order is not corrected.
    let (found, score) = trial(nominal(), &BaselineFault::Exchanged(4, 5), 0.5, 4, 97).unwrap();
    assert_eq!(found.wiring.unwrap().moved(), [4, 5]);
    assert_eq!(score.counted, score.scenes);
}

/// A contact of the middle, worse and very much worse.
#[test]
fn a_bad_contact_is_named_and_moves_no_electrode() {
    for times in [1.3, 2.5, 4.0, 10.0, 30.0] {
        let mut sheet = forward::Sheet::paper();
        sheet.electrodes[5].contact_mm *= times;
        let solver = Solver::new(Arc::new(Model::new(&sheet, &ModelOptions::default()).unwrap())).unwrap();
        let baseline = Drive::PAPER.frame_v(solver.electrode_matrix(), &nominal().pattern);
        let whole = Baseline::of_frames(208, &[&baseline]);
        let found = inspect(nominal(), whole, true, &InspectionOptions::default());
        let kinds: Vec<FindingKind> = found.findings.iter().map(|f| f.kind).collect();
        if times < 2.0 {
            assert_eq!(kinds, [], "{times}");
        } else {
            assert_eq!(kinds, [FindingKind::Contact], "{times}");
            assert_eq!(found.findings[0].electrodes, [6], "{times}");
            let factor = found.findings[0].factor;
            assert!(
                factor.is_none_or(|f| (f / times - 1.0).abs() < 0.2),
                "{times}: {factor:?}"
            );
        }
        assert_eq!(found.left_out().count(), 0, "{times}");
        let moved = found.electrodes.unwrap().moved_mm;
        let most = moved.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        assert!(most < 0.05, "{times}: {most}");
    }
}

/// A gain or an offset of one amplifier is told from misplaced electrodes and uneven sheets, and moves none.
#[test]
fn an_amplifier_is_named_and_moves_no_electrode() {
    let pattern = &nominal().pattern;
    let of_pair = |k: usize| {
        let sense = pattern.measurements()[k].sense;
        [sense.plus, sense.minus] == [7, 6] || [sense.plus, sense.minus] == [6, 7]
    };
    for seed in 0..6 {
        let sound = built(seed);
        let look = |values: &[f64]| {
            let whole = Baseline::of_frames(208, &[values]);
            inspect(nominal(), whole, true, &InspectionOptions::default())
        };
        let before = look(&sound).electrodes.unwrap().moved_mm;
        let usual = sound.iter().map(|v| v.abs()).fold(0.0, f64::max);
        for (gain, offset) in [(1.05, 0.0), (0.9, 0.0), (1.0, 0.01 * usual), (1.0, -0.004 * usual)] {
            let wrong: Vec<f64> = sound
                .iter()
                .enumerate()
                .map(|(k, v)| if of_pair(k) { gain * v + offset } else { *v })
                .collect();
            let found = look(&wrong);
            let kinds: Vec<FindingKind> = found.findings.iter().map(|f| f.kind).collect();
            let kind = if offset == 0.0 {
                FindingKind::SenseGain
            } else {
                FindingKind::SenseOffset
            };
            assert_eq!(kinds, [kind], "{seed} {gain} {offset}: {:?}", found.findings);
            let mut electrodes = found.findings[0].electrodes.clone();
            electrodes.sort_unstable();
            assert_eq!(electrodes, [7, 8]);
            let left_out = found.baseline.values_v.iter().filter(|v| v.is_nan()).count();
            assert_eq!(left_out, if offset == 0.0 { 0 } else { 13 });
            if let Some(factor) = found.findings[0].factor {
                assert!((factor / gain - 1.0).abs() < 0.01, "{seed}: {factor} {gain}");
            }
            let moved = found.electrodes.unwrap().moved_mm;
            let most = moved
                .iter()
                .zip(&before)
                .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
            assert!(most < 0.2, "{seed} {gain} {offset}: {most}");
        }
    }
}

#[test]
fn exchanged_wires_are_told_and_turns_and_mirrors_are_not() {
    let mut rng = rng(98);
    let options = WiringOptions::default();
    for k in 0..14 {
        // Neighbours first, then any two.
        let a = rng.random_range(0..16);
        let b = if k < 6 {
            (a + 1) % 16
        } else {
            (a + rng.random_range(2..15)) % 16
        };
        let mut order: Vec<usize> = (0..16).collect();
        order.swap(a, b);
        let wired = wired(nominal(), &order).unwrap();
        let sheet = TestSheet::new(&wired, Drive::PAPER, 0.5, 0.3, &mut rng).unwrap();
        for briefly in [true, false] {
            let check = wiring::check(nominal(), &sheet.baseline, briefly, &options).unwrap();
            assert!(check.is_wrong(), "{a} {b}: {check:?}");
            assert_eq!(check.best.order, order, "{a} {b}");
            assert_eq!(check.equal.len(), 32, "16 turns, and their mirrors");
        }
        // With a dead electrode beside.
        let fault = BaselineFault::Dead(vec![(a + 5) % 16]);
        if (a + 5) % 16 != b {
            let broken = with(&fault, &sheet.baseline, &mut rng);
            let check = wiring::check(nominal(), &broken, true, &options).unwrap();
            assert_eq!(check.best.order, order, "{a} {b}");
        }
    }
    for seed in 0..8 {
        let check = wiring::check(nominal(), &built(seed), false, &options).unwrap();
        assert!(!check.is_wrong() && check.equal.len() == 32, "{seed}: {check:?}");
    }
}

#[test]
fn a_touch_at_a_known_place_tells_the_turn() {
    let mut rng = rng(99);
    let at = DiscTouch {
        // Beside the lines from the middle to the electrodes and between them.
        centre_mm: [61.7, 33.0],
        radius_mm: 10.0,
        rise: 0.4,
    };
    for (turn, mirrored) in [(0, false), (1, false), (11, false), (0, true), (5, true)] {
        let order: Vec<usize> = (0..16)
            .map(|l| {
                if mirrored {
                    (turn + 16 - l) % 16
                } else {
                    (turn + l) % 16
                }
            })
            .collect();
        let wired = wired(nominal(), &order).unwrap();
        let mut sheet = TestSheet::new(&wired, Drive::PAPER, 0.5, 0.3, &mut rng).unwrap();
        let frame = sheet.clean_frame(&[at]).unwrap();
        let check = wiring::check(nominal(), &sheet.baseline, false, &WiringOptions::default()).unwrap();
        assert!(!check.is_wrong());
        // The radius of the finger is not known.
        let finger = DiscTouch { radius_mm: 12.5, ..at };
        let agreement = wiring::by_touch(nominal(), &check.equal, &sheet.baseline, &frame, finger).unwrap();
        let best = (0..agreement.len())
            .max_by(|a, b| agreement[*a].total_cmp(&agreement[*b]))
            .unwrap();
        assert_eq!(check.equal[best], order);
        assert!(agreement[best] > 0.9, "{agreement:?}");
        let unexplained = |k: usize| 1.0 - agreement[k].max(0.0).powi(2);
        let next = (0..agreement.len()).filter(|k| *k != best).map(unexplained);
        assert!(next.fold(1.0, f64::min) > 5.0 * unexplained(best), "{agreement:?}");
    }
}

/// Reciprocity holds on any sheet in any order of the wires, and fails by what a channel is off.
#[test]
fn reciprocity_is_measured() {
    let baseline = built(100);
    let of = |b: &[f64]| wiring::reciprocity(&nominal().pattern, Drive::PAPER, b).unwrap();
    assert!(of(&baseline) < 1e-3, "{}", of(&baseline));
    let mut rng = rng(100);
    let noisy: Vec<f64> = baseline
        .iter()
        .map(|v| v * (1.0 + rng.random_range(-0.05..0.05)))
        .collect();
    assert!((0.01..0.05).contains(&of(&noisy)), "{}", of(&noisy));
    // The adjacent pattern drives no pair both ways round.
    assert_eq!(wiring::twins(&nominal().pattern, &baseline), None);
}
