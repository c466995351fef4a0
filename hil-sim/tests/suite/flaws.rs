//! Every flaw of the electronics by its signature, against theory.

use crate::common::disc;
use firmware::{MAX_CHANNELS, Route, Sense};
use hil_sim::{Analog, Broken, Electronics, Line, PERIOD_SAMPLES, Routing, TICKS_PER_SAMPLE, TIMER_HZ};
use protocol::Pair;
use std::f64::consts::{PI, TAU};

const SAMPLE_S: f64 = TICKS_PER_SAMPLE as f64 / TIMER_HZ as f64;
const EXCITATION_HZ: f64 = 1.0 / (16.0 * SAMPLE_S);
/// Codes in a volt of the default converter.
const CODES: f64 = 4095.0 / 3.3;
const MIDDLE: f64 = 4095.0 / 2.0;

fn analog(electronics: Electronics) -> Analog {
    Analog::new(electronics, 0).unwrap()
}

/// All channels with this amplitude, or this chord along x.
fn all(amplitude_v: f64, chord: f64) -> Routing {
    Routing {
        amplitude_v: [amplitude_v; MAX_CHANNELS],
        chords: [[chord, 0.0]; MAX_CHANNELS],
        ..Routing::default()
    }
}

/// Codes of all channels from a time on, about the middle: by sample, then channel.
fn codes(analog: &mut Analog, routing: &Routing, from: u64, count: u64) -> Vec<[f64; MAX_CHANNELS]> {
    let mut row = [0; MAX_CHANNELS];
    (from..from + count)
        .map(|time| {
            analog.sample(time, routing, &mut row);
            row.map(|code| f64::from(code) - MIDDLE)
        })
        .collect()
}

fn mean_square(list: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = list.clone().count() as f64;
    let mean = list.clone().sum::<f64>() / n;
    list.map(|v| (v - mean) * (v - mean)).sum::<f64>() / n
}

/// Least squares of `a cos + b sin` at a frequency to (time, value): amplitude, phase, and mean square of what is left.
fn fit(points: &[(f64, f64)], hz: f64) -> (f64, f64, f64) {
    let [mut cc, mut ss, mut cs, mut yc, mut ys] = [0.0; 5];
    for (t, y) in points {
        let (s, c) = (TAU * hz * t).sin_cos();
        cc += c * c;
        ss += s * s;
        cs += c * s;
        yc += y * c;
        ys += y * s;
    }
    let det = cc * ss - cs * cs;
    let (a, b) = ((yc * ss - ys * cs) / det, (ys * cc - yc * cs) / det);
    let left = points
        .iter()
        .map(|(t, y)| y - a * (TAU * hz * t).cos() - b * (TAU * hz * t).sin());
    (
        a.hypot(b),
        b.atan2(a),
        left.map(|v| v * v).sum::<f64>() / points.len() as f64,
    )
}

#[test]
fn between_break_and_make_channels_go_to_rest_and_then_settle() {
    let (tau, open_s) = (20e-6, 100e-6);
    let analog = analog(Electronics {
        settling_s: tau,
        break_s: open_s,
        injection_v: 0.1,
        ..Electronics::ideal()
    });
    // Switched a quarter period after the zero, at the top of the sine.
    let after = analog.switched(4, &all(1.0, 0.0), [0.5; MAX_CHANNELS]);
    for (time, channel) in [(5, 0), (6, 3), (8, 15), (10, 0), (11, 1), (13, 7), (20, 15)] {
        let since_s = (time - 4) as f64 * SAMPLE_S + f64::from(channel as u32 * 60) / f64::from(TIMER_HZ);
        let new = |s: f64| 0.5 * (TAU * (0.25 + s * EXCITATION_HZ)).sin();
        let expected = if since_s < open_s {
            (-since_s / tau).exp()
        } else {
            let at_make = (-open_s / tau).exp() + 0.1;
            new(since_s) + (at_make - new(open_s)) * (-(since_s - open_s) / tau).exp()
        };
        let seen = analog.voltage_v(time, channel, &after);
        assert!((seen - expected).abs() < 1e-9, "{time} {channel}: {seen} {expected}");
    }
    // A source that is only set otherwise breaks nothing and injects nothing.
    let driven = analog.driven(4, &all(1.0, 0.0), [1.0; MAX_CHANNELS]);
    assert!((analog.voltage_v(5, 0, &driven) - (TAU * 5.0 / 16.0).sin()).abs() < 1e-9);
}

