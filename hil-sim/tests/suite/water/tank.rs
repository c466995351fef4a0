//! A tank of water with a ring of electrodes: Fourier series, fitted to a frame, and the simulated sheet in its place.

use forward::{Drive, Pattern, Place, Sheet};
use hil_sim::{Rubber, Scene, SheetModel};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::{PI, TAU};

/// Electrodes of a tank.
pub(crate) const COUNT: usize = 16;

/// How far off an electrode is expected to be before anything is measured, rad: 2 degrees. It settles what hardly shows:
/// a turn of all does not show at all, and one of the kind sin(angle) is nearly a conformal map of the disc onto itself.
const OFF: f64 = 2.0 * PI / 180.0;

/// What a value is taken to be wrong by in a fit. It counts against the widths of what is known beforehand only.
const ERROR: f64 = 0.014;

/// A cylinder of water with electrodes over the middle of its height.
#[derive(Clone, Debug)]
pub(crate) struct Tank {
    /// Depth of the water in radii; 0: a flat sheet.
    pub(crate) depth: f64,
    /// Height of the electrodes, as a part of the depth.
    pub(crate) height: f64,
    /// Half the angle that an electrode covers.
    pub(crate) half_angle: f64,
    /// How far each electrode is from where it should be, rad.
    pub(crate) off: [f64; COUNT],
}

fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { x.sin() / x }
}

impl Tank {
    /// Fourier coefficients of the potential around the rim for a unit current from one electrode. With `z` along the
    /// axis the field is a sum of `cos(2 pi j z / depth)`; the first, even one is that of a sheet, `1/n` for each order n of
    /// the angle, and the others `I_n(x) / (x I_n'(x))` with `x = 2 pi j / depth`.
    fn orders(&self) -> Vec<f64> {
        const ORDERS: usize = 400;
        let mut response: Vec<f64> = (0..ORDERS).map(|n| if n == 0 { 0.0 } else { 1.0 / n as f64 }).collect();
        for j in 1..if self.depth > 0.0 { 60 } else { 1 } {
            let x = TAU * f64::from(j) / self.depth;
            let weight = 2.0 * sinc(PI * f64::from(j) * self.height).powi(2);
            // I_{n+1}(x) / I_n(x) from far above, where it is next to nothing (Miller).
            let mut ratio = 0.0;
            for n in (0..ORDERS + 200).rev() {
                ratio = 1.0 / (2.0 * (n as f64 + 1.0) / x + ratio);
                if n < ORDERS {
                    let once = if n == 0 { 0.5 } else { 1.0 };
                    response[n] += weight * once / (x * (ratio + n as f64 / x));
                }
            }
        }
        let spread = |(n, r): (usize, &f64)| r * sinc(n as f64 * self.half_angle).powi(2);
        response.iter().enumerate().map(spread).collect()
    }

    /// Logarithms of the transfer impedances, in the pattern's order.
    pub(crate) fn frame(&self) -> Vec<f64> {
        let orders = self.orders();
        let at: Vec<f64> = (0..COUNT)
            .map(|l| TAU * l as f64 / COUNT as f64 + self.off[l])
            .collect();
        let p = DMatrix::from_fn(COUNT, COUNT, |i, j| {
            // cos(n a) by their recurrence.
            let twice = 2.0 * (at[i] - at[j]).cos();
            let (mut before, mut now, mut sum) = (0.5 * twice, 1.0, 0.0);
            for order in &orders {
                sum += order * now;
                (before, now) = (now, twice * now - before);
            }
            sum
        });
        let value = |m: &forward::Measurement| {
            let (d, s) = (m.drive, m.sense);
            p[(s.plus, d.plus)] - p[(s.minus, d.plus)] - p[(s.plus, d.minus)] + p[(s.minus, d.minus)]
        };
        pattern().measurements().iter().map(|m| value(m).ln()).collect()
    }

