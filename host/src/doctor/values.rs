//! The lines on the values by themselves, without a model of the sheet: reciprocity, noise, saturation.

use super::facts::{Facts, Measured};
use super::line::{Cause, Line};
use crate::number::median;
use inverse::reference::inspection::out_of_range;
use inverse::reference::wiring;
use link::MeasuredFrame;

/// All of them; `named` are electrodes that are named for something else.
pub(crate) fn lines(facts: &Facts, named: &[usize]) -> Vec<Line> {
    match &facts.measured {
        Ok(measured) => vec![reciprocity(measured), noise(measured), saturation(measured, named)],
        Err(why) => ["reciprocity", "noise", "saturation"]
            .map(|name| Line::not_known(name, why))
            .to_vec(),
    }
}

/// Values that are reciprocal deviate by no more than crosstalk and errors of gain; more is a fault of the electronics.
const MOST_RECIPROCITY: f64 = 0.02;
/// And beside that by noise: so many times that of the mean value, in the median.
const NOISE_IN_RECIPROCITY: f64 = 3.0;
/// Where noise is so much nothing is told.
const NOISE_HIDES: f64 = 0.1;

fn reciprocity(measured: &Measured) -> Line {
    let name = "reciprocity";
    let baseline = &measured.baseline;
    let drive = ::forward::Drive::PAPER;
    let Some(off) = wiring::reciprocity(&measured.pattern, drive, &baseline.values_v) else {
        return Line::not_known(name, "no two values have drive and sense exchanged");
    };
    let noise = baseline.value_noise_v().into_iter().zip(&baseline.values_v);
    let noise = median(noise.map(|(sd, v)| (sd / v).abs())) / (baseline.frames as f64).sqrt();
    if noise > NOISE_HIDES {
        return Line::not_known(name, "noise hides it");
    }
    let text = format!("off by {:.2} % (median)", 100.0 * off);
    let most = MOST_RECIPROCITY + NOISE_IN_RECIPROCITY * noise;
    let line = if off <= most {
        Line::ok(name, text)
    } else {
        Line::bad(
            name,
            format!(
                "{text}, at most {:.2} % expected: the values are not those of a sheet",
                100.0 * most
            ),
            Cause::Hardware,
            "look at the multiplexers, the amplifiers and their references (docs/board.md), and for shorts between wires",
        )
    };
    line.figure("reciprocity", off)
}

/// Noise of a value against the median of the values, from which on light touches are lost.
const MUCH_NOISE: f64 = 0.01;
/// And from which on no touch of a finger is certain.
const TOO_MUCH_NOISE: f64 = 0.05;
/// So many times as much as usual is odd: of a channel against the others, of all frames against one and the next.
const ODD: f64 = 3.0;

/// A channel is stuck where chance, that of a converter whose steps are larger than the noise, makes all its values stay less often than so.
const BY_CHANCE: f64 = 1e-4;

/// A sense pair, from 1.
struct Channel {
    pair: [usize; 2],
    /// Of its values in one frame, V.
    noise_v: f64,
    /// Its values, and how many of them are the same in all frames.
    values: i32,
    same: i32,
}

/// Every sense pair, with the values' own noise.
fn channels(measured: &Measured) -> Vec<Channel> {
    let mut channels: Vec<Channel> = Vec::new();
    let noise_v = measured.baseline.value_noise_v();
    for (k, (m, sd)) in measured.pattern.measurements().iter().zip(noise_v).enumerate() {
        let pair = [m.sense.plus.min(m.sense.minus) + 1, m.sense.plus.max(m.sense.minus) + 1];
        if !sd.is_finite() {
            continue;
        }
        let mut of_frames = unpressed(measured)
            .iter()
            .map(|f| f.values_v[k])
            .filter(|v| v.is_finite());
        let first = of_frames.next();
        let same = i32::from(of_frames.all(|v| Some(v) == first));
        match channels.iter_mut().find(|c| c.pair == pair) {
            Some(channel) => {
                // The sum of the squares, until all are there.
                channel.noise_v += sd * sd;
                channel.values += 1;
                channel.same += same;
            }
            None => channels.push(Channel {
                pair,
                noise_v: sd * sd,
                values: 1,
                same,
            }),
        }
    }
    let mean = |c: &mut Channel| c.noise_v = (c.noise_v / f64::from(c.values)).sqrt();
    channels.iter_mut().for_each(mean);
    channels
}

/// Whether no value of a channel changes, which those of the others do so often that it is no chance.
fn is_stuck(channel: &Channel, all: &[Channel]) -> bool {
    let others = || all.iter().filter(|c| c.pair != channel.pair);
    let [same, values] = [others().map(|c| c.same).sum::<i32>(), others().map(|c| c.values).sum()].map(f64::from);
    channel.same == channel.values && (same / values).powi(channel.values) < BY_CHANCE
}

/// The frames of the baseline.
fn unpressed(measured: &Measured) -> &[MeasuredFrame] {
    &measured.frames[..measured.baseline.frames.min(measured.frames.len())]
}

/// Noise of every value from one unpressed frame to the next (von Neumann 1941), V: what changes slowly or once is hardly in it.
fn steady_noise_v(measured: &Measured) -> Vec<f64> {
    let of = |k: usize| {
        let steps = unpressed(measured)
            .windows(2)
            .map(|w| w[1].values_v[k] - w[0].values_v[k]);
        let squares: Vec<f64> = steps.map(|d| 0.5 * d * d).filter(|d| d.is_finite()).collect();
        // The median's, since a single jump is no noise: of a squared normal number it is 0.455.
        (median(squares.into_iter()) / 0.455).sqrt()
    };
    (0..measured.pattern.len()).map(of).collect()
}

