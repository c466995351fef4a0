//! A press-and-hold: what was pressed and what the sheet showed, over time.

use thiserror::Error;

/// A press or a release does not show in a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error(
    "no press and release can be told from the noise; begin to record before the press, hold it, and go on after the \
     release, or give the force over time in a column force_n"
)]
pub struct NoEdges;

/// One frame of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time, s.
    pub time_s: f64,
    /// Force that the gauge showed, N.
    pub force_n: f64,
    /// Integrated relative rise of the resistivity, mm²; 0 where no touch was found.
    pub total_mm2: f64,
    /// Area of the touch, mm², where one was found.
    pub area_mm2: Option<f64>,
    /// Whether it takes part in a fit: not while the force is only guessed, nor where a dent is too small to be found.
    pub used: bool,
}

/// Half of the time over which an edge is looked for, s.
const EDGE_S: f64 = 0.25;
/// Least step of an edge over the scatter of the steps.
const LEAST_EDGE: f64 = 10.0;

/// Writes the forces of one press that was held at a force (N) from its rises alone: the press is where they rise fastest, the
/// release where they fall fastest. What is measured during those takes no part in a fit.
///
/// # Errors
/// [`NoEdges`] where press and release do not stand out of the scatter.
pub fn hold(samples: &mut [Sample], force_n: f64) -> Result<(), NoEdges> {
    // Mean rise over a quarter of a second after a time less that before it.
    let step = |k: usize| {
        let t = samples[k].time_s;
        let mean = |low: f64, high: f64| {
            let inside: Vec<f64> = samples
                .iter()
                .filter(|s| s.time_s > low && s.time_s <= high)
                .map(|s| s.total_mm2)
                .collect();
            (!inside.is_empty()).then(|| inside.iter().sum::<f64>() / inside.len() as f64)
        };
        Some(mean(t, t + EDGE_S)? - mean(t - EDGE_S, t)?)
    };
    let steps: Vec<(usize, f64)> = (0..samples.len()).filter_map(|k| Some((k, step(k)?))).collect();
    let best = |list: &mut dyn Iterator<Item = &(usize, f64)>, sign: f64| {
        list.max_by(|a, b| (sign * a.1).total_cmp(&(sign * b.1))).copied()
    };
    let (press, up) = best(&mut steps.iter(), 1.0).ok_or(NoEdges)?;
    let (release, down) = best(&mut steps.iter().filter(|s| s.0 > press), -1.0).ok_or(NoEdges)?;
    let mut sizes: Vec<f64> = steps.iter().map(|s| s.1.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let scatter = sizes[sizes.len() / 2];
    let (on_s, off_s) = (samples[press].time_s, samples[release].time_s);
    if up.min(-down) <= LEAST_EDGE * scatter || off_s - on_s < 4.0 * EDGE_S {
        return Err(NoEdges);
    }
    for s in samples {
        let t = s.time_s;
        s.used = s.used && (t - on_s).abs() > EDGE_S && (t - off_s).abs() > EDGE_S;
        s.force_n = if t > on_s && t <= off_s { force_n } else { 0.0 };
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hold_is_found_in_its_rises() {
        let rise = |t: f64| match t {
            t if t < 2.0 => 0.0,
            t if t < 12.0 => 100.0 + 3.0 * (t - 2.0),
            t => 30.0 * (-(t - 12.0) / 5.0).exp(),
        };
        let sample = |k: usize| Sample {
            time_s: 0.03 * k as f64,
            force_n: 0.0,
            total_mm2: rise(0.03 * k as f64) + [0.5, -0.5, 0.2][k % 3],
            area_mm2: None,
            used: true,
        };
        let mut samples: Vec<Sample> = (0..800).map(sample).collect();
        hold(&mut samples, 25.0).unwrap();
        for s in samples.iter().filter(|s| s.used) {
            assert_eq!(
                s.force_n,
                if (2.0..12.0).contains(&s.time_s) { 25.0 } else { 0.0 },
                "{s:?}"
            );
        }
        let mut flat: Vec<Sample> = (0..800)
            .map(|k| Sample {
                total_mm2: [0.5, -0.5, 0.2][k % 3],
                ..sample(k)
            })
            .collect();
        assert!(matches!(hold(&mut flat, 25.0), Err(NoEdges)));
    }
}
