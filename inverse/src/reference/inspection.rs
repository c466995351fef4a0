//! A baseline is looked at before frames are compared with it: what of it is left out, where the electrodes are, and whether it
//! is that of the sheet at all.

use crate::reference::bad_contacts;
use crate::reference::baseline::Baseline;
use crate::reference::diagnosis::{Diagnosis, Fault, values_of};
use crate::reference::electrode_fit::{self, Distortion, ElectrodeFit, ElectrodeFitOptions, NoFit, OddPair, PairError};
use crate::reference::imager::Imager;
use crate::reference::screening::{Finding, FindingKind, ScreeningOptions, consensus, screen, value_finding};
use crate::reference::wiring::{self, WiringCheck, WiringOptions, order_text};
use crate::stats::median;
use forward::Pattern;
use std::sync::Arc;

/// How a baseline is looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct InspectionOptions {
    /// When a value counts as wrong.
    pub screening: ScreeningOptions,
    /// What is expected of the electrodes.
    pub electrodes: ElectrodeFitOptions,
    /// How orders of the wires are compared.
    pub wiring: WiringOptions,
}

/// What a baseline is worth, and what to compare frames with.
#[derive(Clone, Debug)]
pub struct Inspection {
    /// The sheet, with the electrodes where they were found.
    pub imager: Arc<Imager>,
    /// The baseline without the values that are left out, which are not numbers.
    pub baseline: Baseline,
    /// What is not as the model has it, the gravest first.
    pub findings: Vec<Finding>,
    /// What was broken on the board as the baseline was taken, where no touches are to be had with it.
    pub fault: Option<Fault>,
    /// Whether the baseline is that of the sheet at all. If not, nothing is left out and no electrode is looked for.
    pub conclusive: bool,
    /// The electrodes, where they were looked for and found.
    pub electrodes: Option<ElectrodeFit>,
    /// Why they were not found, where they were looked for.
    pub not_found: Option<NoFit>,
    /// Another order of the wires, where one fits clearly better.
    pub wiring: Option<WiringCheck>,
    /// What the values that are used deviate by from the model, relative, root mean square: after the electrodes were found,
    /// where they were.
    pub misfit: f64,
    /// What they would deviate by on a sheet as the model has it: by the model's own error and by the noise.
    pub expected: f64,
}

/// Relative error of the model's values on its mesh, root mean square (docs/verification.md).
const MODEL_ERROR: f64 = 1e-3;
/// The noise of a sense pair is said from so many times that of the others.
const NOISY: f64 = 3.0;
/// Fewest values of a pair that tell it.
const FEWEST_NOISY: usize = 4;
/// A fingertip: 30 % over a disc of 5 mm radius, mm²; and how many standard deviations of the noise are seen for sure.
const FINGERTIP_MM2: f64 = 24.0;
const SEEN: f64 = 8.0;
/// The misfit is said where it is so many times what is expected.
pub const SAID_FROM: f64 = 3.0;