fn noise(measured: &Measured) -> Line {
    let name = "noise";
    let channels = channels(measured);
    let typical_v = median(channels.iter().map(|c| c.noise_v));
    let signal_v = median(measured.baseline.values_v.iter().map(|v| v.abs()));
    if !(typical_v.is_finite() && signal_v > 0.0) {
        return Line::not_known(name, "too few frames have values");
    }
    let relative = typical_v / signal_v;
    let steady = median(steady_noise_v(measured).into_iter()) / signal_v;
    let text = format!("{:.3} % of the median value in one frame", 100.0 * relative);
    let pairs = |list: &[&Channel]| {
        let pairs: Vec<String> = list.iter().map(|c| format!("{}-{}", c.pair[0], c.pair[1])).collect();
        pairs.join(", ")
    };
    let which = |is: &dyn Fn(&Channel) -> bool| channels.iter().filter(|c| is(c)).collect::<Vec<_>>();
    let stuck = which(&|c| is_stuck(c, &channels));
    let loud = which(&|c| c.noise_v > (ODD * typical_v).max(MUCH_NOISE * signal_v));
    let worst = channels.iter().map(|c| c.noise_v).fold(0.0, f64::max) / signal_v;
    let electrodes = |list: &[&Channel]| list.iter().flat_map(|c| c.pair).collect::<Vec<_>>();
    let beside = "look at the supply, at the line on the source, and for motors and mains beside the wires";
    let line = if !stuck.is_empty() {
        let text = format!("{text}; none at all between electrodes {}: stuck", pairs(&stuck));
        let advice = "look at the amplifier and the multiplexer of these electrodes";
        Line::bad(name, text, Cause::Hardware, advice).electrodes(electrodes(&stuck))
    } else if relative > MUCH_NOISE && relative > ODD * steady {
        let text = format!(
            "the values changed by {:.1} % while they were measured, noise explains {:.1} %",
            100.0 * relative,
            100.0 * steady
        );
        let advice =
            "keep off the sheet and examine again; where nothing touched, something broke: look at cables and supply";
        Line::look_or_bad(relative > TOO_MUCH_NOISE, name, text, Cause::Wiring, advice)
    } else if relative > TOO_MUCH_NOISE {
        Line::bad(name, text, Cause::Hardware, beside)
    } else if !loud.is_empty() {
        let text = format!(
            "{text}; up to {:.2} % between electrodes {}",
            100.0 * worst,
            pairs(&loud)
        );
        let advice = "look at the wires and clamps of these electrodes, and at what runs beside them";
        Line::look_or_bad(worst > TOO_MUCH_NOISE, name, text, Cause::Wiring, advice).electrodes(electrodes(&loud))
    } else if relative > MUCH_NOISE {
        Line::look(name, text, Cause::Hardware, beside)
    } else {
        Line::ok(name, text)
    };
    line.figure("noise", relative).figure("worst_channel_noise", worst)
}

/// What clips at electrodes that are named for something else follows from that.
fn saturation(measured: &Measured, named: &[usize]) -> Line {
    let name = "saturation";
    let values = measured.pattern.len();
    let mut clipped = vec![0usize; values];
    for frame in &measured.frames {
        for (count, v) in clipped.iter_mut().zip(&frame.values_v) {
            *count += usize::from(!v.is_finite());
        }
    }
    let missing = clipped.iter().filter(|n| 2 * **n > measured.frames.len()).count();
    let ever = clipped.iter().filter(|n| **n > 0).count();
    let which = measured.pattern.measurements().iter().zip(&clipped);
    let which: Vec<&::forward::Measurement> = which.filter(|(_, n)| **n > 0).map(|(m, _)| m).collect();
    let imager = measured.imager.as_ref().ok();
    let [_, of_the_sheet] = imager.map_or_else(Default::default, |imager| {
        out_of_range(imager, &measured.baseline.values_v)
    });
    let is_of_the_sheet = || {
        (0..values)
            .filter(|k| clipped[*k] > 0)
            .all(|k| of_the_sheet.contains(&k))
    };
    let is_named = |m: &&::forward::Measurement| {
        let of = [m.drive.plus, m.drive.minus, m.sense.plus, m.sense.minus];
        of.iter().any(|l| named.contains(&(l + 1)))
    };
    let text = format!("{ever} of {values} values clip, {missing} of them in most frames");
    let line = if ever == 0 {
        Line::ok(name, format!("none of {values} values clips"))
    } else if 2 * ever <= values && is_of_the_sheet() {
        let text = format!("{text}: those that are the largest on this sheet, beyond what the board can measure");
        let advice =
            "touches are found without them; less excitation would measure them: skin settings set --excitation";
        Line::look(name, text, Cause::Hardware, advice)
    } else if which.iter().all(is_named) {
        let text = format!("{text}, all at electrodes that are named above");
        Line::look(name, text, Cause::Wiring, "mend what is named above first")
    } else {
        let advice =
            "look at the amplifier's supply and offset, or set less excitation: skin settings set --excitation";
        let line = Line::look_or_bad(missing > 0, name, text, Cause::Hardware, advice);
        // All electrodes are none in particular.
        let of = if ever < values { which } else { Vec::new() };
        line.electrodes(of.iter().flat_map(|m| [m.sense.plus + 1, m.sense.minus + 1]))
    };
    line.figure("clipped_values", ever as f64)
        .figure("values", values as f64)
}
