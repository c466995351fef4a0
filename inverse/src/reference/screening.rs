//! Which values of a baseline agree with the model of the sheet, before anything is estimated from them.
//!
//! A dead electrode, a pair that is broken or a wild value would move the electrodes that are looked for in the baseline by
//! centimetres. Most of the values may be wrong: three dead electrodes of 16 take part in up to 132 of 208. The common gain is
//! therefore the one that most values agree on, not their mean or median (consensus, Fischler and Bolles, Comm. ACM 24, 1981).
//! Whole electrodes explain wrong values first, the worst one first; then pairs; what is left are single values. The values of an
//! electrode that is named no longer count against its neighbours, so that dead electrodes do not mask each other.

use crate::reference::imager::MOST_SEARCHED;
use crate::reference::written::resistance;
use forward::{Pair, Pattern};
use serde::Serialize;
use std::fmt;

/// When a value of a baseline counts as wrong. Every default was chosen by `cargo run -p studies --example screening`
/// (docs/reliability.md): nothing is named on clean sheets, and up to three dead electrodes are named anywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScreeningOptions {
    /// Largest deviations of a value's logarithm from the model with the common gain; the first that explains the baseline is
    /// taken. Electrodes off by 3 mm deviate by 0.46, an uneven sheet (20 %) by 0.32, a hole of 60 mm by 0.65, tanks with other
    /// electrodes than described by 0.76. More lets wrong values pass.
    pub tolerances: [f64; 2],
    /// Deviation that is always accepted, over the median of the model's values: small values have large logarithms.
    pub floor: f64,
    /// Part of an electrode's values that are wrong from which the electrode is named. Noise agrees by chance in up to a quarter.
    pub electrode: f64,
    /// The same for a drive pair or a sense pair, and the part of its values that must agree on another sign or gain.
    pub pair: f64,
    /// Fewest values of an electrode or a pair that tell anything about it.
    pub least_values: usize,
    /// Largest factor by which a drive or a sense pair may differ as a whole and still count as measured: a contact 30 times
    /// worse gives a third of the current. Beyond it the values are crosstalk.
    pub most_gain: f64,
    /// Largest part of all values that are left out as single ones. When there are more, the sheet is not as described.
    pub most_single: f64,
    /// Largest part of the electrodes that are named. When there are more, the sheet is not as described. Three of 16 leave 76 of 208
    /// values, the fewest with which touches are right.
    pub most_electrodes: f64,
}

impl Default for ScreeningOptions {
    fn default() -> Self {
        Self {
            tolerances: [0.6, 1.0],
            floor: 0.03,
            electrode: 0.55,
            pair: 0.7,
            least_values: 4,
            most_gain: 10.0,
            most_single: 0.05,
            most_electrodes: 0.2,
        }
    }
}

/// What a finding is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FindingKind {
    /// All values of an electrode are wrong or missing.
    Electrode,
    /// The values of an electrode belong to another place on the sheet; see [`crate::reference::wiring`].
    ElectrodeElsewhere,
    /// All values of a drive pair are wrong.
    DrivePair,
    /// All values of a sense pair are wrong.
    SensePair,
    /// The contact of an electrode is much worse than those of the others. Its values are used; the factor is its impedance over the
    /// median, where that is known.
    Contact,
    /// One value is wrong.
    Value,
    /// All values have the wrong sign. They are used.
    AllSigns,
    /// The values of a drive pair have the wrong sign. They are used.
    DriveSign,
    /// The values of a sense pair have the wrong sign. They are used.
    SenseSign,
    /// The values of a drive pair are all too large or too small by one factor. They are used.
    DriveGain,
    /// The values of a sense pair are all too large or too small by one factor. They are used.
    SenseGain,
    /// The values of a sense pair are all off by one voltage.
    SenseOffset,
    /// The values of a sense pair are all missing: out of range, as a rule.
    SenseMissing,
    /// The values of a sense pair are far noisier than the others; the factor says how many times. They are used, and count less.
    SenseNoise,
    /// Two electrodes are connected over a resistance; [`Finding::factor`] is that, in ohm. Their values are left out.
    Leak,
    /// All amplifiers saturate. Their values are used.
    Saturated,
    /// Noise hides light touches; the factor is what a fingertip changes where the sheet tells least, over the noise. It concerns no value.
    Noise,
    /// What presses told of the sheet cannot be used with this baseline. It concerns no value.
    Untold,
    /// Frames have too many values to look for what is broken, and for what drifts seldom. It concerns no value.
    Unsearched,
    /// Touches at different places change all values of the pattern alike. It concerns no value.
    Ambiguous,
    /// The sheet moved while the baseline was taken; [`Finding::factor`] is how far, in standard deviations of a frame's noise. It concerns
    /// no value.
    Moved,
    /// Frames that the baseline is not the mean of; [`Finding::factor`] is the part of them that it is. It concerns no value.
    Frames,
}