#[test]
fn a_bare_dac_holds_its_steps_and_rounds_by_the_uniform_law() {
    let e = |source_steps, source_bits| Electronics {
        source_steps,
        source_bits,
        ..Electronics::ideal()
    };
    // Sixteen steps, each about its time: half a step is 712 ticks, the twelfth channel comes 720 late.
    let coarse = analog(e(16, 0));
    let sinc = |n: f64| (PI / n).sin() / (PI / n);
    for (channel, step) in [(0, 0), (11, 0), (12, 1), (15, 1)] {
        let expected = (TAU * f64::from(3 + step) / 16.0).sin() / sinc(16.0);
        assert!((coarse.voltage_v(3, channel, &all(1.0, 0.0)) - expected).abs() < 1e-9);
    }
    // So many levels that the rounding is scattered: a step is 2 / 2^bits, and ten times that at a tenth of the amplitude.
    for (bits, permille, tolerance) in [(6, 1000, 0.25), (8, 1000, 0.25), (8, 100, 0.25)] {
        let mut fine = analog(e(4096, bits));
        fine.set_amplitude(permille);
        let sine = analog(Electronics::ideal());
        let routing = all(1.0, 0.0);
        let errors = (0..256).map(|k| {
            fine.voltage_v(k / 16, k as usize % 16, &routing) - sine.voltage_v(k / 16, k as usize % 16, &routing)
        });
        let step = 2.0 / f64::from(1 << bits) * 1000.0 / f64::from(permille);
        let ratio = mean_square(errors).sqrt() / (step / 12f64.sqrt());
        assert!((ratio - 1.0).abs() < tolerance, "{bits} bits, {permille}: {ratio}");
    }
}

#[test]
fn behind_its_filter_the_dacs_steps_leave_what_the_filter_lets_through() {
    let corner_hz = 20e3;
    let analog = analog(Electronics {
        source_steps: 32,
        source_filter_hz: corner_hz,
        skew_ticks: 89,
        ..Electronics::ideal()
    });
    let routing = all(1.0, 0.0);
    let points: Vec<(f64, f64)> = (0..256)
        .map(|k| {
            let late_s = (k % 16) as f64 * 89.0 / f64::from(TIMER_HZ);
            let time_s = (k / 16) as f64 * SAMPLE_S + late_s;
            (time_s, analog.voltage_v(k / 16, k as usize % 16, &routing))
        })
        .collect();
    // The board makes up for delay and loss of the fundamental.
    let (amplitude, phase, _) = fit(&points, EXCITATION_HZ);
    assert!(
        (amplitude - 1.0).abs() < 1e-3 && (phase - PI / 2.0).abs() < 1e-3,
        "{amplitude} {phase}"
    );
    // A staircase of N steps has the harmonics N - 1 and N + 1 at 1 / (N -+ 1).
    let pass = |hz: f64| 1.0 / (1.0 + (hz / corner_hz).powi(4)).sqrt();
    let rest: Vec<(f64, f64)> = points
        .iter()
        .map(|(t, v)| (*t, v - amplitude * (TAU * EXCITATION_HZ * t - phase).cos()))
        .collect();
    for harmonic in [31.0, 33.0] {
        let theory = pass(harmonic * EXCITATION_HZ) / pass(EXCITATION_HZ) / harmonic;
        let (seen, ..) = fit(&rest, harmonic * EXCITATION_HZ);
        assert!((seen / theory - 1.0).abs() < 0.03, "{harmonic}: {seen} {theory}");
    }
}

/// Response of the lock-in's in-phase output to `exp(j w t)`, over so many periods.
fn lock_in(hz: f64, periods: u64) -> (f64, f64) {
    let n = periods * PERIOD_SAMPLES;
    (0..n).fold((0.0, 0.0), |(re, im), k| {
        let weight = 2.0 / n as f64 * (TAU * k as f64 / 16.0).sin();
        let (s, c) = (TAU * hz * k as f64 * SAMPLE_S).sin_cos();
        (re + weight * c, im + weight * s)
    })
}

