//! The lines on what is wired to the board, as the unpressed sheet's values tell it.

use super::facts::{Facts, Measured};
use super::line::{Cause, Line};
use crate::check::as_wired;
use crate::number::median;
use inverse::reference::diagnosis::Fault;
use inverse::reference::electrode_fit::NoFit;
use inverse::reference::inspection::{Inspection, InspectionOptions, SAID_FROM, inspect};
use inverse::reference::screening::{Finding, FindingKind};
use inverse::reference::wiring::{self, WiringCheck, WiringOptions, order_text};
use std::sync::Arc;

/// All of them. Without the sheet's model nothing is known of its electrodes.
pub(crate) fn lines(facts: &Facts) -> Vec<Line> {
    let not = |why: &str| {
        ["sheet", "wiring", "contact"]
            .map(|name| Line::not_known(name, why))
            .to_vec()
    };
    let measured = match &facts.measured {
        Ok(measured) => measured,
        Err(why) => return not(why),
    };
    let values = &measured.baseline.values_v;
    let mut lines = not("the sheet could not be looked at");
    let advice = "describe the sheet that is wired to the board with --sheet";
    if !values.iter().any(|v| v.is_finite() && *v != 0.0) {
        let advice = "look at what the self-test says, at the excitation and at the amplifiers' supply";
        let nothing = "no value is in the converter's range and differs from 0";
        lines[0] = Line::bad("sheet", nothing, Cause::Hardware, advice);
        return lines;
    }
    match look(measured) {
        Ok((check, inspection)) => vec![sheet(&inspection), order(&check, &inspection), contact(&inspection)],
        Err(why) => {
            lines[0] = Line::bad("sheet", why, Cause::Software, advice);
            lines
        }
    }
}

/// As `skin check` does: the order of the wires first, then what is wrong in the best order.
fn look(measured: &Measured) -> Result<(WiringCheck, Inspection), String> {
    let imager = measured.imager.as_ref().map_err(Clone::clone)?;
    let check = wiring::check(imager, &measured.baseline.values_v, false, &WiringOptions::default());
    let check = check.map_err(|e| e.to_string())?;
    let right = if check.is_wrong() {
        as_wired(imager, &check.best).map_err(|e| format!("{e:#}"))?
    } else {
        Arc::clone(imager)
    };
    let inspection = inspect(&right, measured.baseline.clone(), true, &InspectionOptions::default());
    Ok((check, inspection))
}

fn sheet(inspection: &Inspection) -> Line {
    let name = "sheet";
    let has = |kinds: &[FindingKind]| inspection.findings.iter().find(|f| kinds.contains(&f.kind));
    let signs = [FindingKind::AllSigns, FindingKind::DriveSign, FindingKind::SenseSign];
    let misfit = format!("off its model by {:.2} %", 100.0 * inspection.misfit);
    // Values that agree with the model but for their signs are not those of a board that measures nothing.
    let contradicted =
        |f: &Fault| inspection.conclusive && matches!(f, Fault::Source | Fault::Converter | Fault::Range);
    let on_the_board = inspection.fault.filter(|f| !is_of_electrodes(f) && !contradicted(f));
    let line = if let Some(fault) = on_the_board {
        let cause = match fault {
            Fault::Short { .. } => Cause::Wiring,
            _ => Cause::Hardware,
        };
        Line::bad(name, format!("{misfit}: {fault}"), cause, "mend it, then examine again")
            .electrodes(fault.electrodes().list().iter().map(|l| l + 1))
    } else if !inspection.conclusive {
        Line::bad(
            name,
            format!("{misfit}: the values are not those of the sheet as described"),
            Cause::Wiring,
            "look at the sheet's size, the number and order of the electrodes and their contacts; --sheet describes another one",
        )
    } else if let Some(sign) = has(&signs) {
        Line::look(
            name,
            sign.to_string(),
            Cause::Wiring,
            "turn the two wires round; touches are found all the same",
        )
        .electrodes(sign.electrodes.iter().copied())
    } else if let Some(leak) = has(&[FindingKind::Leak]) {
        Line::look(
            name,
            leak.to_string(),
            Cause::Wiring,
            "dry and clean what is between their wires and clamps",
        )
        .electrodes(leak.electrodes.iter().copied())
    } else if let Some(saturated) = has(&[FindingKind::Saturated]) {
        Line::look(
            name,
            saturated.to_string(),
            Cause::Hardware,
            "look at the amplifiers' supply and gains",
        )
    } else if let Some(gain) = has(&[FindingKind::SenseGain, FindingKind::SenseOffset]) {
        Line::look(
            name,
            gain.to_string(),
            Cause::Hardware,
            "look at the amplifier of this pair",
        )
        .electrodes(gain.electrodes.iter().copied())
    } else if let Some(NoFit::TooFar {
        electrode, moved_mm, ..
    }) = &inspection.not_found
    {
        let text = format!(
            "electrode {} seems to be {:.0} mm from its place",
            electrode + 1,
            moved_mm.abs()
        );
        Line::look(
            name,
            text,
            Cause::Wiring,
            "look at its place, or describe it with --sheet",
        )
        .electrodes([electrode + 1])
    } else if inspection.electrodes.is_some() && inspection.misfit > SAID_FROM * inspection.expected {
        let text = format!("{misfit}, {:.2} % expected", 100.0 * inspection.expected);
        let advice = "look for holes, cuts, worn places, something that rests on it, and electrodes of another size";
        Line::look(name, text, Cause::Wiring, advice)
    } else {
        Line::ok(name, misfit)
    };
    line.figure("misfit", inspection.misfit)
        .figure("expected_misfit", inspection.expected)
}