/// Something in a baseline that is not as the model of the sheet has it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// What it is about.
    pub kind: FindingKind,
    /// Electrodes counted from 1: the electrode, the pair's two (plus, minus), or those of a value (drive plus and minus, sense
    /// plus and minus). Empty for all signs, and where it concerns no value.
    pub electrodes: Vec<usize>,
    /// Index of the value in the pattern, from 0, of a single value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<usize>,
    /// Measured over expected, where one number says it; of some kinds another number ([`FindingKind`]).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub factor: Option<f64>,
    /// How many values it concerns that no finding before it does.
    pub values: usize,
    /// How many values a frame has.
    pub of: usize,
    /// Whether these values, frames or this search are left out.
    pub left_out: bool,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let e = |k: usize| self.electrodes.get(k).copied().unwrap_or(0);
        let out = format!("{} of {} values are left out", self.values, self.of);
        let factor = self.factor.unwrap_or(f64::NAN);
        match self.kind {
            FindingKind::Electrode => write!(f, "electrode {} gives no signal in the baseline: {out}", e(0)),
            FindingKind::ElectrodeElsewhere => {
                write!(f, "electrode {} is not where its number says: {out}", e(0))
            }
            FindingKind::DrivePair => write!(
                f,
                "the drive pair of electrodes {} and {} gives no signal in the baseline: {out}",
                e(0),
                e(1)
            ),
            FindingKind::SensePair => write!(
                f,
                "the sense pair of electrodes {} and {} gives no signal in the baseline: {out}",
                e(0),
                e(1)
            ),
            FindingKind::Contact => match self.factor {
                Some(factor) => write!(
                    f,
                    "the contact of electrode {} is about {factor:.1} times the median in the baseline; look at it",
                    e(0)
                ),
                None => write!(
                    f,
                    "the contact of electrode {} is bad in the baseline: the pairs that it drives with give too little signal; look at it",
                    e(0)
                ),
            },
            FindingKind::Value => write!(
                f,
                "the baseline's value of drive {}-{}, sense {}-{} is {factor:.2} of what is expected and is left out",
                e(0),
                e(1),
                e(2),
                e(3)
            ),
            FindingKind::AllSigns => write!(
                f,
                "all values have the wrong sign; exchange the two wires of the sense amplifier, or turn the sign of the values"
            ),
            FindingKind::DriveSign | FindingKind::SenseSign => write!(
                f,
                "the {} pair of electrodes {} and {} has the wrong sign in the baseline: its two wires are exchanged",
                if self.kind == FindingKind::DriveSign {
                    "drive"
                } else {
                    "sense"
                },
                e(0),
                e(1)
            ),
            FindingKind::DriveGain => write!(
                f,
                "the drive pair of electrodes {} and {} gives {factor:.2} of the signal that is expected in the baseline; look at their contacts and switches",
                e(0),
                e(1)
            ),
            FindingKind::SenseGain => write!(
                f,
                "the amplifier between electrodes {} and {} gives {factor:.3} of the signal that is expected in the baseline; look at it",
                e(0).min(e(1)),
                e(0).max(e(1))
            ),
            FindingKind::SenseNoise => write!(
                f,
                "the values between electrodes {} and {} are {factor:.0} times as noisy as the others in the baseline and count less; look at \
                 the amplifier and at what runs beside its wires",
                e(0).min(e(1)),
                e(0).max(e(1))
            ),
            FindingKind::Leak => write!(
                f,
                "electrodes {} and {} are connected over {} in the baseline: {out}; look for moisture and dirt between their wires and clamps",
                e(0),
                e(1),
                resistance(factor)
            ),
            FindingKind::Saturated => write!(
                f,
                "the amplifiers saturate in the baseline: touches may be shown too small; look at their supply and their gains"
            ),
            FindingKind::Noise => write!(
                f,
                "the baseline's noise hides light touches: where the sheet tells least, 30 % over a disc of 5 mm radius changes a frame by \
                 {factor:.1} standard deviations; look at the excitation, the amplifiers' gains and what runs beside the wires"
            ),
            FindingKind::SenseMissing => write!(
                f,
                "the amplifier between electrodes {} and {} gives no value in the baseline, as at its rail: {out}",
                e(0).min(e(1)),
                e(0).max(e(1))
            ),
            FindingKind::Untold => write!(
                f,
                "what presses told of the sheet is not used, since it goes with electrodes that are found in the baseline: look at the \
                 baseline, or calibrate anew"
            ),
            FindingKind::Unsearched => write!(
                f,
                "frames have {} values, more than {MOST_SEARCHED}: what is broken is not looked for in them, nor contacts, \
                 gains of channels and an unevenness that changed; use a pattern of fewer values for that",
                self.of
            ),
            FindingKind::Ambiguous => write!(
                f,
                "with this pattern touches at different places change all values alike, as those mirrored through the middle do where \
                 opposite electrodes drive and sense: which place is touched no frame tells. Drive or sense other pairs as well, \
                 neighbours for instance"
            ),
            FindingKind::Moved => write!(
                f,
                "the baseline's frames differ from each other by {factor:.0} times their noise, all in one way: something came down, lifted or \
                 slid, or a contact failed, while they were measured. Take a baseline at rest"
            ),
            FindingKind::Frames => write!(
                f,
                "{:.0} % of the baseline's frames are unlike the others and left out: something touched, or a contact or the supply fails \
                 now and then",
                100.0 * (1.0 - factor)
            ),
            FindingKind::SenseOffset => write!(
                f,
                "the amplifier between electrodes {} and {} has an offset in the baseline: {out}",
                e(0).min(e(1)),
                e(0).max(e(1))
            ),
        }
    }
}