#[test]
fn the_mains_come_through_the_lock_in_as_its_sinc_says_and_advance_from_frame_to_frame() {
    let hz = 50.0;
    for (line_hz, harmonics, order) in [(hz, vec![], 1.0), (60.0, vec![], 1.0), (hz, vec![0.0, 0.5], 3.0)] {
        let part = harmonics.last().copied().unwrap_or(1.0);
        let line = Line {
            harmonics,
            ..Line::new(line_hz, 1.0)
        };
        let mut analog = analog(Electronics {
            interference: vec![line],
            noise_codes: 0.3,
            ..Electronics::ideal()
        });
        for periods in [1, 6] {
            // Frames of sixteen drives, each settling for a period; the window of the first drive.
            let frame = 16 * (1 + periods) * PERIOD_SAMPLES;
            let points: Vec<(f64, f64)> = (0..300)
                .map(|k| {
                    let start = k * frame;
                    let rows = codes(&mut analog, &all(0.0, 1.0), start, periods * PERIOD_SAMPLES);
                    let sum: f64 = rows
                        .iter()
                        .zip(0..)
                        .map(|(row, n)| row[0] * (TAU * f64::from(n) / 16.0).sin())
                        .sum();
                    (start as f64 * SAMPLE_S, 2.0 * sum / rows.len() as f64)
                })
                .collect();
            let seen_hz = order * line_hz;
            let (re, im) = lock_in(seen_hz, periods);
            let theory = re.hypot(im) * part * CODES;
            // The fit at the line's own frequency, over many of its periods, is the advance of its phase.
            let (amplitude, _, left) = fit(&points, seen_hz);
            assert!(
                (amplitude / theory - 1.0).abs() < 0.02,
                "{seen_hz} Hz, {periods}: {amplitude} {theory}"
            );
            if order == 1.0 {
                assert!(left.sqrt() < 0.03 * theory + 0.2, "{seen_hz} Hz, {periods}: {left}");
            }
            // The sinc of the window about the excitation, from above: what a window of rectangular shape lets through.
            let x = PI * periods as f64 * (1.0 - seen_hz / EXCITATION_HZ);
            assert!(re.hypot(im) < 2.1 / x, "{seen_hz}");
        }
    }
}

#[test]
fn the_channels_low_pass_attenuates_what_interferes() {
    let (hz, tau) = (12e3, 10e-6);
    let mut analog = analog(Electronics {
        interference: vec![Line::new(hz, 1.0)],
        settling_s: tau,
        ..Electronics::ideal()
    });
    let points: Vec<(f64, f64)> = codes(&mut analog, &all(0.0, 1.0), 0, 4000)
        .iter()
        .zip(0..)
        .map(|(row, k)| (f64::from(k) * SAMPLE_S, row[0]))
        .collect();
    let (amplitude, phase, _) = fit(&points, hz);
    let w = TAU * hz * tau;
    assert!(
        (amplitude / CODES * (1.0 + w * w).sqrt() - 1.0).abs() < 1e-3,
        "{amplitude}"
    );
    assert!((phase - PI / 2.0 - w.atan()).abs() < 1e-3, "{phase}");
    // A channel that is converted later sees a later phase.
    let last: Vec<(f64, f64)> = points
        .iter()
        .zip(codes(&mut analog, &all(0.0, 1.0), 0, 4000))
        .map(|(p, row)| (p.0, row[15]))
        .collect();
    let late = TAU * hz * 15.0 * 60.0 / f64::from(TIMER_HZ);
    assert!((phase - fit(&last, hz).1 - late).abs() < 1e-3);
}

#[test]
fn a_modulated_line_has_sidebands_and_a_chopped_one_its_part_of_the_power() {
    let (hz, side) = (1000.0, 80.0);
    let of = |line: Line| {
        let mut analog = analog(Electronics {
            interference: vec![line],
            ..Electronics::ideal()
        });
        let rows = codes(&mut analog, &all(0.0, 1.0), 0, 59_000);
        rows.iter()
            .zip(0..)
            .map(|(row, k)| (f64::from(k) * SAMPLE_S, row[0]))
            .collect::<Vec<_>>()
    };
    let modulated = of(Line {
        modulation: 0.6,
        modulation_hz: side,
        ..Line::new(hz, 1.0)
    });
    for (at, part) in [(hz, 1.0), (hz - side, 0.3), (hz + side, 0.3), (hz + 2.0 * side, 0.0)] {
        let (seen, ..) = fit(&modulated, at);
        assert!((seen / CODES - part).abs() < 0.01, "{at}: {}", seen / CODES);
    }
    let power = |points: &[(f64, f64)]| mean_square(points.iter().map(|p| p.1));
    let whole = power(&of(Line::new(hz, 1.0)));
    let chopped = of(Line {
        burst_hz: 37.0,
        burst_duty: 0.3,
        ..Line::new(hz, 1.0)
    });
    assert!((power(&chopped) / whole - 0.3).abs() < 0.01);
    let late = of(Line {
        from_s: 0.25,
        for_s: Some(0.5),
        ..Line::new(hz, 1.0)
    });
    assert!((power(&late) / whole - 0.5).abs() < 0.01);
    assert!(late.iter().all(|(t, v)| (0.25..0.75).contains(t) || v.abs() <= 0.5));
}

