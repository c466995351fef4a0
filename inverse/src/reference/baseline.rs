//! The unpressed sheet, as measured: the mean of a number of frames, and their noise.

use crate::reference::moved::{Moved, moved};
use crate::reference::resolution::rounding;
use crate::stats::median;

/// A frame is unlike the others where its distance from their median is so many times the usual one. With Gaussian noise on n values
/// that distance scatters by 1/sqrt(2 n) of itself.
const UNLIKE: f64 = 5.0;
/// Or where its values are larger or smaller by more than this part of them: a source does not change that much.
const MOST_GAIN: f64 = 0.2;
/// A frame that is so many standard deviations of its noise from the middle one, along the way that the sheet moved, is none of its baseline.
const ELSEWHERE: f64 = 5.0;
/// What a value errs by where noise does not spread its samples over a converter's steps, over what rounding the mean of them adds. A step
/// of the board's converter is sixteen of the mean; of the sixteen samples of a period eight differ in size: sqrt(2 / 8) of 16.
const UNDITHERED: f64 = 8.0;
/// Variance of a value over that of rounding its mean from which its samples are spread over the converter's steps.
const DITHERED: f64 = 2.0;
/// Fewest values that tell a gain.
const FEWEST_VALUES: usize = 8;

/// Values have a noise of their own where their variances scatter by so many standard deviations more than by chance.
const CLEARLY: f64 = 3.0;
/// The variance of a value over the median one's is no less: what is that quiet has the model's error beside its noise.
const LEAST_VARIANCE: f64 = 0.1;

/// Collects frames of the unpressed sheet.
#[derive(Clone, Debug)]
pub struct BaselineTaker {
    wanted: usize,
    values: usize,
    frames: Vec<Vec<f64>>,
    of_frames: fn(usize, &[&[f64]]) -> Baseline,
    /// How often it is still taken again where the sheet moved.
    again: usize,
}

/// What the unpressed sheet gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Baseline {
    /// Mean of every value, V; not a number where no frame had one.
    pub values_v: Vec<f64>,
    /// Standard deviation of one value in one frame, V, pooled over all values.
    pub noise_v: f64,
    /// Frames that it is the mean of.
    pub frames: usize,
    /// Frames that were unlike the others, and are left out.
    pub unlike: usize,
    /// How far the sheet moved while they were measured, beside their gains: the change between the two that differ most, in standard
    /// deviations of a frame's noise (2-norm over the values). Less than 20 counts as 0; so does what nothing tells.
    pub moved: f64,
    /// Sum of the squared deviations of every value from its mean, V², and degrees of freedom of the sum; empty for a single frame.
    pub deviations: Vec<(f64, f64)>,
}

impl BaselineTaker {
    /// Waits for `wanted` frames (2 at least) of `values` values.
    pub fn new(values: usize, wanted: usize) -> Self {
        Self {
            wanted: wanted.max(2),
            values,
            frames: Vec::new(),
            of_frames: Baseline::of_frames,
            again: 0,
        }
    }

    /// The same that begins anew where the sheet moved meanwhile, so often at most.
    #[must_use]
    pub fn until_still(self, again: usize) -> Self {
        Self { again, ..self }
    }

    /// The same of which the gains of frames are noise ([`Baseline::with_gains`]), where later frames are not divided by theirs.
    #[must_use]
    pub fn with_gains(self) -> Self {
        Self {
            of_frames: Baseline::with_gains,
            ..self
        }
    }

    /// Takes a frame; the baseline once there are enough ([`Baseline::of_frames`]). Frames of another length are ignored.
    pub fn take(&mut self, frame_v: &[f64]) -> Option<Baseline> {
        if frame_v.len() != self.values {
            return None;
        }
        self.frames.push(frame_v.to_vec());
        if self.left() > 0 {
            return None;
        }
        let frames: Vec<&[f64]> = self.frames.iter().map(Vec::as_slice).collect();
        let rounding = rounding_of(self.values, of_length(self.values, &frames));
        let baseline = (self.of_frames)(self.values, &frames).of_converter(rounding.as_deref());
        if baseline.moved > 0.0 && self.again > 0 {
            self.again -= 1;
            self.frames.clear();
            return None;
        }
        Some(baseline)
    }