/// Looks at a baseline: leaves out what is wrong, then looks for the electrodes in the rest if `find_electrodes`.
///
/// A baseline without faults comes back as it is.
pub fn inspect(
    imager: &Arc<Imager>,
    baseline: Baseline,
    find_electrodes: bool,
    options: &InspectionOptions,
) -> Inspection {
    let pattern = &imager.pattern;
    let wiring = wiring::check(imager, &baseline.values_v, true, &options.wiring)
        .ok()
        .filter(WiringCheck::is_wrong);
    // The other wires are right where only a few are exchanged.
    let most = options.screening.most_electrodes * pattern.electrodes() as f64;
    let moved = wiring.as_ref().map_or_else(Vec::new, WiringCheck::moved);
    let moved = if moved.len() as f64 > most { Vec::new() } else { moved };
    let known: Vec<f64> = pattern
        .measurements()
        .iter()
        .zip(&baseline.values_v)
        .map(|(m, v)| {
            let of = [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus];
            if of.iter().any(|l| moved.contains(l)) {
                f64::NAN
            } else {
                *v
            }
        })
        .collect();
    let screening = screen(&imager.model_v, pattern, &known, &options.screening);
    let nothing = baseline.is_nothing().then_some(Fault::Source);
    let suspicious = imager.is_searched()
        && nothing.is_none()
        && wiring.is_none()
        && !(screening.conclusive && screening.findings.is_empty());
    let fault = suspicious
        .then(|| {
            // With all signs turned every fault would look like another one.
            let turned = screening.fitted.iter().sum::<f64>() < 0.0;
            let sign = if turned { -1.0 } else { 1.0 };
            let values: Vec<f64> = baseline.values_v.iter().map(|v| sign * v).collect();
            Diagnosis::new(imager)?.explain_baseline(&values)
        })
        .flatten()
        .or(nothing);
    let mut findings = screening.findings;
    for f in findings.iter_mut().filter(|f| f.kind == FindingKind::Electrode) {
        if f.electrodes.iter().any(|l| moved.contains(&(l - 1))) {
            f.kind = FindingKind::ElectrodeElsewhere;
        }
    }
    let mut used = screening.used;
    let (mut electrodes, mut not_found) = (None, None);
    if find_electrodes && screening.conclusive {
        let signs = screening.fitted.iter();
        let fitted: Vec<f64> = signs
            .zip(&known)
            .map(|(sign, v)| if *sign == 0.0 { f64::NAN } else { sign * v })
            .collect();
        match electrode_fit::find_with(imager, &fitted, &options.electrodes) {
            Ok(fit) => {
                for (k, factor) in &fit.outliers {
                    used[*k] = false;
                    findings.push(value_finding(pattern, *k, *factor));
                }
                for odd in &fit.odd_pairs {
                    findings.push(odd_finding(pattern, odd, &mut used));
                }
                // What leaves no touches is said already.
                let distortion = fit.distortion.filter(|_| fault.is_none());
                findings.extend(distortion.map(|distortion| distortion_finding(imager, distortion, &mut used)));
                electrodes = Some(fit);
            }
            Err(why) => not_found = Some(why),
        }
    }
    bad_contacts::name(&mut findings, pattern, electrodes.as_ref(), &options.electrodes);
    findings.extend((!imager.is_searched()).then(|| of_no_value(FindingKind::Unsearched, pattern)));
    findings.extend((imager.is_ambiguous()).then(|| of_no_value(FindingKind::Ambiguous, pattern)));
    findings.extend(of_frames(&baseline, pattern));
    let used_told = electrodes.as_ref().is_some_and(|fit| fit.imager.told.is_some());
    findings.extend((imager.told.is_some() && !used_told).then(|| of_no_value(FindingKind::Untold, pattern)));
    let baseline = baseline.without(&used);
    findings.extend(noisy(&baseline, pattern));
    findings.extend(hides_touches(imager, &baseline));
    let misfit = electrodes.as_ref().map_or_else(
        || misfit(&imager.model_v, &baseline.values_v, &screening.fitted),
        |fit| fit.misfit,
    );
    Inspection {
        imager: electrodes
            .as_ref()
            .map_or_else(|| Arc::clone(imager), |fit| Arc::clone(&fit.imager)),
        expected: MODEL_ERROR.hypot(baseline.relative_noise()),
        conclusive: screening.conclusive,
        fault,
        findings,
        electrodes,
        not_found,
        wiring,
        misfit,
        baseline,
    }
}

/// A pair with a gain or an offset of its own. Values with an offset are left out.
fn odd_finding(pattern: &Pattern, odd: &OddPair, used: &mut [bool]) -> Finding {
    let measurements = pattern.measurements().iter().enumerate();
    let of: Vec<usize> = measurements.filter(|(_, m)| odd.carries(m)).map(|(k, _)| k).collect();
    let (kind, factor) = match odd.error {
        PairError::Gain(gain) if odd.is_driven => (FindingKind::DriveGain, Some(gain)),
        PairError::Gain(gain) => (FindingKind::SenseGain, Some(gain)),
        PairError::Offset(_) => (FindingKind::SenseOffset, None),
    };
    let left_out = kind == FindingKind::SenseOffset;
    if left_out {
        of.iter().for_each(|k| used[*k] = false);
    }
    Finding {
        kind,
        electrodes: odd.pair.iter().map(|l| l + 1).collect(),
        value: None,
        factor,
        values: of.len(),
        of: pattern.len(),
        left_out,
    }
}

