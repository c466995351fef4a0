//! The self-test: the source, then the voltage of every drive pair, and what the samples look like on the way.
//!
//! The functions fill the report step by step. What is measured when is [`crate::measuring`]'s part.

use crate::FULL_SCALE;
use crate::board_info::BoardInfo;
use crate::scan::Scan;
use crate::task::Probe;
use protocol::{Check, SelfTest, Value, Variance};

/// Largest variance of a healthy board's samples, squared codes: 4 codes rms, ten times the board's own noise. A lower
/// limit reports interference that frames bear; a higher one misses more of it.
const MOST_NOISE: u32 = 16;

/// A drive pair with this many thousandths of the source's voltage, or more, carries no current. With two switches of 70
/// ohm these are 6.9 kilohm between the electrodes, several times an unpressed sheet of 1 kilohm a square. A lower limit
/// calls a poor contact open.
const OPEN: i64 = 980;

/// A drive pair with this many thousandths of the source's voltage, or fewer, is shorted. With two switches of 70 ohm these
/// are 3 ohm. A higher limit calls a good conductor a short.
const SHORTED: i64 = 20;

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
pub(crate) fn source_measured(report: &mut SelfTest, measured: u16, set: u16) {
    report.source_permille = measured;
    if u32::from(measured.abs_diff(set)) * SOURCE_TOLERANCE > set.into() {
        report.failed |= Check::Source.bit();
    }
}

/// The drive pair to measure next; `None` after the last.
pub(crate) fn next_pair(report: &SelfTest, info: &BoardInfo<'_>) -> Option<Probe> {
    let m = report.drive_pairs.len() as u8;
    (m < info.electrodes).then(|| Probe::drive_pair(m, info.electrodes, report.gain))
}

/// Takes the voltage of the next drive pair in, as the scan has it.
pub(crate) fn pair_measured(report: &mut SelfTest, info: &BoardInfo<'_>, scan: &Scan) {
    let m = report.drive_pairs.len() as u8;
    let value = scan.values().first().copied().unwrap_or_default();
    let noise = scan.noise().first().copied().unwrap_or_default();
    let periods = u32::from(scan.folded().periods());
    let sum: u32 = scan.folded().period(0).iter().sum();
    let offset = (i64::from(sum)).checked_div(i64::from(periods)).unwrap_or(0);
    // Cannot fail: there is room for as many pairs as electrodes.
    let _ = report.drive_pairs.push(value);
    // The voltage against the source's: both amplitudes, each through its own gain.
    let gain = info.gains_milli.get(usize::from(report.gain)).copied().unwrap_or(0);
    let source = info.source_full_scale() * i64::from(report.source_permille) * i64::from(gain);
    let source = source.checked_div(i64::from(info.source_gain_milli)).unwrap_or(0) / 1000;
    let voltage = i64::from(value.sixteenths()).abs() * 1000;
    if voltage >= source * OPEN || voltage <= source * SHORTED {
        report.suspect |= 1u32.checked_shl(m.into()).unwrap_or(0);
        report.failed |= Check::Electrodes.bit();
    }
    report.noise = report.noise.max(noise);
    if noise > Variance::new(MOST_NOISE * 256) {
        report.failed |= Check::Noise.bit();
    }
    // The sum of 16 bins over the periods is the mean in sixteenths of a code.
    let middle = i64::from(FULL_SCALE) * i64::from(Value::PER_CODE) / 2;
    if m == 0 || (offset - middle).abs() > (i64::from(report.offset.sixteenths())).abs() {
        report.offset = Value::saturating(offset - middle).0;
    }
    if (offset - middle).abs() > middle / OFFSET_TOLERANCE {
        report.failed |= Check::Offset.bit();
    }
}