    /// Frames still wanted.
    pub fn left(&self) -> usize {
        self.wanted.saturating_sub(self.frames.len())
    }

    /// Whether it has no frame: it is new, or has just begun anew.
    pub const fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }
}

fn of_length<'a>(values: usize, frames: &[&'a [f64]]) -> impl Iterator<Item = &'a [f64]> {
    frames.iter().copied().filter(move |f| f.len() == values)
}

/// Standard deviation of what every value was rounded by, the least of the frames; none where one of them is not rounded.
fn rounding_of<'a>(values: usize, frames: impl Iterator<Item = &'a [f64]>) -> Option<Vec<f64>> {
    let mut frames = frames.filter(|frame| frame.iter().any(|v| v.is_finite()));
    frames.try_fold(vec![f64::INFINITY; values], |finest, frame| {
        let both = finest.into_iter().zip(rounding(frame)?);
        Some(both.map(|(least, own)| own.min(least)).collect())
    })
}

/// How the sheet moved while these frames, each with its gain, were measured. Of rounded values many are the same in all frames, and are so no
/// more when each frame is divided by its gain: it moved where it did in both.
fn moved_of(values: usize, frames: &[(f64, &[f64])]) -> Option<Moved> {
    let rounding = rounding_of(values, frames.iter().map(|(_, frame)| *frame));
    let of = |divides: bool| {
        let frame = |j: usize| {
            let (gain, frame) = frames[j];
            frame.iter().map(|v| if divides { v / gain } else { *v }).collect()
        };
        moved(frames.len(), frame, rounding.as_deref())
    };
    let as_they_are = of(false)?;
    let divided = of(true)?;
    Some(if divided.sd <= as_they_are.sd {
        divided
    } else {
        as_they_are
    })
}

/// Sums over the finite values of frames (Welford 1962).
struct Sums {
    count: Vec<f64>,
    mean: Vec<f64>,
    /// Sum of squared deviations.
    deviation: Vec<f64>,
}

impl Sums {
    fn of(values: usize, frames: &[Vec<f64>]) -> Self {
        let mut sums = Self {
            count: vec![0.0; values],
            mean: vec![0.0; values],
            deviation: vec![0.0; values],
        };
        for frame in frames {
            for (k, v) in frame.iter().enumerate().filter(|(_, v)| v.is_finite()) {
                sums.count[k] += 1.0;
                let step = v - sums.mean[k];
                sums.mean[k] += step / sums.count[k];
                sums.deviation[k] += step * (v - sums.mean[k]);
            }
        }
        sums
    }
}

/// Frames that are like most, each with its gain over their mean. `None` where no three, or not most of them, are alike.
///
/// A value counts by its own noise: an electrode that floats spoils no gain.
fn alike<'a>(values: usize, frames: &[&'a [f64]]) -> Option<Vec<(f64, &'a [f64])>> {
    let of_frames = |k: usize| frames.iter().map(move |f| f[k]);
    let middle: Vec<f64> = (0..values).map(|k| median(of_frames(k))).collect();
    let deviations: Vec<f64> = (middle.iter().enumerate())
        .map(|(k, m)| median(of_frames(k).map(|v| (v - m).abs())))
        .collect();
    let usual = median(deviations.iter().copied());
    // Where most values never change, noise is less than a step of the converter, and the few that step tell no gain by themselves.
    let weight = |deviation: &f64| {
        if usual > 0.0 {
            deviation.max(usual).powi(-2)
        } else {
            1.0
        }
    };
    let weights: Vec<f64> = deviations.iter().map(weight).collect();
    let known = |frame: &'a [f64]| {
        let values = frame.iter().zip(&middle).zip(&weights);
        values.filter(|((v, _), _)| v.is_finite())
    };
    let gain = |frame: &'a [f64]| {
        let products = known(frame).map(|((v, m), w)| [w * v * m, w * m * m]);
        let [own, all] = products.fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]]);
        own / all
    };
    let off = |(gain, frame): &(f64, &'a [f64])| {
        let squares = known(frame).map(|((v, m), w)| w * (v / gain - m).powi(2));
        (squares.sum::<f64>() / known(frame).count().max(1) as f64).sqrt()
    };
    let gained = frames.iter().map(|frame| (gain(frame), *frame));
    let alike: Vec<(f64, &[f64])> = gained.filter(|(gain, _)| (gain - 1.0).abs() <= MOST_GAIN).collect();
    let offs: Vec<f64> = alike.iter().map(off).collect();
    let most = UNLIKE * median(offs.iter().copied());
    // Of values that most frames have to the last bit, noise is not known.
    let kept = alike
        .into_iter()
        .zip(offs)
        .filter(|(_, off)| most == 0.0 || *off <= most);
    let mut kept: Vec<(f64, &[f64])> = kept.map(|(frame, _)| frame).collect();
    let mean = kept.iter().map(|(gain, _)| gain).sum::<f64>() / kept.len() as f64;
    kept.iter_mut().for_each(|(gain, _)| *gain /= mean);
    (kept.len() > 2 && 2 * kept.len() > frames.len()).then_some(kept)
}