/// What the board does to all values. Those of electrodes that a leak connects are left out: the leak changes the others by little, and what
/// they see of a touch.
fn distortion_finding(imager: &Imager, distortion: Distortion, used: &mut [bool]) -> Finding {
    let pattern = &imager.pattern;
    let Distortion::Leak { electrodes, ohm } = distortion else {
        return Finding {
            left_out: false,
            ..of_no_value(FindingKind::Saturated, pattern)
        };
    };
    let of: Vec<usize> = values_of(imager, &electrodes)
        .into_iter()
        .filter(|k| used[*k])
        .collect();
    of.iter().for_each(|k| used[*k] = false);
    Finding {
        electrodes: electrodes.map(|l| l + 1).to_vec(),
        factor: Some(ohm),
        values: of.len(),
        ..of_no_value(FindingKind::Leak, pattern)
    }
}

/// Frames that the baseline is not the mean of, and those of a sheet that moved.
fn of_frames(baseline: &Baseline, pattern: &Pattern) -> impl Iterator<Item = Finding> + use<> {
    let Baseline {
        frames, unlike, moved, ..
    } = *baseline;
    let left_out = (unlike > 0).then(|| Finding {
        factor: Some(frames as f64 / (frames + unlike) as f64),
        ..of_no_value(FindingKind::Frames, pattern)
    });
    let moved = (moved > 0.0).then(|| Finding {
        factor: Some(moved),
        ..of_no_value(FindingKind::Moved, pattern)
    });
    moved.into_iter().chain(left_out)
}

/// Sense pairs whose values are far noisier than those of the others, both in volts and in parts of their values: of many converters the
/// noise is in proportion to the value, and pairs near the drive have larger ones.
fn noisy(baseline: &Baseline, pattern: &Pattern) -> Vec<Finding> {
    // What moved is no noise.
    if baseline.moved > 0.0 {
        return Vec::new();
    }
    let mut pairs: Vec<([usize; 2], Vec<[f64; 2]>)> = Vec::new();
    let values = baseline.own_noise().into_iter().zip(&baseline.values_v);
    for (m, (noise, value)) in pattern.measurements().iter().zip(values) {
        let pair = [m.sense.plus.min(m.sense.minus) + 1, m.sense.plus.max(m.sense.minus) + 1];
        let noises = [noise, noise / value.abs().max(f64::MIN_POSITIVE)];
        if !value.is_finite() {
            continue;
        }
        match pairs.iter_mut().find(|(of, _)| *of == pair) {
            Some((_, all)) => all.push(noises),
            None => pairs.push((pair, vec![noises])),
        }
    }
    // One value that is noisier than the others of its pair is no amplifier, and of few values that is not known.
    pairs.retain(|(_, all)| all.len() >= FEWEST_NOISY);
    let of_pair = |all: &[[f64; 2]]| [0, 1].map(|i| median(all.iter().map(|noises| noises[i])));
    let noises: Vec<[f64; 2]> = pairs.iter().map(|(_, all)| of_pair(all)).collect();
    let usual = of_pair(&noises);
    let times = noises
        .iter()
        .map(|[volts, part]| (volts / usual[0]).min(part / usual[1]));
    let told = pairs.iter().zip(times).filter(|(_, times)| *times > NOISY);
    told.map(|((pair, all), times)| Finding {
        kind: FindingKind::SenseNoise,
        electrodes: pair.to_vec(),
        value: None,
        factor: Some(times),
        values: all.len(),
        of: pattern.len(),
        left_out: false,
    })
    .collect()
}

