//! `skin hello --phantom`: the production test on a ring of resistors, in words and for programs.

use anyhow::Result;
use link::phantom::{
    Finding, GAIN_LIMIT, Known, OFFSET_LIMIT, PHASE_LIMIT_DEG, RING_LIMIT, SIGMA_LIMIT, SPREAD_LIMIT,
    SWITCH_LIMIT_UNMEASURED_OHM, SWITCH_LIMITS_OHM, SWITCH_OHM, Verdict, judge, read,
};
use link::{Link, LinkError};
use protocol::{Check, Hello, SelfTest};
use serde_json::{Value, json};

/// What a board showed on the ring.
pub(crate) enum Tried {
    /// It was measured: the ring as it is known, and what was seen.
    Measured(Known, Verdict),
    /// It was not, and why.
    Not(String),
}

impl Tried {
    pub(crate) fn passed(&self) -> bool {
        matches!(self, Self::Measured(_, verdict) if verdict.findings.is_empty())
    }
}

/// Measures the ring. A board whose source or reference failed its self-test is not measured: it would not start, or nothing
/// would be in the converter's range.
///
/// # Errors
/// No answer, a lost port.
pub(crate) fn test(link: &Link, hello: &Hello, known: Known, test: &SelfTest) -> Result<Tried> {
    if !test.passed(Check::Source) || !test.passed(Check::Offset) {
        return Ok(Tried::Not("mend what the self-test found first".to_owned()));
    }
    match read(link, hello) {
        Ok(readings) => {
            let set = 1000.0 * readings.excitation;
            let source = f64::from(test.source_permille) / set;
            Ok(Tried::Measured(known, judge(hello, known, source, &readings)))
        }
        Err(LinkError::Refused(why)) => Ok(Tried::Not(why)),
        Err(e) => Err(e.into()),
    }
}

/// On stdout, in words.
pub(crate) fn describe(tried: &Tried) {
    let (known, verdict) = match tried {
        Tried::Not(why) => {
            println!("phantom     FAILED: not measured: {why}");
            return;
        }
        Tried::Measured(known, verdict) => (known, verdict),
    };
    let number = |v: f64, digits: usize| {
        if v.is_nan() {
            return "-".to_owned();
        }
        let text = format!("{v:.digits$}");
        // Nothing below 0 is left of it.
        if text.chars().all(|c| "-0.".contains(c)) {
            text.replace('-', "")
        } else {
            text
        }
    };
    let row = |what: &str, value: String, limit: String| println!("            {what:<30} {value:>8}  {limit}");
    println!("phantom");
    let expected = number(verdict.expected_codes, 1);
    row(
        "mean of the values, codes",
        number(verdict.mean_codes, 1),
        format!("theory {expected} with these switches"),
    );
    let [least, mut most] = SWITCH_LIMITS_OHM;
    let said = known.said_ohm;
    let (resistor, limit) = if known.between_ohm.is_some() {
        let [least, most] = [1.0 - RING_LIMIT, 1.0 + RING_LIMIT].map(|part| said * part);
        ("a resistor as measured, ohm", format!("{least:.0} to {most:.0}"))
    } else {
        most = SWITCH_LIMIT_UNMEASURED_OHM;
        let told = format!("if a switch has its typical {SWITCH_OHM:.0}: only their ratio is seen; see --measured");
        ("or else a resistor, ohm", told)
    };
    row(
        "a closed switch, ohm",
        number(verdict.switch_ohm, 1),
        format!("{least:.0} to {most:.0}"),
    );
    row(resistor, number(verdict.ring_ohm, 0), limit);
    row(
        "gain against the drive pairs'",
        number(verdict.gain_ratio, 4),
        format!("{:.2} to {:.2}", 1.0 - GAIN_LIMIT, 1.0 + GAIN_LIMIT),
    );
    row(
        "farthest value, %",
        number(100.0 * verdict.spread, 2),
        format!("at most {:.1}", 100.0 * SPREAD_LIMIT),
    );
    row(
        "noise of a value, codes",
        number(verdict.sigma, 3),
        format!("at most {SIGMA_LIMIT}"),
    );
    row(
        "phase, degrees",
        number(verdict.phase_deg, 2),
        format!("at most {PHASE_LIMIT_DEG:.0}"),
    );
    row(
        "farthest mean, codes",
        number(verdict.offset_codes, 1),
        format!("at most {OFFSET_LIMIT:.0}"),
    );
    println!(
        "            {}",
        if verdict.findings.is_empty() {
            "passed"
        } else {
            "FAILED:"
        }
    );
    for finding in &verdict.findings {
        println!("            {}: {finding}", finding.name());
    }
}

/// For programs. A figure that could not be told is null.
pub(crate) fn as_json(tried: &Tried) -> serde_json::Value {
    let (known, verdict) = match tried {
        Tried::Not(why) => return json!({ "passed": false, "not_measured": why }),
        Tried::Measured(known, verdict) => (known, verdict),
    };
    json!({
        "passed": verdict.findings.is_empty(),
        "findings": verdict.findings.iter().map(finding).collect::<Vec<_>>(),
        "mean_codes": verdict.mean_codes,
        "expected_codes": verdict.expected_codes,
        "switch_ohm": verdict.switch_ohm,
        "ring_ohm": verdict.ring_ohm,
        "ring_measured": known.between_ohm.is_some(),
        "gain_ratio": verdict.gain_ratio,
        "spread": verdict.spread,
        "sigma_codes": verdict.sigma,
        "phase_deg": verdict.phase_deg,
        "offset_codes": verdict.offset_codes,
    })
}

/// Something that is wrong.
pub(crate) fn finding(f: &Finding) -> Value {
    json!({ "name": f.name(), "what": f.to_string() })
}