impl Baseline {
    /// Whether both are the same to the last bit; values that neither has are the same.
    pub fn is_same(&self, other: &Self) -> bool {
        let bits = |of: &Self| {
            let deviations = of.deviations.iter().flat_map(|(sum, degrees)| [*sum, *degrees]);
            let all = of.values_v.iter().copied().chain([of.noise_v]).chain(deviations);
            all.map(f64::to_bits).collect::<Vec<_>>()
        };
        (self.frames, self.unlike) == (other.frames, other.unlike) && bits(self) == bits(other)
    }

    /// Of given frames of so many values (any unit): the mean of every value over the frames that have it. Frames of another length, and
    /// those without any value, are ignored. Frames that are unlike most are left out, and each counts over its gain. Where no three, or not
    /// most of them, are alike, it is the plain mean of all. So it is with fewer than eight values.
    pub fn of_frames(values: usize, frames: &[&[f64]]) -> Self {
        Self::of_alike(values, frames, true)
    }

    /// The same without division by gains: what they do to the values is noise.
    pub fn with_gains(values: usize, frames: &[&[f64]]) -> Self {
        Self::of_alike(values, frames, false)
    }

    /// The plain mean of all frames.
    pub fn plain(values: usize, frames: &[&[f64]]) -> Self {
        let copies: Vec<Vec<f64>> = of_length(values, frames).map(<[f64]>::to_vec).collect();
        let rounding = rounding_of(values, of_length(values, frames));
        Self::mean_of(values, &copies).of_rounded(rounding.as_deref())
    }

    /// No value is known better than rounding lets, where every frame is on steps: of a coarse converter most values are the same in all
    /// of them, and some step by chance.
    fn of_rounded(mut self, rounding: Option<&[f64]>) -> Self {
        if let Some(rounding) = rounding {
            let deviations = self
                .deviations
                .iter_mut()
                .zip(rounding)
                .filter(|(_, sd)| sd.is_finite());
            deviations.for_each(|((square, freedom), sd)| *square = square.max(*freedom * sd * sd));
            self.noise_v = pooled(self.deviations.iter());
        }
        self
    }

    /// The same of a converter whose samples are averaged. Where noise is no more than the rounding of the mean in most values, it does not
    /// spread the samples over the converter's own steps either, which are larger.
    fn of_converter(self, rounding: Option<&[f64]>) -> Self {
        let Some(rounding) = rounding else { return self };
        let known = self.deviations.iter().zip(rounding).filter(|(_, sd)| sd.is_finite());
        let parts = known.map(|((square, freedom), sd)| square / (freedom * sd * sd));
        if median(parts) > DITHERED {
            return self;
        }
        let coarse: Vec<f64> = rounding.iter().map(|sd| UNDITHERED * sd).collect();
        self.of_rounded(Some(&coarse))
    }

