//! The report of a recorded run as one page.

use crate::paper::chart::Chart;
use crate::paper::map::bar;
use crate::paper::page::{document, errors, line, scale};
use crate::paper::recorded::{Forces, RecordedMoment, RecordedReport};
use crate::paper::touches::Outcome;
use crate::paper::tracking::ForceError;
use maud::{Markup, html};
use view::palette::Palette;

const TITLE: &str = "The paper's figures of a recorded run";

pub(super) fn html(report: &RecordedReport) -> String {
    let body = html! {
        h1 { (TITLE) }
        p.lead { (report.source) }
        p.note { "A recording does not say where was pressed. Rings are the touches that were found while it was recorded. Fig. 4 and \
                  the sections on true positions need a sheet whose touches are known: " code { "skin paper" } " without a recording \
                  has them." }
        (inverse(report))
        (scenes(report))
        @if let Some(forces) = &report.forces { (tracking(forces)) }
        (time(report))
    };
    document(TITLE, &body)
}

fn inverse(r: &RecordedReport) -> Markup {
    let touches = r.scenes.last().map_or(0, |s| s.recorded_mm.len());
    html! {
        h2 id="fig7" { "Fig. 7: one frame by every method" }
        @if r.panels.is_empty() {
            p { "Nothing touched while this was recorded." }
        } @else {
            p { "The frame of most touches below, each on its own scale. Rings: the recorded touches; crosses: those of the method." }
            div.maps.five { @for (k, p) in r.panels.iter().enumerate() { figure {
                (p.outcome.map.svg(&format!("p{k}"), &p.name))
                figcaption { b { (p.name) } br; (scale(&p.outcome)) br; (errors(&p.outcome, touches)) }
            } } }
            (bar(Palette::Viridis, "0", "rise of the resistivity, where nothing falls", "greatest"))
            (bar(Palette::Diverging, "falls", "where the picture falls too", "rises"))
        }
    }
}

fn scenes(r: &RecordedReport) -> Markup {
    html! {
        h2 id="fig8" { "Fig. 8: one to four touches" }
        @if r.scenes.is_empty() { p { "Nothing touched while this was recorded." } }
        p { "For every number of touches the frame whose weakest touch is strongest." }
        @for (title, id, of) in [
            ("The paper's method: Lawson–Hanson", "l", (|s| &s.theirs) as fn(&crate::paper::recorded::RecordedScene) -> &Outcome),
            ("Ours: ridge and x ≥ 0, touches fitted", "o", |s| &s.ours),
        ] {
            p { b { (title) } }
            div.maps.scenes { @for (k, s) in r.scenes.iter().enumerate() { figure {
                (of(s).map.svg(&format!("{id}{k}"), title))
                figcaption { (format!("at {:.2} s: ", s.at_s)) (errors(of(s), s.recorded_mm.len())) br; (scale(of(s))) }
            } } }
        }
        (bar(Palette::Viridis, "0", "rise of the resistivity", "greatest"))
    }
}

fn tracking(f: &Forces) -> Markup {
    let points = |read: fn(&RecordedMoment) -> f64| f.moments.iter().map(|m| [m.time_s, read(m)]).collect::<Vec<_>>();
    let gauge: Vec<[f64; 2]> = f.moments.iter().filter_map(|m| Some([m.time_s, m.gauge_n?])).collect();
    let mut series = vec![
        line("the paper's method, best gain", "s4", points(|m| m.theirs_n)),
        line("ours with the creep in it", "s2", points(|m| m.before_n)),
        line("ours, as recorded", "s3", points(|m| m.recorded_n)),
    ];
    if !gauge.is_empty() {
        series.insert(0, line("force gauge", "s1", gauge));
    }
    let error = |e: &ForceError| {
        format!(
            "{:.1} / {:.1} / {:.1} %",
            100.0 * e.rms,
            100.0 * e.p99,
            100.0 * e.largest
        )
    };
    html! {
        h2 id="fig10" { "Figs. 10 and 11: force over time" }
        p { "Forces of all touches together." }
        @if f.uncalibrated { p.note { "The forces are those of a typical rubber: the run had no calibration, and the creep is in them." } }
        (Chart { label: "force over time", axes: ["time, s", "force, N"], series, range: None }.html())
        @if let (Some(full), Some([theirs, before, after])) = (f.full_scale_n, &f.errors) {
            div.wide { table {
                thead { tr { th { (format!("difference from the gauge, rms / 99 % / largest, of {full:.1} N")) } th.n { "" } } }
                tbody {
                    tr { td { "the paper's method, best gain" } td.n { (error(theirs)) } }
                    tr { td { "ours with the creep in it" } td.n { (error(before)) } }
                    tr { td { "ours, as recorded" } td.n.here { (error(after)) } }
                }
            } }
        } @else {
            p.note { "Without readings of a gauge the paper's method has the gain that fits the recorded forces best." }
        }
    }
}

fn time(r: &RecordedReport) -> Markup {
    let t = &r.timing;
    html! {
        h2 id="time" { "Noise and time" }
        div.wide { table { tbody {
            tr { td { "frames" } td.n { (t.frames) " of " (t.values) " values in " (format!("{:.1} s", t.seconds)) } }
            tr { td { "time from frame to frame, by the board's clock" } td.n { (format!("{:.2} ms", t.measured_ms)) } }
            @if let Some(bytes) = t.bytes { tr { td { "bytes of a frame on the wire" } td.n { (format!("{bytes:.0}")) } } }
            tr { td { (format!("signal to noise of the strongest frame, at {:.2} s", t.strongest_s)) }
                td.n.here { (format!("{:.1} dB", t.snr_db)) } }
        } } }
        p.note { "Signal to noise by the paper's definition, 20 log₁₀ of the change over the noise of the unpressed sheet (2-norms over a \
                  frame). The paper's 27 dB are of 25 N in the middle." }
    }
}