#[test]
fn neighbours_pick_up_what_lies_along_the_field() {
    let analog = analog(Electronics {
        interference: vec![Line::new(50.0, 1.0)],
        gains_milli: vec![1000],
        ..Electronics::ideal()
    });
    let route = Route {
        drive: Pair { plus: 0, minus: 1 },
        sense: Sense::All { step: 1 },
        gain: 0,
    };
    let chords = analog.chords(&route, 16);
    for (n, chord) in chords.iter().enumerate() {
        assert!((chord[0].hypot(chord[1]) - (PI / 16.0).sin()).abs() < 1e-12, "{n}");
        // They lie along the rim.
        let (s, c) = (TAU * (n as f64 + 0.5) / 16.0).sin_cos();
        assert!((chord[0] * c + chord[1] * s).abs() < 1e-12, "{n}");
    }
    // Around the rim nothing is left.
    assert!(chords.iter().map(|c| c[0]).sum::<f64>().abs() < 1e-12);
}

#[test]
fn the_slow_noise_has_its_power_in_every_decade_alike() {
    let per_decade = 60.0;
    let mut analog = analog(Electronics {
        flicker_codes: per_decade,
        ..Electronics::ideal()
    });
    let count = 1 << 15;
    let rows = codes(&mut analog, &all(0.0, 0.0), 1 << 20, count);
    // Periodograms about frequencies an octave apart: f S(f) is A^2 / ln 10 everywhere.
    let expected = per_decade * per_decade / 10f64.ln();
    let (mut logs, mut n) = (Vec::new(), 0.0);
    for octave in 3..=12 {
        let (mut sum, mut terms) = (0.0, 0.0);
        for bin in 0..8 {
            let cycles = (f64::from(1 << octave) * (1.0 + f64::from(bin) / 8.0)).round();
            let (s1, c1) = (TAU * cycles / count as f64).sin_cos();
            let mut turn = (1.0, 0.0);
            let mut sums = [[0.0; 2]; MAX_CHANNELS];
            for row in &rows {
                for (sum, v) in sums.iter_mut().zip(row) {
                    sum[0] += v * turn.0;
                    sum[1] += v * turn.1;
                }
                turn = (turn.0 * c1 - turn.1 * s1, turn.0 * s1 + turn.1 * c1);
            }
            for [re, im] in sums {
                let density = 2.0 * SAMPLE_S / count as f64 * (re * re + im * im);
                sum += density * cycles / (count as f64 * SAMPLE_S);
                terms += 1.0;
            }
        }
        // 128 periodograms have a standard error of 9 %.
        let ratio = sum / terms / expected;
        println!(
            "{:.0} Hz: {ratio:.2}",
            f64::from(1 << octave) / (count as f64 * SAMPLE_S)
        );
        assert!((0.6..1.4).contains(&ratio), "{octave}: {ratio}");
        logs.push((f64::from(octave), ratio.log2()));
        n += 1.0;
    }
    let (mx, my) = (
        logs.iter().map(|l| l.0).sum::<f64>() / n,
        logs.iter().map(|l| l.1).sum::<f64>() / n,
    );
    let slope = logs.iter().map(|l| (l.0 - mx) * (l.1 - my)).sum::<f64>()
        / logs.iter().map(|l| (l.0 - mx).powi(2)).sum::<f64>();
    // Of f S(f): 0 for 1/f, 1 for white noise.
    println!("slope of the density {:.3}", slope - 1.0);
    assert!(slope.abs() < 0.06, "{slope}");
}