/// Whether a fault is an electrode's, for the line on contacts, or one of the order of the wires.
fn is_of_electrodes(fault: &Fault) -> bool {
    matches!(
        fault,
        Fault::Open(_) | Fault::Contacts(_) | Fault::Loose(_) | Fault::Exchanged(_)
    )
}

fn order(check: &WiringCheck, inspection: &Inspection) -> Line {
    let name = "wiring";
    let text = format!("off the model by {:.1} % in this order", 100.0 * check.given.misfit);
    let line = if check.is_wrong() {
        let order = order_text(&check.best.order);
        Line::bad(
            name,
            format!("{text}, by {:.1} % as {order}", 100.0 * check.best.misfit),
            Cause::Wiring,
            format!("put the wires in order, or give --wires {order}"),
        )
        .electrodes(check.moved().iter().map(|l| l + 1))
    } else if !inspection.conclusive {
        Line::not_known(name, "the values are not those of the sheet in any order")
    } else {
        let turns = if check.equal.len() > 1 {
            format!(
                "; {} turns and mirrors fit as well: skin check --touch tells them apart",
                check.equal.len()
            )
        } else {
            String::new()
        };
        Line::ok(name, text + &turns)
    };
    line.figure("order_misfit", check.given.misfit)
}

/// Electrodes that two of these pairs have in common; of a pair alone both.
fn common(pairs: &[&Finding]) -> Vec<usize> {
    let all: Vec<usize> = pairs.iter().flat_map(|f| f.electrodes.iter().copied()).collect();
    let twice = |l: &usize| all.iter().filter(|other| *other == l).count() > 1;
    let shared: Vec<usize> = all.iter().copied().filter(twice).collect();
    if shared.is_empty() { all } else { shared }
}

/// Findings that are told one by one.
const MOST_SAID: usize = 3;

fn contact(inspection: &Inspection) -> Line {
    let name = "contact";
    let of = |kind: FindingKind| -> Vec<&Finding> { inspection.findings.iter().filter(|f| f.kind == kind).collect() };
    let advice = "look at the clamp, the wire and the plug of each; clean the contact, then take a new baseline";
    let texts = |found: &[&Finding]| {
        let mut texts: Vec<String> = found.iter().take(MOST_SAID).map(ToString::to_string).collect();
        if found.len() > MOST_SAID {
            texts.push(format!("and {} more", found.len() - MOST_SAID));
        }
        texts.join("; ")
    };
    if !inspection.conclusive {
        return Line::not_known(name, "the values are not those of the sheet as described");
    }
    let dead = [FindingKind::Electrode, FindingKind::DrivePair, FindingKind::SensePair];
    let dead: Vec<&Finding> = dead.into_iter().flat_map(of).collect();
    if !dead.is_empty() {
        return Line::bad(name, texts(&dead), Cause::Wiring, advice)
            .electrodes(dead.iter().flat_map(|f| f.electrodes.clone()));
    }
    if let Some(fault @ (Fault::Open(electrodes) | Fault::Contacts(electrodes) | Fault::Loose(electrodes))) =
        &inspection.fault
    {
        return Line::bad(name, fault.to_string(), Cause::Wiring, advice)
            .electrodes(electrodes.list().iter().map(|l| l + 1));
    }
    let weak: Vec<&Finding> = [FindingKind::Contact, FindingKind::DriveGain, FindingKind::Value]
        .into_iter()
        .flat_map(of)
        .collect();
    if !weak.is_empty() {
        return Line::look(name, texts(&weak), Cause::Wiring, advice).electrodes(common(&weak));
    }
    let Some(fit) = &inspection.electrodes else {
        return Line::ok(name, "all electrodes give a signal");
    };
    let middle = median(fit.contact.iter().copied());
    let worst = fit.contact.iter().fold(0.0_f64, |m, c| m.max(c / middle));
    let text = format!(
        "all {} give a signal; the worst contact is {worst:.1} times the median",
        fit.contact.len()
    );
    Line::ok(name, text).figure("worst_contact", worst)
}