    fn of_alike(values: usize, frames: &[&[f64]], divides: bool) -> Self {
        let known: Vec<&[f64]> = of_length(values, frames)
            .filter(|f| f.iter().any(|v| v.is_finite()))
            .collect();
        let told = (values >= FEWEST_VALUES).then(|| alike(values, &known)).flatten();
        let Some(mut kept) = told else {
            let moved = moved_of(values, &known.iter().map(|frame| (1.0, *frame)).collect::<Vec<_>>());
            return Self {
                moved: moved.map_or(0.0, |moved| moved.sd),
                ..Self::plain(values, frames)
            };
        };
        let over = |(gain, frame): &(f64, &[f64])| {
            let gain = if divides { *gain } else { 1.0 };
            frame.iter().map(|v| v / gain).collect()
        };
        let mut moved = moved_of(values, &kept);
        // Where most frames are at one place, the others are none of the baseline.
        if let Some(Moved { along, .. }) = moved.as_ref().filter(|moved| moved.along.len() == kept.len()) {
            let there = kept.iter().zip(along).filter(|(_, along)| along.abs() < ELSEWHERE);
            let there: Vec<(f64, &[f64])> = there.map(|(frame, _)| *frame).collect();
            // Of frames that are the same to the last bit noise is not known.
            let have_noise = there.windows(2).any(|pair| pair[0].1 != pair[1].1);
            if 2 * there.len() > known.len() && have_noise && moved_of(values, &there).is_none() {
                (kept, moved) = (there, None);
            }
        }
        let moved = moved.map_or(0.0, |moved| moved.sd);
        let rounding = rounding_of(values, kept.iter().map(|(_, frame)| *frame));
        let mut baseline = Self {
            unlike: known.len() - kept.len(),
            moved,
            ..Self::mean_of(values, &kept.iter().map(over).collect::<Vec<Vec<f64>>>())
        };
        if divides {
            // A frame's gain takes one of its degrees of freedom.
            let left = 1.0 - 1.0 / values as f64;
            baseline.deviations.iter_mut().for_each(|(_, freedom)| *freedom *= left);
        }
        baseline.noise_v = pooled(baseline.deviations.iter());
        baseline.of_rounded(rounding.as_deref())
    }

    fn mean_of(values: usize, frames: &[Vec<f64>]) -> Self {
        let sums = Sums::of(values, frames);
        let deviations: Vec<(f64, f64)> = match frames.len() {
            0 | 1 => Vec::new(),
            _ => {
                let freedom = sums.count.iter().map(|c| (c - 1.0).max(0.0));
                sums.deviation.iter().copied().zip(freedom).collect()
            }
        };
        let mean = |(m, c): (&f64, &f64)| if *c > 0.0 { *m } else { f64::NAN };
        Self {
            values_v: sums.mean.iter().zip(&sums.count).map(mean).collect(),
            noise_v: pooled(deviations.iter()),
            frames: frames.len(),
            unlike: 0,
            moved: 0.0,
            deviations,
        }
    }

    /// Standard deviation of every value by itself in one frame, V; not a number where fewer than two frames had one.
    pub fn value_noise_v(&self) -> Vec<f64> {
        let of = |k: usize| match self.deviations.get(k) {
            Some((square, freedom)) if *freedom > 0.0 => (square / freedom).sqrt(),
            _ => f64::NAN,
        };
        (0..self.values_v.len()).map(of).collect()
    }

    /// Whether its values are no larger than the noise of a frame, root mean square: nothing was measured.
    pub fn is_nothing(&self) -> bool {
        let squares: Vec<f64> = (self.values_v.iter().filter(|v| v.is_finite()).map(|v| v * v)).collect();
        let square = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
        self.noise_v > 0.0 && square <= self.noise_v * self.noise_v
    }