#[test]
fn rounding_adds_a_twelfth_of_the_step_squared() {
    for bits in [16, 14, 12, 10, 8] {
        let noise_codes = 10.0;
        let mut analog = analog(Electronics {
            noise_codes,
            adc_bits: bits,
            ..Electronics::ideal()
        });
        let rows = codes(&mut analog, &all(0.0, 0.0), 0, 60_000);
        // Of more than twelve bits the codes are the finer ones.
        let codes_in_one = f64::from(1 << (bits.max(12) - 12));
        let middle = f64::from((1u32 << bits.max(12)) - 1) / 2.0;
        let step = f64::from(1 << (12 - bits.min(12))) / codes_in_one;
        let levels: Vec<f64> = rows.iter().flatten().map(|v| v + MIDDLE).collect();
        assert!(levels.iter().all(|level| level % (step * codes_in_one) == 0.0));
        let seen = mean_square(levels.iter().map(|level| (level - middle) / codes_in_one));
        let theory = noise_codes * noise_codes + step * step / 12.0;
        // A million samples: 0.14 % standard error.
        assert!((seen / theory - 1.0).abs() < 0.008, "{bits}: {seen} {theory}");
    }
}

#[test]
fn an_amplifier_that_is_driven_too_far_stays_at_its_rail() {
    let mut analog = analog(Electronics {
        swing_v: Some(1.0),
        ..Electronics::ideal()
    });
    for (k, row) in codes(&mut analog, &all(1.4, 0.0), 0, 16).iter().enumerate() {
        let sine = 1.4 * (TAU * k as f64 / 16.0).sin();
        assert!((row[0] - sine.clamp(-1.0, 1.0) * CODES).abs() <= 0.5 + 1e-9, "{k}");
    }
}

#[test]
fn gain_errors_scale_and_offsets_shift_the_channels_they_belong_to() {
    let route = Route {
        drive: Pair { plus: 0, minus: 1 },
        sense: Sense::All { step: 1 },
        gain: 0,
    };
    let ideal = analog(Electronics::ideal())
        .amplitudes_v(&disc(16), &route, &Broken::default())
        .unwrap();
    for (given, of) in [
        (vec![0.02], [0.02, 0.02, 0.02]),
        (vec![0.01, -0.03], [0.01, -0.03, 0.0]),
    ] {
        let flawed = analog(Electronics {
            gain_error: given.clone(),
            ..Electronics::ideal()
        });
        let seen = flawed.amplitudes_v(&disc(16), &route, &Broken::default()).unwrap();
        for (n, error) in of.iter().enumerate() {
            assert!((seen[n] / ideal[n] - 1.0 - error).abs() < 1e-12);
        }
        let mut shifted = analog(Electronics {
            offset_v: given,
            ..Electronics::ideal()
        });
        let rows = codes(&mut shifted, &all(0.5, 0.0), 0, 16);
        for (n, offset) in of.iter().enumerate() {
            let mean = rows.iter().map(|row| row[n]).sum::<f64>() / 16.0;
            assert!((mean - offset * CODES).abs() < 0.3, "{n}: {mean}");
        }
    }
}

#[test]
fn neighbouring_channels_see_their_part_of_each_other() {
    let route = Route {
        drive: Pair { plus: 0, minus: 1 },
        sense: Sense::All { step: 1 },
        gain: 0,
    };
    let own = analog(Electronics::ideal())
        .amplitudes_v(&disc(16), &route, &Broken::default())
        .unwrap();
    let flawed = analog(Electronics {
        crosstalk: 0.01,
        ..Electronics::ideal()
    });
    let seen = flawed.amplitudes_v(&disc(16), &route, &Broken::default()).unwrap();
    for n in 0..16 {
        let below = if n > 0 { own[n - 1] } else { 0.0 };
        let above = if n < 15 { own[n + 1] } else { 0.0 };
        assert!((seen[n] - own[n] - 0.01 * (below + above)).abs() < 1e-12, "{n}");
    }
    // One channel alone has no neighbours.
    let one = Route {
        sense: Sense::One(Pair { plus: 6, minus: 5 }),
        ..route
    };
    assert!((flawed.amplitudes_v(&disc(16), &one, &Broken::default()).unwrap()[0] - own[5]).abs() < 1e-12);
}

#[test]
fn jitter_makes_noise_in_proportion_to_the_slope() {
    let (jitter_s, amplitude) = (500e-9, 1.5);
    let mut analog = analog(Electronics {
        jitter_s,
        skew_ticks: 0,
        ..Electronics::ideal()
    });
    let rows = codes(&mut analog, &all(amplitude, 0.0), 0, 16 * 2000);
    for phase in 0..16 {
        let list = rows.iter().skip(phase).step_by(16).flatten().copied();
        let slope = TAU * EXCITATION_HZ * amplitude * (TAU * phase as f64 / 16.0).cos();
        let theory = (slope * jitter_s * CODES).powi(2);
        let seen = mean_square(list);
        // 32,000 samples of a variance: 0.8 % standard error; and the rounding.
        assert!((seen - theory).abs() < 0.04 * theory + 0.3, "{phase}: {seen} {theory}");
    }
}

