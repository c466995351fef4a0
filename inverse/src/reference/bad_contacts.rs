//! Electrodes whose contact is worse than those of the others, in a baseline.
//!
//! A contact a little worse is found with the electrodes' places, and is in the model. One much worse weakens both pairs that its
//! electrode drives with, beyond what is fitted.

use crate::reference::electrode_fit::{ElectrodeFit, ElectrodeFitOptions};
use crate::reference::screening::{Finding, FindingKind, smallest};
use crate::stats::median;
use forward::Pattern;

/// A normal deviation has this part of its standard deviation as the median of its magnitude.
const MEDIAN_OF_NORMAL: f64 = 0.6745;

/// Puts one finding for each bad contact in place of the pairs that it weakens, and adds those that the fit of the electrodes shows.
pub(super) fn name(
    findings: &mut Vec<Finding>,
    pattern: &Pattern,
    fit: Option<&ElectrodeFit>,
    options: &ElectrodeFitOptions,
) {
    let weakened = of_weak_pairs(findings, pattern);
    for electrode in &weakened {
        let (of, others): (Vec<Finding>, Vec<Finding>) = std::mem::take(findings)
            .into_iter()
            .partition(|f| is_weak(f) && f.electrodes.contains(&(electrode + 1)));
        *findings = others;
        let values = of.iter().map(|f| f.values).sum();
        findings.push(finding(*electrode, None, values, pattern));
    }
    let Some(fit) = fit else { return };
    let driven = |l: usize| {
        pattern
            .measurements()
            .iter()
            .filter(move |m| m.drive.plus == l || m.drive.minus == l)
    };
    for (electrode, factor) in worse(&fit.contact, options) {
        if !weakened.contains(&electrode) {
            let values = driven(electrode).count();
            findings.push(finding(electrode, Some(factor), values, pattern));
        }
    }
}

fn is_weak(f: &Finding) -> bool {
    f.kind == FindingKind::DriveGain && f.factor.is_some_and(|factor| factor < 1.0)
}

fn finding(electrode: usize, factor: Option<f64>, values: usize, pattern: &Pattern) -> Finding {
    Finding {
        kind: FindingKind::Contact,
        electrodes: vec![electrode + 1],
        value: None,
        factor,
        values,
        of: pattern.len(),
        left_out: false,
    }
}

/// The fewest electrodes that explain the weak drive pairs: of each all pairs are weak, two at least.
fn of_weak_pairs(findings: &[Finding], pattern: &Pattern) -> Vec<usize> {
    let weak: Vec<[usize; 2]> = findings
        .iter()
        .filter(|f| is_weak(f))
        .filter_map(|f| Some([f.electrodes.first()? - 1, f.electrodes.get(1)? - 1]))
        .collect();
    let all_weak = |l: &usize| {
        let mut pairs: Vec<[usize; 2]> = pattern
            .measurements()
            .iter()
            .map(|m| [m.drive.plus, m.drive.minus])
            .filter(|pair| pair.contains(l))
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        pairs.len() > 1 && pairs.iter().all(|pair| weak.contains(pair))
    };
    let candidates: Vec<usize> = (0..pattern.electrodes()).filter(all_weak).collect();
    smallest(&candidates, weak.len(), |k, l| weak[k].contains(&l))
}

/// Contacts that stand out of the others, with how many times the median they are. Those of one sheet scatter; out of a large scatter
/// stands what no hand makes.
fn worse(contacts: &[f64], options: &ElectrodeFitOptions) -> Vec<(usize, f64)> {
    let logarithms: Vec<f64> = contacts.iter().map(|c| c.ln()).collect();
    let middle = median(logarithms.iter().copied());
    let off = logarithms.iter().map(|l| (l - middle).abs());
    let [least, widest] = options.contacts;
    let scatter = (median(off) / MEDIAN_OF_NORMAL).max(least);
    let most = (options.outlier * scatter).min(options.most_moves * widest);
    let worse = logarithms.iter().enumerate().filter(|(_, l)| *l - middle > most);
    worse.map(|(electrode, l)| (electrode, (l - middle).exp())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weak(plus: usize, minus: usize) -> Finding {
        Finding {
            kind: FindingKind::DriveGain,
            electrodes: vec![plus, minus],
            value: None,
            factor: Some(0.3),
            values: 13,
            of: 208,
            left_out: false,
        }
    }

    fn named(pairs: &[[usize; 2]]) -> Vec<(FindingKind, Vec<usize>)> {
        let mut findings: Vec<Finding> = pairs.iter().map(|p| weak(p[0], p[1])).collect();
        let pattern = Pattern::adjacent(16).unwrap();
        name(&mut findings, &pattern, None, &ElectrodeFitOptions::default());
        findings.into_iter().map(|f| (f.kind, f.electrodes)).collect()
    }

    #[test]
    fn the_fewest_contacts_explain_the_weak_pairs() {
        let contact = |l: usize| (FindingKind::Contact, vec![l]);
        assert_eq!(named(&[[2, 3], [3, 4]]), [contact(3)]);
        assert_eq!(named(&[[2, 3], [3, 4], [4, 5], [5, 6]]), [contact(3), contact(5)]);
        assert_eq!(named(&[[16, 1], [1, 2]]), [contact(1)]);
        // One pair alone is the pair's.
        assert_eq!(named(&[[2, 3]]), [(FindingKind::DriveGain, vec![2, 3])]);
        assert_eq!(named(&[[2, 3], [5, 6]]).len(), 2);
    }

    #[test]
    fn contacts_stand_out_of_the_scatter_of_the_others() {
        let options = ElectrodeFitOptions::default();
        let mut even = vec![1.0; 16];
        even[4] = 1.6;
        assert_eq!(worse(&even, &options), []);
        even[4] = 2.5;
        assert_eq!(worse(&even, &options), [(4, 2.5)]);
        // Contacts that all scatter by a half.
        let mut uneven: Vec<f64> = (0..16).map(|k| (0.75 * (1.9 * f64::from(k)).sin()).exp()).collect();
        assert_eq!(worse(&uneven, &options), []);
        uneven[4] = 12.0;
        let found = worse(&uneven, &options);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].0, 4);
    }
}