    /// Noise of every value over [`Baseline::noise_v`]: 1 where nothing tells that it has another than the rest.
    ///
    /// A few frames tell the variance of one value badly, and that of all of them well. So each is drawn towards their mean, as far as
    /// they scatter by what chance would make of one variance (credibility: Bühlmann 1967). Values in proportion to which a source or a
    /// reference is noisy have a noise of their own, and so have those of a noisy amplifier.
    pub fn own_noise(&self) -> Vec<f64> {
        let mean = self.noise_v * self.noise_v;
        let told: Vec<Option<(f64, f64)>> = (0..self.values_v.len())
            .map(|k| {
                let (square, freedom) = *self.deviations.get(k)?;
                (freedom > 0.0 && mean > 0.0).then(|| (square / freedom / mean, freedom))
            })
            .collect();
        let count = told.iter().flatten().count().max(1) as f64;
        let mean_of = |f: &dyn Fn(&(f64, f64)) -> f64| told.iter().flatten().map(f).sum::<f64>() / count;
        let scatter = mean_of(&|(own, _)| (own - 1.0).powi(2));
        // The mean square of a variance's own scatter, and the variance of that: moments of chi-square.
        let by_chance = mean_of(&|(_, freedom)| 2.0 / freedom);
        let its_variance = mean_of(&|(_, freedom)| (2.0 / freedom).powi(2) * (2.0 + 12.0 / freedom));
        let clear = scatter > by_chance + CLEARLY * (its_variance / count).sqrt();
        let credible = if clear { 1.0 - by_chance / scatter } else { 0.0 };
        let variance = |own: &Option<(f64, f64)>| own.map_or(1.0, |(own, _)| 1.0 + credible * (own - 1.0));
        let variances: Vec<f64> = told.iter().map(variance).collect();
        let least = LEAST_VARIANCE * median(variances.iter().copied());
        variances.iter().map(|v| v.max(least).sqrt()).collect()
    }

    /// Sums of squared deviations that so many frames with this standard deviation of every value have; what is no number
    /// stands for a value without any.
    pub fn deviations_of(value_noise_v: &[f64], frames: usize) -> Vec<(f64, f64)> {
        let freedom = frames.saturating_sub(1) as f64;
        let of = |sd: &f64| {
            if sd.is_finite() {
                (sd * sd * freedom, freedom)
            } else {
                (0.0, 0.0)
            }
        };
        value_noise_v.iter().map(of).collect()
    }

    /// The same without the values that are not `used`: they are missing, and their noise is not pooled with that of the others.
    pub fn without(mut self, used: &[bool]) -> Self {
        if used.iter().all(|u| *u) {
            return self;
        }
        for (v, _) in self.values_v.iter_mut().zip(used).filter(|(_, used)| !**used) {
            *v = f64::NAN;
        }
        for (d, _) in self.deviations.iter_mut().zip(used).filter(|(_, used)| !**used) {
            *d = (0.0, 0.0);
        }
        if !self.deviations.is_empty() {
            self.noise_v = pooled(self.deviations.iter());
        }
        self
    }