#[test]
fn a_fast_crystal_sees_true_frequencies_too_low_and_drives_filters_too_fast() {
    let ppm = 20_000.0;
    let (rate, tau) = (1.0 + 1e-6 * ppm, 30e-6);
    let e = Electronics {
        crystal_ppm: ppm,
        interference: vec![Line::new(60.0, 0.5)],
        ..Electronics::ideal()
    };
    let mut fast = analog(e.clone());
    assert!((fast.true_s(1_000_000) - 1e6 * SAMPLE_S / rate).abs() < 1e-9);
    let points: Vec<(f64, f64)> = codes(&mut fast, &all(0.0, 1.0), 0, 100_000)
        .iter()
        .zip(0..)
        .map(|(row, k)| (f64::from(k) * SAMPLE_S, row[0]))
        .collect();
    // By the board's own reckoning the mains have another frequency; the fit over 1.7 s tells 0.2 Hz.
    let at = |hz| fit(&points, hz).2;
    assert!(at(60.0 / rate) < 0.5 && at(60.0 / rate + 0.2) > 100.0 && at(60.0) > 100.0);
    // The channels' low-pass takes more of a faster excitation, and holds it back further.
    let filtered = analog(Electronics { settling_s: tau, ..e });
    let points: Vec<(f64, f64)> = (0..16)
        .map(|k| (k as f64 * SAMPLE_S, filtered.voltage_v(k, 0, &all(1.0, 0.0))))
        .collect();
    let (amplitude, phase, _) = fit(&points, EXCITATION_HZ);
    let w = TAU * EXCITATION_HZ * tau;
    let loss = ((1.0 + w * w) / (1.0 + (rate * w).powi(2))).sqrt();
    assert!((amplitude - loss).abs() < 1e-9 && loss < 0.9975, "{amplitude} {loss}");
    assert!((phase - PI / 2.0 - ((rate * w).atan() - w.atan())).abs() < 1e-9);
}

#[test]
fn all_flaws_together_are_a_function_of_seed_and_time() {
    let e = |seed| Electronics {
        source_steps: 64,
        source_bits: 10,
        source_filter_hz: 10e3,
        crystal_ppm: 30.0,
        break_s: 1e-6,
        gain_error: vec![0.01, -0.02],
        offset_v: vec![0.01],
        swing_v: Some(1.5),
        crosstalk: 1e-3,
        flicker_codes: 2.0,
        jitter_s: 10e-9,
        interference: vec![Line::mains(50.0, 0.1), Line::new(8000.0, 0.05)],
        adc_bits: 11,
        inl_codes: 1.5,
        dnl_codes: 0.7,
        seed,
        ..Electronics::default()
    };
    let routing = all(0.8, 0.2);
    let (mut forth, mut back, mut other, mut late) = (
        analog(e(3)),
        analog(e(3)),
        analog(e(4)),
        Analog::new(e(3), 4000).unwrap(),
    );
    let rows = codes(&mut forth, &routing, 0, 5000);
    let (mut row, mut unlike) = ([0; MAX_CHANNELS], 0);
    for time in (0..5000).rev().step_by(7) {
        back.sample(time, &routing, &mut row);
        assert_eq!(row.map(|c| f64::from(c) - MIDDLE), rows[time as usize]);
        other.sample(time, &routing, &mut row);
        unlike += usize::from(row.map(|c| f64::from(c) - MIDDLE) != rows[time as usize]);
    }
    assert!(unlike > 700, "{unlike}");
    // A board that is powered up later, at the same phase, finds the noise where it is.
    late.sample(16, &routing, &mut row);
    assert_eq!(row.map(|c| f64::from(c) - MIDDLE), rows[4016]);
    // On every machine: a sum over all codes (FNV-1a).
    let sum = rows.iter().flatten().fold(0xCBF2_9CE4_8422_2325u64, |hash, code| {
        (hash ^ (code + MIDDLE) as u64).wrapping_mul(0x0100_0000_01B3)
    });
    assert_eq!(sum, 17_718_160_245_715_963_425);
    // Different channels have different noise.
    assert!(rows.iter().any(|r| r[0] != r[2]));
}
