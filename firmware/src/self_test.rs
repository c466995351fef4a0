//! The self-test: the source, then the voltage of every drive pair, and what the samples look like on the way.
//!
//! The functions fill the report step by step. What is measured when is [`crate::measuring`]'s part.

use crate::board_info::BoardInfo;
use crate::codes::{extra_bits, full_scale};
use crate::scan::Scan;
use crate::task::Probe;
use protocol::{Check, SelfTest, Value, Variance};

/// Largest variance of a healthy board's samples, squared codes: 4 codes rms, ten times the board's own noise. A lower
/// limit reports interference that frames bear; a higher one misses more of it.
const MOST_NOISE: u32 = 16;

/// A drive pair beside which the sense pairs see less than the mean of all drive pairs by this factor carries no current: a wire
/// is off. What the sheet conducts does not matter. A lower factor calls a poor contact open.
const NO_CURRENT: i64 = 4;

/// Where no sense pair sees anything at all, a drive pair with this many thousandths of the source's voltage, or more, carries no
/// current: then there is no sheet, and the amplifier is not to blame.
const OPEN: i64 = 980;

/// A drive pair with this many thousandths of the source's voltage, or fewer, is shorted. With two switches of 100 ohm these
/// are 4 ohm. A higher limit calls a good conductor a short.
const SHORTED: i64 = 20;

/// An amplifier through which the sense pairs see less than the drive pairs' own voltage by this factor gives no signal. On
/// the paper's sheet the factor is 20, with contacts as large as ten squares of it 200.
const DEAD: i64 = 1000;

/// Largest part that is out of phase: one in this many of what is in phase, 9.5 degrees, and [`PHASE_FLOOR`]. Parts to the worse
/// side make 4 degrees; a source one step of its table off is 22.5 degrees off. A larger share lets wrong filter parts pass.
const PHASE: i32 = 6;

/// What is always allowed out of phase, sixteenths of a code: three codes, of weak pairs and noise.
const PHASE_FLOOR: i32 = 48;

/// How far a period may be from the same upside down: one part in this many of its amplitude, and [`BENT_FLOOR`]. An
/// amplifier that costs a value 0.2 % at its rail exceeds it. A larger share lets worse pass.
const BENT: i64 = 64;

/// The same that is always allowed, codes: the converter's nonlinearity and noise.
const BENT_FLOOR: i64 = 4;

/// Largest error of the source's amplitude: one part in this many of what was set. The same share as before every
/// measurement, without the allowance for rounding.
const SOURCE_TOLERANCE: u32 = 10;

/// Largest departure of the mean code from the middle of the range: one part in this many of half the range. The other
/// nine parts are left to the signal. A larger share lets samples clip.
const OFFSET_TOLERANCE: i64 = 10;

/// The report of a board on which nothing was measured yet. `store_works` says whether its store could be read.
pub(crate) fn begun(info: &BoardInfo<'_>, store_works: bool) -> SelfTest {
    SelfTest {
        gain: info.gains().saturating_sub(1),
        failed: if store_works { 0 } else { Check::Store.bit() },
        ..SelfTest::default()
    }
}

/// Takes the source's amplitude in, measured and set, in thousandths of full scale.
pub(crate) fn source_measured(report: &mut SelfTest, scan: &Scan, measured: u16, set: u16) {
    report.source_permille = measured;
    report.source_offset = Value::saturating(offset(scan)).0;
    if u32::from(measured.abs_diff(set)) * SOURCE_TOLERANCE > set.into() {
        report.failed |= Check::Source.bit();
    }
    if !in_phase(scan) {
        report.failed |= Check::Phase.bit();
    }
}

/// Whether a scan of one value is in phase.
pub(crate) fn in_phase(scan: &Scan) -> bool {
    let frame = scan.frame(0, 0, true);
    let size = |values: &[Value]| values.first().map_or(0, |v| i32::from(v.sixteenths()).abs());
    size(frame.quadrature) <= size(frame.values) / PHASE + PHASE_FLOOR
}

/// Distance of a scan's mean code from the middle of the range, sixteenths of a code of 12 bits; 0 where there are no samples.
fn offset(scan: &Scan) -> i64 {
    let folded = scan.folded();
    if !folded.is_sampled() {
        return 0;
    }
    let sum: u32 = folded.period(0).iter().sum();
    // The sum of 16 bins over the periods is the mean in sixteenths of a code, whatever bits that has.
    let mean = i64::from(sum).checked_div(folded.periods().into()).unwrap_or(0);
    let middle = i64::from(full_scale(folded.bits())) * i64::from(Value::PER_CODE) / 2;
    (mean - middle) >> extra_bits(folded.bits())
}

/// Half the range, sixteenths of a code of 12 bits.
const HALF_RANGE: i64 = 2048 * Value::PER_CODE as i64;

/// The drive pair to measure next; `None` after the last.
pub(crate) fn next_pair(report: &SelfTest, info: &BoardInfo<'_>) -> Option<Probe> {
    let m = report.drive_pairs.len() as u8;
    (m < info.electrodes).then(|| Probe::drive_pair(m, info.electrodes, report.gain))
}