/// What a baseline's values are worth.
#[derive(Clone, Debug, PartialEq)]
pub struct Screening {
    /// What was found, the gravest first.
    pub findings: Vec<Finding>,
    /// Which values may be compared with frames. Missing ones count as such.
    pub used: Vec<bool>,
    /// 1 for a value that the electrodes may be looked for in, -1 for one whose sign is to be turned first, 0 for none.
    pub fitted: Vec<f64>,
    /// Whether the baseline is that of the sheet at all. If not, nothing is left out.
    pub conclusive: bool,
}

/// The values of a baseline against the model.
struct Ratios<'a> {
    options: &'a ScreeningOptions,
    /// The tolerance that is tried.
    tolerance: f64,
    pattern: &'a Pattern,
    model_v: &'a [f64],
    baseline: &'a [f64],
    /// Median of the model's values, V.
    middle_v: f64,
    /// Logarithm of the magnitude of baseline over model; not a number where one is missing.
    ln: Vec<f64>,
    /// Whether baseline and model have the same sign: 1 or -1.
    sign: Vec<f64>,
    /// -1 for a value whose sign was turned back.
    turned: Vec<f64>,
    /// Logarithm of the gain that a value is expected to have.
    gain: Vec<f64>,
}

/// Screens a baseline (any unit; not a number where a value is missing) against the voltages of the model (V), both in the
/// pattern's order. Where their lengths are not the pattern's nothing is left out.
pub fn screen(model_v: &[f64], pattern: &Pattern, baseline: &[f64], options: &ScreeningOptions) -> Screening {
    let whole = model_v.len() == pattern.len() && baseline.len() == pattern.len();
    options
        .tolerances
        .into_iter()
        .filter(|_| whole)
        .find_map(|tolerance| Ratios::new(model_v, pattern, baseline, options, tolerance)?.screen())
        .unwrap_or_else(|| Screening {
            findings: Vec::new(),
            used: vec![true; pattern.len()],
            fitted: vec![1.0; pattern.len()],
            conclusive: false,
        })
}