    /// Relative noise of the mean of one value, root mean square; 0 for a single frame.
    pub fn relative_noise(&self) -> f64 {
        let frames = self.frames.max(1) as f64;
        let squares: Vec<f64> = self
            .values_v
            .iter()
            .filter(|v| v.is_finite() && **v != 0.0)
            .map(|v| (self.noise_v / v).powi(2) / frames)
            .collect();
        (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
    }
}

/// Standard deviation from sums of squared deviations and their degrees of freedom.
fn pooled<'a>(deviations: impl Iterator<Item = &'a (f64, f64)> + Clone) -> f64 {
    let squares: f64 = deviations.clone().map(|d| d.0).sum();
    let freedom: f64 = deviations.map(|d| d.1).sum();
    (squares / freedom.max(1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::resolution::rounding_sd;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    #[test]
    fn mean_and_noise_are_those_of_the_frames() {
        let mut rng = rand::rngs::StdRng::seed_from_u64(5);
        let mut taker = BaselineTaker::new(208, 40);
        let mut baseline = None;
        for frame in 0..40 {
            assert!(baseline.is_none());
            let values: Vec<f64> = (0..208)
                .map(|k| {
                    let noise: f64 = rng.sample(StandardNormal);
                    if k == 7 || (k == 9 && frame < 20) {
                        f64::NAN
                    } else {
                        k as f64 + 0.01 * noise
                    }
                })
                .collect();
            baseline = taker.take(&values);
        }
        let b = baseline.unwrap();
        assert!(b.values_v[7].is_nan());
        assert!((b.noise_v / 0.01 - 1.0).abs() < 0.03, "{}", b.noise_v);
        assert!(b.value_noise_v()[7].is_nan());
        let noise = b.value_noise_v();
        let each = noise.iter().filter(|s| s.is_finite()).map(|s| s * s);
        let mean = each.sum::<f64>() / 207.0;
        assert!((mean.sqrt() / 0.01 - 1.0).abs() < 0.03, "{mean}");
        assert!((b.values_v[9] - 9.0).abs() < 0.01 && (b.values_v[200] - 200.0).abs() < 0.01);
        assert_eq!(taker.left(), 0);
    }

    #[test]
    fn given_frames_make_the_baseline_that_taken_ones_do() {
        let frames = [[1.0, 2.0, f64::NAN], [1.5, f64::NAN, f64::NAN], [2.0, 4.0, f64::NAN]];
        let list: Vec<&[f64]> = frames.iter().map(|f| f.as_slice()).collect();
        let given = Baseline::of_frames(3, &list);
        let mut taker = BaselineTaker::new(3, 3);
        let taken = frames.iter().filter_map(|f| taker.take(f)).next().unwrap();
        assert_eq!(given.values_v[..2], [1.5, 3.0]);
        assert!(given.values_v[2].is_nan());
        assert_eq!((given.noise_v, given.frames), (taken.noise_v, 3));
    }

    /// So many frames of the same values with noise, and a gain each.
    fn frames(count: usize, gain_sd: f64, seed: u64) -> Vec<Vec<f64>> {
        let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
        let frame = |_| {
            let gain = 1.0 + gain_sd * rng.sample::<f64, _>(StandardNormal);
            let value = |k: usize| gain * (1.0 + (k % 16) as f64) + NOISE * rng.sample::<f64, _>(StandardNormal);
            (0..208).map(value).collect()
        };
        (0..count).map(frame).collect()
    }

    const NOISE: f64 = 0.01;

    fn of(frames: &[Vec<f64>]) -> Baseline {
        Baseline::of_frames(208, &frames.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    #[test]
    fn frames_unlike_the_others_are_left_out_and_spoil_nothing() {
        type Spoil = fn(&mut Vec<f64>);
        let spoils: [Spoil; 6] = [
            |f| f.fill(0.0),
            |f| f.iter_mut().for_each(|v| *v = -*v),
            |f| f.iter_mut().for_each(|v| *v *= 1000.0),
            |f| f.rotate_left(1),
            |f| f[7] *= 3.0,
            |f| f[16..48].fill(0.5),
        ];
        for count in [5, 8, 80] {
            let clean = frames(count, 0.0, 1);
            let without = of(&clean[1..]);
            assert_eq!(of(&clean).unlike, 0);
            for (k, spoil) in spoils.iter().enumerate() {
                let mut spoilt = clean.clone();
                spoil(&mut spoilt[0]);
                let found = of(&spoilt);
                assert_eq!((found.unlike, found.frames), (1, count - 1), "{count} {k}");
                assert!((found.noise_v / without.noise_v - 1.0).abs() < 1e-2, "{count} {k}");
                let pairs = found.values_v.iter().zip(&without.values_v);
                let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(off < 0.1 * NOISE, "{count} {k}: {off}");
            }
        }
    }

    #[test]
    fn a_gain_of_every_frame_is_no_noise() {
        for gain_sd in [0.0, 0.003, 0.03] {
            let found = of(&frames(80, gain_sd, 2));
            assert_eq!(found.unlike, 0);
            assert!(
                (found.noise_v / NOISE - 1.0).abs() < 0.03,
                "{gain_sd}: {}",
                found.noise_v
            );
        }
    }

    /// An electrode that hangs in the air: a quarter of the values are its hum, and larger than all others.
    #[test]
    fn a_floating_electrode_makes_no_noise_of_other_values() {
        for (count, seed) in [(8, 4), (24, 5), (80, 6)] {
            let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
            let mut frames = frames(count, 0.003, seed);
            for frame in &mut frames {
                let floating = frame.iter_mut().step_by(4);
                floating.for_each(|v| *v = 20.0 * rng.sample::<f64, _>(StandardNormal));
            }
            let found = of(&frames);
            assert_eq!(found.unlike, 0);
            let noise = found.value_noise_v();
            let healthy = noise.iter().enumerate().filter(|(k, _)| k % 4 != 0);
            let mean = healthy.map(|(_, sd)| sd * sd).sum::<f64>() / 156.0;
            assert!((mean.sqrt() / NOISE - 1.0).abs() < 0.1, "{count}: {}", mean.sqrt());
        }
    }

    /// Most values are then the same in every frame, and the few that step make no noise of them.
    #[test]
    fn values_that_are_rounded_stay_what_they_are() {
        let step = 10.0 * NOISE;
        let mut frames = frames(80, 0.0, 8);
        let rounded = |(k, v): (usize, &mut f64)| {
            // One in eight is at the edge of a step.
            let at = if k % 8 == 0 { 0.5 } else { 0.0 };
            *v = (*v / step + at).round() * step;
        };
        frames
            .iter_mut()
            .for_each(|f| f.iter_mut().enumerate().for_each(rounded));
        let list: Vec<&[f64]> = frames.iter().map(Vec::as_slice).collect();
        let (found, plain) = (Baseline::of_frames(208, &list), Baseline::plain(208, &list));
        assert!(
            found.noise_v < 1.05 * plain.noise_v,
            "{} {}",
            found.noise_v,
            plain.noise_v
        );
        let pairs = found.values_v.iter().zip(&plain.values_v);
        let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 0.1 * NOISE, "{off}");
    }

    /// A gain that is not divided by is noise, in proportion to the value.
    #[test]
    fn gains_are_noise_where_they_are_kept() {
        let frames = frames(80, 0.01, 7);
        let list: Vec<&[f64]> = frames.iter().map(Vec::as_slice).collect();
        let kept = Baseline::with_gains(208, &list).value_noise_v();
        for (k, sd) in kept.iter().enumerate() {
            let expected = NOISE.hypot(0.01 * (1.0 + (k % 16) as f64));
            assert!((sd / expected - 1.0).abs() < 0.35, "{k}: {sd} {expected}");
        }
        assert_eq!(Baseline::plain(208, &list).unlike, 0);
    }

    #[test]
    fn of_frames_that_have_nothing_in_common_none_is_preferred() {
        let mut frames = frames(6, 0.0, 3);
        let mut scale = 1.0;
        for frame in &mut frames {
            frame.iter_mut().for_each(|v| *v *= scale);
            scale *= 2.0;
        }
        let found = of(&frames);
        assert_eq!((found.unlike, found.frames), (0, 6));
        let mean = frames.iter().map(|f| f[5]).sum::<f64>() / 6.0;
        assert!((found.values_v[5] - mean).abs() < 1e-9);
        // Nor of those that are the same to the last bit but for one.
        let mut same = vec![frames[0].clone(); 5];
        same.push(frames[0].iter().map(|v| v + NOISE).collect());
        assert_eq!(of(&same).unlike, 0);
    }

    /// So many frames of 208 values with a standard deviation each.
    fn frames_of(count: usize, sd: impl Fn(usize) -> f64, seed: u64) -> Baseline {
        let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
        let mut value = |k: usize| 1.0 + (k % 4) as f64 + sd(k) * rng.sample::<f64, _>(StandardNormal);
        let list: Vec<Vec<f64>> = (0..count).map(|_| (0..208).map(&mut value).collect()).collect();
        of(&list)
    }

    /// What a value's variance is told to be over the true one: the mean, and the root mean square of what is off.
    fn told_over_true(count: usize, sd: fn(usize) -> f64) -> (f64, f64) {
        let baseline = frames_of(count, sd, 17);
        let own = baseline.own_noise();
        let ratios: Vec<f64> = (0..208).map(|k| (own[k] * baseline.noise_v / sd(k)).powi(2)).collect();
        let off: f64 = ratios.iter().map(|r| (r - 1.0).powi(2)).sum();
        (ratios.iter().sum::<f64>() / 208.0, (off / 208.0).sqrt())
    }

    /// The variance of n frames scatters by sqrt(2 / (n - 1)). Where all values have the same noise, that told of each does not scatter.
    /// Where they have not, it does by no more than this.
    #[test]
    fn a_value_has_the_noise_of_all_unless_it_has_its_own() {
        for count in [3, 8, 80] {
            assert_eq!(frames_of(count, |_| 1e-3, 17).own_noise(), [1.0; 208], "{count}");
        }
        let by_chance = (2.0_f64 / 79.0).sqrt();
        let noises: [fn(usize) -> f64; 3] = [
            // In proportion to the value; of one amplifier; of a value.
            |k| 1e-3 * (1.0 + (k % 4) as f64),
            |k| if k % 13 == 5 { 1e-2 } else { 1e-3 },
            |k| if k == 50 { 2e-2 } else { 1e-3 },
        ];
        for noise in noises {
            let (mean, off) = told_over_true(80, noise);
            assert!((mean - 1.0).abs() < 0.1 && off < 1.3 * by_chance, "{mean} {off}");
        }
    }

    /// A converter with steps of ten times the noise: values that are the same in every frame are no better known than those that step.
    #[test]
    fn rounding_is_noise_of_every_value() {
        let step = 10.0 * NOISE;
        let mut rng = rand::rngs::StdRng::seed_from_u64(12);
        let mut rounded = |k: usize| {
            let value = 1.0 + 0.37 * k as f64 + NOISE * rng.sample::<f64, _>(StandardNormal);
            (value / step).round() * step
        };
        let list: Vec<Vec<f64>> = (0..24).map(|_| (0..208).map(&mut rounded).collect()).collect();
        let baseline = of(&list);
        for own in baseline.own_noise() {
            let sd = own * baseline.noise_v / rounding_sd(step);
            assert!((0.95..3.0).contains(&sd), "{sd}");
        }
    }

    /// Sixteen samples of a sine, each rounded to sixteen steps of the mean: what values of a touch err by is no more than a baseline says,
    /// whether noise spreads the samples over the steps or not.
    #[test]
    fn a_converter_whose_steps_noise_does_not_reach_is_no_better_than_its_steps() {
        let mut rng = rand::rngs::StdRng::seed_from_u64(14);
        let amplitude = |k: usize| 3.0 + 0.61 * k as f64;
        for noise in [0.0, 0.03, 0.5] {
            let mut measured = |amplitude: f64| -> f64 {
                let product = |j: usize| {
                    let wave = (std::f64::consts::TAU * (j as f64 + 0.3) / 16.0).cos();
                    (amplitude * wave + noise * rng.sample::<f64, _>(StandardNormal)).round() * wave
                };
                let mean = (0..32).map(product).sum::<f64>() / 16.0;
                (mean * 16.0).round() / 16.0
            };
            let mut taker = BaselineTaker::new(208, 24);
            let taken =
                (0..24).filter_map(|_| taker.take(&(0..208).map(|k| measured(amplitude(k))).collect::<Vec<_>>()));
            let baseline = taken.collect::<Vec<_>>().pop().unwrap();
            let errors = baseline.values_v.iter().enumerate().map(|(k, v)| {
                // What a touch changes by less than a step.
                measured(amplitude(k) + 0.4) - v - 0.4
            });
            let error = (errors.map(|e| e * e).sum::<f64>() / 208.0).sqrt();
            let times = error / baseline.noise_v;
            assert!((0.5..1.8).contains(&times), "{noise}: {error} {}", baseline.noise_v);
        }
    }

    /// Frames that are left out, and frames of which one is on steps by chance, tell nothing of rounding.
    #[test]
    fn a_frame_on_steps_makes_no_noise_of_the_others() {
        let mut frames = frames(24, 0.0, 13);
        let without = of(&frames).noise_v;
        let mut counts = frames[0].clone();
        counts.iter_mut().enumerate().for_each(|(k, v)| *v = (1 + k % 7) as f64);
        frames.push(counts);
        let found = of(&frames);
        assert_eq!((found.unlike, found.frames), (1, 24));
        assert!((found.noise_v / without - 1.0).abs() < 1e-2);
        frames[24] = frames[0]
            .iter()
            .map(|v| (v / (8.0 * NOISE)).round() * 8.0 * NOISE)
            .collect();
        let list: Vec<&[f64]> = frames.iter().map(Vec::as_slice).collect();
        assert!(Baseline::plain(208, &list).noise_v < 1.5 * without);
    }

    #[test]
    fn a_noise_that_is_not_told_is_that_of_all() {
        assert_eq!(frames_of(1, |_| 1e-3, 1).own_noise(), [1.0; 208]);
        assert_eq!(frames_of(5, |_| 0.0, 1).own_noise(), [1.0; 208]);
        let some = |k: usize| if k.is_multiple_of(2) { 0.0 } else { 1e-3 };
        assert!(
            frames_of(80, some, 1)
                .own_noise()
                .iter()
                .all(|own| *own > 0.0 && own.is_finite())
        );
    }
}