    /// The tank of some parameters, each of which is 0 with a standard deviation of 1 before anything is measured.
    fn with(parameters: &DVector<f64>) -> Self {
        let part = |x: f64| 1.0 / (1.0 + (-x).exp());
        Self {
            depth: 2.0 * parameters[0].exp(),
            height: part(parameters[1]),
            half_angle: PI / COUNT as f64 * part(parameters[2]),
            off: std::array::from_fn(|l| parameters.get(3 + l).map_or(0.0, |x| x * OFF)),
        }
    }

    /// The tank that fits those values of a frame (logarithms) for which `used` is true best, after one gain, by Levenberg's
    /// and Marquardt's method; none if that finds no end.
    pub(crate) fn fitted(frame: &[f64], used: &dyn Fn(usize) -> bool, angles: bool) -> Option<Self> {
        let chosen: Vec<usize> = (0..frame.len()).filter(|k| used(*k)).collect();
        let misfit = |q: &DVector<f64>| {
            let model = Self::with(q).frame();
            let off = without_mean(chosen.iter().map(|k| frame[*k] - model[*k]).collect());
            DVector::from_vec(off.iter().map(|x| x / ERROR).chain(q.iter().copied()).collect())
        };
        let mut q = DVector::zeros(if angles { 3 + COUNT } else { 3 });
        let mut now = misfit(&q);
        let mut damping = 1.0;
        for _ in 0..200 {
            let columns: Vec<DVector<f64>> = (0..q.len())
                .map(|k| {
                    let mut there = q.clone();
                    there[k] += 1e-5;
                    (misfit(&there) - &now) / 1e-5
                })
                .collect();
            let jacobian = DMatrix::from_columns(&columns);
            let normal = jacobian.transpose() * &jacobian;
            let damped = &normal + DMatrix::from_diagonal(&(normal.diagonal() * damping));
            let there = &q - damped.cholesky().unwrap().solve(&(jacobian.transpose() * &now));
            let then = misfit(&there);
            let gain = 1.0 - then.norm_squared() / now.norm_squared();
            if gain > 0.0 {
                (q, now) = (there, then);
                damping *= 0.1;
            } else {
                damping *= 10.0;
            }
            if gain.abs() < 1e-7 {
                return Some(Self::with(&q));
            }
        }
        None
    }
}

pub(crate) fn pattern() -> Pattern {
    Pattern::adjacent(COUNT).unwrap()
}

/// What the simulator's sheet gives with electrodes at a tank's angles, times the series' factor from such a sheet to the
/// tank's depth; logarithms. The contacts are poor, so that no electrode shorts what is before it: with widths from 0.05 to
/// 0.15 rad the water is the nearer to the simulation the poorer they are, from 0.1 to 100 mm of sheet.
pub(crate) fn simulated(tank: &Tank) -> Vec<f64> {
    let mut sheet = Sheet::disc(195.0, COUNT, 195.0 * tank.half_angle, 1000.0, 1000.0);
    for (electrode, off) in sheet.electrodes.iter_mut().zip(tank.off) {
        let Place::Angle { angle_deg, .. } = &mut electrode.place else {
            unreachable!("a disc's electrodes are given by their angles");
        };
        *angle_deg += off.to_degrees();
    }
    let mut rubber = Rubber::new(&sheet, Scene::empty()).unwrap();
    let flat = Drive::Current { amplitude_a: 1.0 }.frame_v(rubber.electrode_matrix(0.0).unwrap(), &pattern());
    let as_sheet = Tank {
        depth: 0.0,
        ..tank.clone()
    };
    let factor = tank.frame().into_iter().zip(as_sheet.frame()).map(|(a, b)| a - b);
    flat.iter().zip(factor).map(|(v, f)| v.ln() + f).collect()
}

/// What is left without the mean.
pub(crate) fn without_mean(mut values: Vec<f64>) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter_mut().for_each(|v| *v -= mean);
    values
}