/// Noise beside which a fingertip does not show everywhere.
fn hides_touches(imager: &Imager, baseline: &Baseline) -> Option<Finding> {
    let used: Vec<bool> = baseline.values_v.iter().map(|v| v.is_finite()).collect();
    let square = |all: &[f64]| -> f64 {
        all.iter()
            .zip(&used)
            .filter(|(_, used)| **used)
            .map(|(v, _)| v * v)
            .sum()
    };
    // Volts of the board for one of the model.
    let gain = (square(&baseline.values_v) / square(&imager.model_v)).sqrt();
    let noise_v = baseline.noise_v * (1.0 + 1.0 / baseline.frames.max(1) as f64).sqrt() / gain;
    let own = baseline.own_noise().into_iter().zip(&used);
    let weights: Vec<f64> = own.map(|(own, used)| if *used { 1.0 / own } else { 0.0 }).collect();
    let times = imager.least_change_v(&weights, FINGERTIP_MM2) / noise_v;
    (baseline.noise_v > 0.0 && times < SEEN).then(|| Finding {
        factor: Some(times),
        left_out: false,
        ..of_no_value(FindingKind::Noise, &imager.pattern)
    })
}

/// What is left out without a value: frames, searches of too many values, and what presses told.
fn of_no_value(kind: FindingKind, pattern: &Pattern) -> Finding {
    Finding {
        kind,
        electrodes: Vec::new(),
        value: None,
        factor: None,
        values: 0,
        of: pattern.len(),
        left_out: true,
    }
}

/// Values of a baseline (any unit) that are of no use and that the model has smaller, and larger, than every value that is used: no sound board
/// can measure them as it measures those. None where the baseline does not have the pattern's length, or no value of it is used: there is
/// nothing to compare with then, and the board is to blame.
pub fn out_of_range(imager: &Imager, baseline: &[f64]) -> [Vec<usize>; 2] {
    let Ok(used) = imager.difference(baseline, baseline).map(|d| d.used) else {
        return [Vec::new(), Vec::new()];
    };
    let of = |wanted: bool| {
        let model = imager.model_v.iter().map(|m| m.abs()).zip(&used).enumerate();
        model
            .filter(move |(_, (_, used))| **used == wanted)
            .map(|(k, (m, _))| (k, m))
    };
    let least = of(true).map(|(_, m)| m).fold(f64::INFINITY, f64::min);
    let most = of(true).map(|(_, m)| m).fold(0.0, f64::max);
    let of_no_use = |is: &dyn Fn(f64) -> bool| {
        of(false)
            .filter(|(_, m)| most > 0.0 && is(*m))
            .map(|(k, _)| k)
            .collect()
    };
    [of_no_use(&|m| m < least), of_no_use(&|m| m > most)]
}

/// What values deviate by from the model but for a common gain, root mean square of the logarithms.
fn misfit(model_v: &[f64], baseline: &[f64], fitted: &[f64]) -> f64 {
    let ratios = model_v
        .iter()
        .zip(baseline)
        .zip(fitted)
        .filter(|(_, sign)| **sign != 0.0);
    let ln: Vec<f64> = ratios
        .map(|((m, b), _)| (b / m).abs().ln())
        .filter(|l| l.is_finite())
        .collect();
    let gain = consensus(ln.iter().copied(), std::f64::consts::LN_2).map_or(0.0, |c| c.0);
    (ln.iter().map(|l| (l - gain).powi(2)).sum::<f64>() / ln.len().max(1) as f64).sqrt()
}

impl Inspection {
    /// Notes how far the sheet moved meanwhile, in standard deviations ([`Baseline::moved`]); 0 is not at all.
    pub(crate) fn note_moved(&mut self, sd: f64) {
        if sd <= self.baseline.moved {
            return;
        }
        self.baseline.moved = sd;
        // What moved is no noise.
        self.findings.retain(|f| {
            !matches!(
                f.kind,
                FindingKind::Moved | FindingKind::SenseNoise | FindingKind::Noise
            )
        });
        let moved = of_frames(&self.baseline, &self.imager.pattern).find(|f| f.kind == FindingKind::Moved);
        self.findings.extend(moved);
    }