/// The sense pair to measure after this one; `None` after the last.
pub(crate) fn next_sense(report: &SelfTest, now: &Probe, info: &BoardInfo<'_>) -> Option<Probe> {
    let m = report.sense_pairs.len() as u8;
    if !now.second {
        return Some(Probe::beside(m.saturating_sub(1), true, info.electrodes));
    }
    (m < info.electrodes).then(|| Probe::beside(m, false, info.electrodes))
}

/// Takes the voltage of the next drive pair in, as the scan has it.
pub(crate) fn pair_measured(report: &mut SelfTest, scan: &Scan) {
    let first = report.drive_pairs.is_empty();
    let value = scan.values().first().copied().unwrap_or_default();
    // Cannot fail: there is room for as many pairs as electrodes.
    let _ = report.drive_pairs.push(value);
    noise_measured(report, scan);
    offset_measured(report, scan, first);
}

/// Takes a sense pair in: its value where it is the larger one of the two beside a drive pair, and its period's shape.
pub(crate) fn sense_measured(report: &mut SelfTest, probe: &Probe, scan: &Scan) {
    let value = scan.values().first().copied().unwrap_or_default();
    let size = |v: &Value| v.sixteenths().unsigned_abs();
    match report.sense_pairs.last_mut() {
        Some(other) if probe.second => {
            if size(&value) > size(other) {
                *other = value;
            }
        }
        _ => {
            let _ = report.sense_pairs.push(value);
        }
    }
    if !in_phase(scan) {
        report.failed |= Check::Phase.bit();
    }
    if scan.folded().railed(0) || is_bent(scan, value) {
        let m = report.sense_pairs.len() as u32;
        report.bent |= 1u32.checked_shl(m.saturating_sub(1)).unwrap_or(0);
    } else {
        // What is bent has harmonics, which look like noise.
        noise_measured(report, scan);
    }
    offset_measured(report, scan, false);
}

/// Whether a period is not the same upside down: samples half a period apart, which are as far on either side of the mean.
/// Without samples nothing is known of it.
fn is_bent(scan: &Scan, value: Value) -> bool {
    let (periods, extra) = (i64::from(scan.folded().periods()), extra_bits(scan.folded().bits()));
    let bins = scan.folded().period(0);
    let sum: i64 = bins.iter().map(|bin| i64::from(*bin)).sum();
    let (first, second) = bins.split_at(bins.len() / 2);
    let pairs = first.len() as i64;
    let apart = first
        .iter()
        .zip(second)
        .map(|(a, b)| (i64::from(*a) + i64::from(*b)) * pairs - sum);
    let amplitude = i64::from(value.sixteenths()).abs() / i64::from(Value::PER_CODE);
    let most = (pairs * periods * (BENT_FLOOR + amplitude / BENT)) << extra;
    apart.into_iter().any(|a| a.abs() > most)
}

fn noise_measured(report: &mut SelfTest, scan: &Scan) {
    let noise = scan.noise().first().copied().unwrap_or_default();
    report.noise = report.noise.max(noise);
    if noise > Variance::new(MOST_NOISE * 256) {
        report.failed |= Check::Noise.bit();
    }
}

fn offset_measured(report: &mut SelfTest, scan: &Scan, first: bool) {
    let offset = offset(scan);
    if first || offset.abs() > i64::from(report.offset.sixteenths()).abs() {
        report.offset = Value::saturating(offset).0;
    }
    if offset.abs() > HALF_RANGE / OFFSET_TOLERANCE {
        report.failed |= Check::Offset.bit();
    }
}

/// Names the pairs without current and the shorted ones, and says of the amplifier what they leave to be said: with a wire off,
/// its inputs float, and noise, phase and shape of its output say nothing.
pub(crate) fn judge(report: &mut SelfTest, info: &BoardInfo<'_>) {
    let size = |v: &Value| i64::from(v.sixteenths()).abs();
    let sum = |values: &[Value]| values.iter().map(size).sum::<i64>();
    let (own, beside) = (sum(&report.drive_pairs), sum(&report.sense_pairs));
    let gain = |number: u8| i64::from(info.gains_milli.get(usize::from(number)).copied().unwrap_or(0));
    let dead = beside * gain(report.gain) * DEAD < own * gain(0);
    // The source's voltage, as the drive pairs' gain shows it.
    let source = info.source_full_scale() * i64::from(report.source_permille) * gain(report.gain);
    let source = source.checked_div(i64::from(info.source_gain_milli)).unwrap_or(0) / 1000;
    let count = report.sense_pairs.len() as i64;
    if !report.passed(Check::Source) && own < count * i64::from(Value::PER_CODE) {
        // Without a source nothing can be said of sheet and amplifier.
        return;
    }
    for (m, (own, sense)) in report.drive_pairs.iter().zip(&report.sense_pairs).enumerate() {
        let open = if dead {
            size(own) * 1000 >= source * OPEN
        } else {
            size(sense) * NO_CURRENT * count < beside
        };
        if open || size(own) * 1000 <= source * SHORTED {
            report.suspect |= 1u32.checked_shl(m as u32).unwrap_or(0);
        }
    }
    if report.suspect != 0 {
        report.failed |= Check::Electrodes.bit();
        report.failed &= !(Check::Phase.bit() | Check::Noise.bit());
        report.bent = 0;
        return;
    }
    if dead {
        report.failed |= Check::Amplifier.bit();
    }
    if report.bent != 0 {
        report.failed |= Check::Linearity.bit();
    }
}