/// The two electrodes of a pair, the lower first: which way round it is driven or sensed does not matter here.
fn unordered(pair: Pair) -> [usize; 2] {
    [pair.plus.min(pair.minus), pair.plus.max(pair.minus)]
}

/// The centre of the narrow range of so much to either side that holds most of the values, and how many it holds.
pub(crate) fn consensus(values: impl Iterator<Item = f64>, reach: f64) -> Option<(f64, usize)> {
    let mut sorted: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let mut best = 0..0;
    let mut end = 0;
    for (start, low) in sorted.iter().enumerate() {
        while end < sorted.len() && sorted[end] - low <= 2.0 * reach {
            end += 1;
        }
        if end - start > best.len() {
            best = start..end;
        }
    }
    let mut within = sorted.get(best)?;
    // The middle of the range is not that of what it holds: centred anew, it may hold more.
    for _ in 0..3 {
        let centre = *within.get(within.len() / 2)?;
        let start = sorted.partition_point(|v| *v < centre - reach);
        let end = sorted.partition_point(|v| *v <= centre + reach);
        within = sorted.get(start..end)?;
    }
    Some((*within.get(within.len() / 2)?, within.len()))
}

impl<'a> Ratios<'a> {
    fn new(
        model_v: &'a [f64],
        pattern: &'a Pattern,
        baseline: &'a [f64],
        options: &'a ScreeningOptions,
        tolerance: f64,
    ) -> Option<Self> {
        let mut sizes: Vec<f64> = model_v.iter().map(|v| v.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let middle_v = *sizes.get(sizes.len() / 2)?;
        let ln: Vec<f64> = baseline
            .iter()
            .zip(model_v)
            .map(|(b, m)| {
                if b.is_finite() && m.abs() > 1e-9 * middle_v {
                    (b / m).abs().ln()
                } else {
                    f64::NAN
                }
            })
            .collect();
        // A table of magnitudes has no signs.
        let unsigned = !baseline.iter().any(|b| *b < 0.0) && model_v.iter().any(|m| *m < 0.0);
        let sign: Vec<f64> = baseline
            .iter()
            .zip(model_v)
            .map(|(b, m)| if unsigned || b * m >= 0.0 { 1.0 } else { -1.0 })
            .collect();
        // Noise has both signs: it agrees only half as often on one.
        let of = |which: f64| {
            let signed = ln.iter().zip(&sign).filter(move |(_, s)| **s == which);
            consensus(signed.map(|(l, _)| *l), tolerance)
        };
        let (common, _) = [of(-1.0), of(1.0)].into_iter().flatten().max_by_key(|c| c.1)?;
        Some(Self {
            gain: vec![common; ln.len()],
            turned: vec![1.0; ln.len()],
            options,
            tolerance,
            pattern,
            model_v,
            baseline,
            middle_v,
            ln,
            sign,
        })
    }

    /// What is wrong; none where the values are not those of the sheet.
    fn screen(mut self) -> Option<Screening> {
        let count = self.ln.len();
        let turned = self.turn_signs();
        let gains = self.find_gains();
        let wrong: Vec<bool> = (0..count).map(|k| self.is_present(k) && !self.agrees(k)).collect();
        let mut used = vec![true; count];
        let mut findings = self.attribute(&wrong, &mut used);
        let dead: Vec<usize> = findings
            .iter()
            .filter(|f| f.kind == FindingKind::Electrode)
            .flat_map(|f| f.electrodes.iter().map(|l| l - 1))
            .collect();
        let single: Vec<usize> = (0..count).filter(|k| wrong[*k] && used[*k]).collect();
        let most_single = (self.options.most_single * count as f64).max(1.0);
        let most_dead = self.options.most_electrodes * self.pattern.electrodes() as f64;
        if dead.len() as f64 > most_dead || single.len() as f64 > most_single {
            return None;
        }
        for k in single {
            used[k] = false;
            findings.push(self.value(k));
        }
        let fitted = (0..count)
            .map(|k| {
                let own = gains.iter().any(|(drive, pair, _)| self.is_of(k, *drive, *pair));
                if used[k] && !own { self.turned[k] } else { 0.0 }
            })
            .collect();
        let alive = |pair: &[usize]| !pair.iter().any(|l| dead.contains(l));
        // The noise of a dead electrode may look like a sign or a gain.
        findings.extend(turned.into_iter().filter(|f| {
            let pair: Vec<usize> = f.electrodes.iter().map(|l| l - 1).collect();
            alive(&pair)
        }));
        for (drive, pair, factor) in gains.into_iter().filter(|(_, pair, _)| alive(pair)) {
            let kind = if drive {
                FindingKind::DriveGain
            } else {
                FindingKind::SenseGain
            };
            let values = (0..count).filter(|k| self.is_of(*k, drive, pair)).count();
            findings.push(self.finding(kind, &pair, Some(factor), values, false));
        }
        Some(Screening {
            findings,
            used,
            fitted,
            conclusive: true,
        })
    }

    fn is_present(&self, k: usize) -> bool {
        !self.ln[k].is_nan()
    }

    /// Whether a value's magnitude is as expected.
    fn fits(&self, k: usize) -> bool {
        let off = self.ln[k] - self.gain[k];
        off.abs() <= self.tolerance
            || (self.baseline[k].abs() * (-self.gain[k]).exp() - self.model_v[k].abs()).abs()
                <= self.options.floor * self.middle_v
    }

    fn agrees(&self, k: usize) -> bool {
        // A value that is as good as nothing has no sign.
        let small = self.model_v[k].abs() <= self.options.floor * self.middle_v;
        self.fits(k) && (self.sign[k] > 0.0 || small)
    }

    /// Whether a value is one of a drive pair (or of a sense pair).
    fn is_of(&self, k: usize, drive: bool, pair: [usize; 2]) -> bool {
        let m = self.pattern.measurements()[k];
        unordered(if drive { m.drive } else { m.sense }) == pair
    }

    /// All drive pairs, or all sense pairs.
    fn pairs(&self, drive: bool) -> Vec<[usize; 2]> {
        let mut pairs: Vec<[usize; 2]> = Vec::new();
        for m in self.pattern.measurements() {
            let pair = unordered(if drive { m.drive } else { m.sense });
            if !pairs.contains(&pair) {
                pairs.push(pair);
            }
        }
        pairs
    }

    /// Finds turned signs and turns them back: of all, of drive pairs, of sense pairs.
    fn turn_signs(&mut self) -> Vec<Finding> {
        let mut findings = Vec::new();
        let all: Vec<usize> = (0..self.ln.len()).filter(|k| self.fits(*k)).collect();
        if all.iter().map(|k| self.sign[*k]).sum::<f64>() < 0.0 {
            self.turn(0..self.ln.len());
            findings.push(self.finding(FindingKind::AllSigns, &[], None, self.ln.len(), false));
        }
        for drive in [true, false] {
            let turned: Vec<[usize; 2]> = self
                .pairs(drive)
                .into_iter()
                .filter(|pair| {
                    let of = all.iter().filter(|k| self.is_of(**k, drive, *pair));
                    let signs: Vec<f64> = of.map(|k| self.sign[*k]).collect();
                    let negative = signs.iter().filter(|s| **s < 0.0).count();
                    let present = (0..self.ln.len()).filter(|k| self.is_of(*k, drive, *pair) && self.is_present(*k));
                    let least = (0.5 * present.count() as f64).max(self.options.least_values as f64);
                    signs.len() as f64 >= least && negative as f64 >= self.options.pair * signs.len() as f64
                })
                .collect();
            for pair in turned {
                let of: Vec<usize> = (0..self.ln.len()).filter(|k| self.is_of(*k, drive, pair)).collect();
                let kind = if drive {
                    FindingKind::DriveSign
                } else {
                    FindingKind::SenseSign
                };
                findings.push(self.finding(kind, &pair, None, of.len(), false));
                self.turn(of);
            }
        }
        findings
    }

    fn turn(&mut self, values: impl IntoIterator<Item = usize>) {
        for k in values {
            self.sign[k] = -self.sign[k];
            self.turned[k] = -self.turned[k];
        }
    }

    /// Finds pairs with a gain of their own and expects it of their values: whether it is a drive pair, its electrodes, the
    /// factor.
    fn find_gains(&mut self) -> Vec<(bool, [usize; 2], f64)> {
        let mut gains = Vec::new();
        for drive in [true, false] {
            for pair in self.pairs(drive) {
                let of: Vec<usize> = (0..self.ln.len())
                    .filter(|k| self.is_of(*k, drive, pair) && self.is_present(*k))
                    .collect();
                let least = (self.options.pair * of.len() as f64).max(self.options.least_values as f64);
                let disagree = of.iter().filter(|k| !self.fits(**k)).count();
                if (disagree as f64) < least {
                    continue;
                }
                let right = of.iter().filter(|k| self.sign[**k] > 0.0);
                // Half the tolerance: noise must not agree by chance.
                let Some((own, agree)) = consensus(right.map(|k| self.ln[*k]), 0.5 * self.tolerance) else {
                    continue;
                };
                let factor = own - self.gain[of[0]];
                if agree as f64 >= least && factor.abs() <= self.options.most_gain.ln() {
                    for k in of {
                        self.gain[k] = own;
                    }
                    gains.push((drive, pair, factor.exp()));
                }
            }
        }
        gains
    }

    /// Explains wrong values by electrodes, then by pairs, and takes all values of these out of use.
    fn attribute(&self, wrong: &[bool], used: &mut [bool]) -> Vec<Finding> {
        let touches = |k: usize, l: usize| {
            let m = self.pattern.measurements()[k];
            [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus].contains(&l)
        };
        let mut dead: Vec<usize> = Vec::new();
        let mut rest = used.to_vec();
        loop {
            let worst = (0..self.pattern.electrodes())
                .filter_map(|l| Some((l, self.wrong_part(wrong, &rest, |k| touches(k, l))?)))
                .max_by(|a, b| a.1.total_cmp(&b.1));
            let Some((l, _)) = worst.filter(|(_, part)| *part >= self.options.electrode) else {
                break;
            };
            dead.push(l);
            for (k, rest) in rest.iter_mut().enumerate() {
                *rest &= !touches(k, l);
            }
        }
        for l in 0..self.pattern.electrodes() {
            let mut of = (0..used.len()).filter(|k| touches(*k, l)).peekable();
            if of.peek().is_some() && of.all(|k| !self.is_present(k)) {
                dead.push(l);
            }
        }
        let dead = smallest(&self.candidates(wrong, dead, touches), used.len(), touches);
        let mut findings: Vec<Finding> = dead
            .iter()
            .map(|l| self.leave_out(FindingKind::Electrode, &[*l], used, |k| touches(k, *l)))
            .collect();
        for (drive, kind) in [(true, FindingKind::DrivePair), (false, FindingKind::SensePair)] {
            for pair in self.pairs(drive) {
                let part = self.wrong_part(wrong, used, |k| self.is_of(k, drive, pair));
                if part.is_some_and(|part| part >= self.options.pair) {
                    findings.push(self.leave_out(kind, &pair, used, |k| self.is_of(k, drive, pair)));
                }
            }
        }
        // Values that were clipped are not there.
        for pair in self.pairs(false) {
            let none = (0..used.len()).all(|k| !(self.is_of(k, false, pair) && self.is_present(k)));
            if none && !pair.iter().any(|l| dead.contains(l)) {
                findings.push(self.leave_out(FindingKind::SenseMissing, &pair, used, |k| self.is_of(k, false, pair)));
            }
        }
        findings
    }

    /// Electrodes that may be the dead ones: those that were found, and those that no value outside of these tells of.
    fn candidates(&self, wrong: &[bool], mut dead: Vec<usize>, touches: impl Fn(usize, usize) -> bool) -> Vec<usize> {
        let all = vec![true; wrong.len()];
        let hidden: Vec<usize> = (0..self.pattern.electrodes())
            .filter(|l| !dead.contains(l))
            .filter(|l| {
                let mut of = (0..wrong.len()).filter(|k| touches(*k, *l)).peekable();
                of.peek().is_some()
                    && of.all(|k| dead.iter().any(|other| touches(k, *other)))
                    && self
                        .wrong_part(wrong, &all, |k| touches(k, *l))
                        .is_none_or(|part| part >= self.options.electrode)
            })
            .collect();
        dead.extend(hidden);
        dead
    }

    /// Part of some values in use that are wrong; none where there are too few.
    fn wrong_part(&self, wrong: &[bool], used: &[bool], of: impl Fn(usize) -> bool) -> Option<f64> {
        let (mut all, mut bad) = (0_usize, 0_usize);
        for k in (0..wrong.len()).filter(|k| used[*k] && self.is_present(*k) && of(*k)) {
            all += 1;
            bad += usize::from(wrong[k]);
        }
        (all >= self.options.least_values).then(|| bad as f64 / all as f64)
    }

    fn leave_out(
        &self,
        kind: FindingKind,
        electrodes: &[usize],
        used: &mut [bool],
        of: impl Fn(usize) -> bool,
    ) -> Finding {
        let mut values = 0;
        for (_, used) in used.iter_mut().enumerate().filter(|(k, _)| of(*k)) {
            values += usize::from(*used);
            *used = false;
        }
        self.finding(kind, electrodes, None, values, true)
    }

    fn finding(
        &self,
        kind: FindingKind,
        electrodes: &[usize],
        factor: Option<f64>,
        values: usize,
        left_out: bool,
    ) -> Finding {
        Finding {
            kind,
            electrodes: electrodes.iter().map(|l| l + 1).collect(),
            value: None,
            factor,
            values,
            of: self.ln.len(),
            left_out,
        }
    }

    fn value(&self, k: usize) -> Finding {
        value_finding(self.pattern, k, self.sign[k] * (self.ln[k] - self.gain[k]).exp())
    }
}

/// The smallest part of some electrodes that takes part in all the values that these do; the first of several. Neighbours drive and
/// sense: between two dead electrodes no value tells of the one in the middle.
pub(super) fn smallest(candidates: &[usize], values: usize, touches: impl Fn(usize, usize) -> bool) -> Vec<usize> {
    if candidates.len() > MOST_CANDIDATES {
        return candidates.to_vec();
    }
    let of = |part: u32, k: usize| {
        let mut chosen = candidates.iter().enumerate().filter(|(i, _)| part >> i & 1 == 1);
        chosen.any(|(_, l)| touches(k, *l))
    };
    let all = (1_u32 << candidates.len()) - 1;
    let covered: Vec<usize> = (0..values).filter(|k| of(all, *k)).collect();
    let best = (0..=all)
        .filter(|part| covered.iter().all(|k| of(*part, *k)))
        .min_by_key(|part| part.count_ones())
        .unwrap_or(all);
    let chosen = candidates.iter().enumerate().filter(|(i, _)| best >> i & 1 == 1);
    chosen.map(|(_, l)| *l).collect()
}

/// Candidates whose parts are all tried; of more the sheet is not as described anyway.
const MOST_CANDIDATES: usize = 10;

/// A single value that is left out: so many times what is expected.
pub(crate) fn value_finding(pattern: &Pattern, k: usize, factor: f64) -> Finding {
    let m = pattern.measurements()[k];
    Finding {
        kind: FindingKind::Value,
        electrodes: [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus]
            .iter()
            .map(|l| l + 1)
            .collect(),
        value: Some(k),
        factor: Some(factor),
        values: 1,
        of: pattern.len(),
        left_out: true,
    }
}