    /// A baseline that is taken as it is, where the model says nothing of the sheet.
    pub(crate) fn unlooked(imager: &Arc<Imager>, baseline: Baseline) -> Self {
        Self {
            imager: Arc::clone(imager),
            expected: baseline.relative_noise(),
            findings: of_frames(&baseline, &imager.pattern)
                .chain(noisy(&baseline, &imager.pattern))
                .collect(),
            baseline,
            fault: None,
            conclusive: true,
            electrodes: None,
            not_found: None,
            wiring: None,
            misfit: 0.0,
        }
    }

    /// What is left out of the baseline for good.
    pub fn left_out(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|f| f.left_out)
    }

    /// How many values are of no use though nothing that was found is about them: missing, clipped or next to nothing. First those that
    /// the sheet itself makes so: the model has them larger or smaller than every value that is used, so that no sound board can
    /// measure them as it measures those. Then the others.
    pub fn unusable(&self) -> [usize; 2] {
        let values = &self.baseline.values_v;
        let Ok(used) = self.imager.difference(values, values).map(|d| d.used) else {
            return [0; 2];
        };
        let named: usize = self.left_out().map(|f| f.values).sum();
        let all = used.iter().filter(|used| !**used).count().saturating_sub(named);
        let [small, large] = out_of_range(&self.imager, values);
        let expected = (small.len() + large.len()).min(all);
        [expected, all - expected]
    }

    /// What was done about it, and needs no hand; a line each.
    pub fn notes(&self) -> Vec<String> {
        let mended = self.findings.iter().filter(|f| f.kind == FindingKind::Frames);
        mended.map(ToString::to_string).collect()
    }

    /// What there is to say of it, a line each, the gravest first; none for a baseline as it should be.
    pub fn warnings(&self) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        lines.extend(self.fault.iter().map(|fault| format!("in the baseline {fault}")));
        if let Some(check) = &self.wiring {
            lines.push(format!(
                "the electrodes seem to be wired in another order, which fits the baseline to {:.0} % instead of {:.0} %; look with \
                 skin check, or give --wires {}",
                100.0 * check.best.misfit,
                100.0 * check.given.misfit,
                order_text(&check.best.order)
            ));
        }
        if !self.conclusive {
            lines.push(
                "the baseline is not that of the sheet as described; no value of it is left out and no electrode is looked for. Look \
                 at the sheet's size, the number and order of the electrodes and their contacts"
                    .to_owned(),
            );
        }
        let grave = self.findings.iter().filter(|f| f.kind != FindingKind::Frames);
        lines.extend(grave.map(ToString::to_string));
        if let Some(NoFit::TooFar {
            electrode,
            moved_mm,
            most_mm,
        }) = &self.not_found
        {
            lines.push(format!(
                "the baseline puts electrode {} at {:.0} mm from where it was said to be, more than the {most_mm:.0} mm that hands \
                 are off; no electrode is moved. Look at its place, at the sheet and at the contacts",
                electrode + 1,
                moved_mm.abs()
            ));
        }
        if let Some(NoFit::NoSheet) = &self.not_found {
            lines.push(
                "the electrodes were not found in the baseline and are taken to be where they were said to be"
                    .to_owned(),
            );
        }
        if self.electrodes.is_some() && self.misfit > SAID_FROM * self.expected {
            lines.push(format!(
                "the sheet is {:.1} % off its model after the electrodes were found, {:.1} % expected; holes, cuts and worn places \
                 do that, and so do electrodes of another size",
                100.0 * self.misfit,
                100.0 * self.expected
            ));
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{Batch, BatchOptions};
    use crate::solvers::Method;
    use forward::{Drive, Measurement, Sheet};
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    fn imager(electrodes: usize) -> Arc<Imager> {
        let sheet = Sheet::disc(195.0, electrodes, 4.0, 1.0, 1000.0);
        let pattern = Pattern::adjacent(electrodes).unwrap();
        Arc::new(Imager::new(&sheet, Drive::PAPER, pattern, 15.0).unwrap())
    }

    /// 32 electrodes have 928 values, 47 have 2,068.
    #[test]
    fn frames_of_many_values_are_not_searched_and_that_is_said() {
        for (electrodes, searched) in [(32, true), (47, false)] {
            let imager = imager(electrodes);
            let baseline = Baseline::of_frames(imager.pattern.len(), &[&imager.model_v]);
            let found = inspect(&imager, baseline, true, &InspectionOptions::default());
            assert_eq!(imager.is_searched(), searched);
            let kinds: Vec<FindingKind> = found.left_out().map(|f| f.kind).collect();
            let expected: &[FindingKind] = if searched { &[] } else { &[FindingKind::Unsearched] };
            assert_eq!(kinds, expected);
            let said = found.warnings().join("\n");
            assert_eq!(said.contains("what is broken is not looked for"), !searched, "{said}");
        }
    }

    /// Noise of one size, and noise in proportion to every value, are no channel's.
    #[test]
    fn a_noisy_amplifier_is_said_and_other_noise_is_not() {
        let imager = imager(16);
        let mut rng = StdRng::seed_from_u64(41);
        let usual_v = 1e-3 * median(imager.model_v.iter().map(|v| v.abs()));
        let noisy = |m: &Measurement| m.sense.plus.max(m.sense.minus) == 4 && m.sense.plus.min(m.sense.minus) == 3;
        let measurements = imager.pattern.measurements();
        for (in_proportion, times, said) in [
            (false, 1.0, false),
            (true, 1.0, false),
            (false, 2.0, false),
            (true, 2.0, false),
            (false, 4.5, true),
            (true, 10.0, true),
        ] {
            let frames: Vec<Vec<f64>> = (0..24)
                .map(|_| {
                    let values = measurements.iter().zip(&imager.model_v);
                    let of = |(m, v): (&Measurement, &f64)| {
                        let sd = if in_proportion { 1e-3 * v.abs() } else { usual_v };
                        let own = if noisy(m) { times } else { 1.0 };
                        v + own * sd * rng.sample::<f64, _>(StandardNormal)
                    };
                    values.map(of).collect()
                })
                .collect();
            let frames: Vec<&[f64]> = frames.iter().map(Vec::as_slice).collect();
            let baseline = Baseline::of_frames(imager.pattern.len(), &frames);
            let found = inspect(&imager, baseline.clone(), false, &InspectionOptions::default());
            let of_pairs = || found.findings.iter().filter(|f| f.kind != FindingKind::Noise);
            let pairs: Vec<&[usize]> = of_pairs().map(|f| f.electrodes.as_slice()).collect();
            let expected: &[&[usize]] = if said { &[&[4, 5]] } else { &[] };
            assert_eq!(pairs, expected, "{in_proportion} {times}: {:?}", found.warnings());
            assert_eq!(found.warnings().join("\n").contains("times as noisy"), said);
            let factor = of_pairs().next().and_then(|f| f.factor);
            assert!(
                factor.is_none_or(|factor| (factor / times - 1.0).abs() < 0.3),
                "{factor:?}"
            );
            // What is left out of the baseline counts no less: it does not count.
            let values = baseline.values_v.iter().zip(measurements);
            let dead: Vec<f64> = values.map(|(v, m)| if noisy(m) { f64::NAN } else { *v }).collect();
            let baseline = Baseline {
                values_v: dead,
                ..baseline
            };
            let found = inspect(&imager, baseline, false, &InspectionOptions::default());
            assert!(found.findings.iter().all(|f| f.kind != FindingKind::SenseNoise));
        }
    }

    /// What a fingertip changes in the middle is known over the noise, and is said where it does not show.
    #[test]
    fn noise_that_hides_a_fingertip_is_said() {
        let imager = imager(16);
        let tip_v = imager.least_change_v(&vec![1.0; imager.pattern.len()], FINGERTIP_MM2);
        let middle = (0..imager.grid.len()).min_by(|a, b| {
            let of = |cell: usize| imager.grid.centre(cell)[0].hypot(imager.grid.centre(cell)[1]);
            of(*a).total_cmp(&of(*b))
        });
        let here = imager.sensitivity.column(middle.unwrap()).norm() * FINGERTIP_MM2 / imager.grid.cell_mm().powi(2);
        assert!((tip_v / here - 1.0).abs() < 0.2, "{tip_v} {here}");
        let mut rng = StdRng::seed_from_u64(7);
        // Whatever unit the board has.
        for (unit, times, said) in [
            (1.0, 3.0, true),
            (1.0, 16.0, false),
            (1e3, 4.0, true),
            (1e3, 12.0, false),
        ] {
            let frames: Vec<Vec<f64>> = (0..24)
                .map(|_| {
                    let noise = |v: &f64| unit * (v + tip_v / times * rng.sample::<f64, _>(StandardNormal));
                    imager.model_v.iter().map(noise).collect()
                })
                .collect();
            let frames: Vec<&[f64]> = frames.iter().map(Vec::as_slice).collect();
            let baseline = Baseline::of_frames(imager.pattern.len(), &frames);
            let found = inspect(&imager, baseline, false, &InspectionOptions::default());
            let noise = found.findings.iter().find(|f| f.kind == FindingKind::Noise);
            assert_eq!(noise.is_some(), said, "{unit} {times}: {:?}", found.warnings());
            assert_eq!(found.warnings().join("\n").contains("hides light touches"), said);
            let factor = noise.and_then(|f| f.factor);
            assert!(factor.is_none_or(|f| (f / times - 1.0).abs() < 0.1), "{factor:?}");
        }
    }

    /// A square's corners give more than its sides, and less across: what no board can measure there is no fault.
    #[test]
    fn values_that_the_sheet_makes_too_large_are_no_fault() {
        let place = |k: usize| {
            let along = [-60.0, -20.0, 20.0, 60.0][k % 4];
            let at: [f64; 2] = [[80.0, along], [-along, 80.0], [-80.0, -along], [along, -80.0]][k / 4];
            format!("{{ point_mm = {at:?}, width_mm = 10.0, contact_mm = 1.0 }}")
        };
        let text = format!(
            "sheet_resistance_ohm = 1000.0\noutline = {{ kind = \"rectangle\", width_mm = 160.0, height_mm = 160.0 }}\nelectrodes = [{}]\n",
            (0..16).map(place).collect::<Vec<_>>().join(", ")
        );
        let (sheet, pattern) = forward::file::parse_sheet(&text).unwrap();
        let imager = Arc::new(Imager::new(&sheet, Drive::PAPER, pattern, 10.0).unwrap());
        let mut sizes: Vec<f64> = imager.model_v.iter().map(|v| v.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let range = 0.5 * (sizes[199] + sizes[200]);
        let mut clipped = imager.model_v.clone();
        clipped
            .iter_mut()
            .filter(|v| v.abs() > range)
            .for_each(|v| *v = f64::NAN);
        let unusable = |values: &[f64]| {
            let baseline = Baseline::of_frames(values.len(), &[values]);
            inspect(&imager, baseline, false, &InspectionOptions::default()).unusable()
        };
        assert_eq!(unusable(&imager.model_v), [0, 0]);
        assert_eq!(unusable(&clipped), [8, 0]);
        // One in the middle is.
        let middle = imager.model_v.iter().position(|v| v.abs() == sizes[104]).unwrap();
        clipped[middle] = f64::NAN;
        assert_eq!(unusable(&clipped), [8, 1]);
        assert_eq!(unusable(&[f64::NAN; 208]), [0, 208]);
    }

    /// A lost source is named where frames are searched, and doubted where they are not.
    #[test]
    fn what_is_broken_in_frames_of_many_values_is_doubted() {
        for (electrodes, searched) in [(32, true), (47, false)] {
            let imager = imager(electrodes);
            let mut frame = imager.model_v.clone();
            frame.iter_mut().for_each(|v| *v *= 1e-3);
            let baseline = imager.model_v.clone();
            let mut batch = Batch::new(imager, &[&baseline], BatchOptions::of(Method::Nnls)).unwrap();
            let result = batch.frame(1, &frame).unwrap();
            assert_eq!(result.faults == [Fault::Source], searched, "{:?}", result.faults);
            assert!(result.doubt.is_some() && result.touches.is_empty());
        }
    }
}
