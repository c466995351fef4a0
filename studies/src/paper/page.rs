//! The report as one page.

use crate::paper::chart::{Chart, Series};
use crate::paper::map::bar;
use crate::paper::reach::RIM_MM;
use crate::paper::touches::Outcome;
use crate::paper::tracking::ForceError;
use crate::paper::{Map, Report, noise};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use view::palette::{Palette, index};
use view::picture::circle_mm;

/// Position errors that the map's colours span, mm, by their logarithms.
const ERRORS_MM: [f64; 2] = [0.02, 20.0];

/// A whole page.
pub(super) fn document(title: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(include_str!("style.css"))) }
            }
            body { (body) }
        }
    };
    page.into_string()
}

pub(super) fn html(report: &Report) -> String {
    let body = html! {
        (head(report))
        (gradients(report))
        (inverse(report))
        (scenes(report))
        (tracking(report))
        (creep(report))
        (time(report))
        (separation(report))
        (positions(report))
    };
    document("The paper's experiments again, in simulation", &body)
}

fn head(r: &Report) -> Markup {
    let run = format!(
        "skin paper --out DIR --seed {}{}",
        r.options.seed,
        if r.options.quick { " --quick" } else { "" }
    );
    let theirs = update_ms(r, "the paper", |s| &s.theirs);
    let ours = update_ms(r, "ours", |s| &s.ours);
    let way = |name: &str| r.ways.iter().find(|w| w.name.starts_with(name));
    let found = |of: fn(&crate::paper::touches::Scene) -> &Outcome| {
        let list = r.touches.scenes.iter().map(|s| format!("{}", of(s).found));
        format!("told {}", list.collect::<Vec<_>>().join(", "))
    };
    let (fig10, fig11) = (&r.tracking.varying, &r.tracking.repeated);
    let panel = |name: &str| {
        r.touches
            .panels
            .iter()
            .find(|p| p.name.starts_with(name))
            .map(|p| &p.outcome)
    };
    html! {
        h1 { "The paper's experiments again, in simulation" }
        p.lead {
            "Kato, Hayakawa, Mukai and others: “Tactile sensor without wire and sensing element in the tactile region using EIT \
             method”. Figures 7, 8, 10 and 11, the noise and the times come from frames through the whole chain: rubber, \
             electronics, firmware, serial protocol, this program. " code { (run) } " wrote this page and " code { "report.json" } "."
        }
        @if r.options.quick { p.note { "A quick run: a tenth of the frames, shorter presses." } }
        nav {
            @for (id, name) in [
                ("fig4", "Fig. 4"), ("fig7", "Fig. 7"), ("fig8", "Fig. 8"), ("fig10", "Figs. 10, 11"), ("creep", "Creep"),
                ("time", "Noise and time"), ("apart", "Two touches"), ("position", "Position"),
            ] { a href=(format!("#{id}")) { (name) } }
        }
        div.wide { table.summary {
            thead { tr { th { "quantity" } th { "the paper" } th { "here, their way" } th { "here, ours" } } }
            tbody {
                tr { td { "signal to noise, 25 N" } td { "27 dB" }
                    td.here { (way("the paper").map_or(String::new(), |w| format!("{:.1} dB", w.snr_db))) }
                    td.here { (way("ours").map_or(String::new(), |w| format!("{:.1} dB", w.snr_db))) } }
                tr { td { "update time, measured and reconstructed" } td { "about 360 ms" }
                    td.here { (format!("{theirs:.0} ms")) } td.here { (format!("{ours:.1} ms")) } }
                tr { td { "1, 2, 3 and 4 touches (Fig. 8)" } td { "told apart" }
                    td.here { (found(|s| &s.theirs)) } td.here { (found(|s| &s.ours)) } }
                tr { td { "three touches by the generalised inverse (Fig. 7), 20 mm" } td { "fails" }
                    td.here { (panel("generalised").map_or(String::new(), worst)) } td { "–" } }
                tr { td { "three touches, non-negative (Fig. 7)" } td { "works" }
                    td.here { (panel("Lawson").map_or(String::new(), worst)) }
                    td.here { (panel("ours").map_or(String::new(), worst)) } }
                tr { td { "a force that goes up and down (Fig. 10), error rms" } td { "tracked" }
                    td.here { (percent(fig10.theirs.rms)) } td.here { (percent(fig10.after.rms)) } }
                tr { td { "repeated loads (Fig. 11), left after a release" } td { "residual deformation" }
                    td.here { (format!("{:.1} N", fig11.residual_n[0])) } td.here { (format!("{:.1} N", fig11.residual_n[2])) } }
                tr { td { "repeated loads, largest force error" } td { "not given" }
                    td.here { (percent(fig11.theirs.largest)) } td.here { (percent(fig11.after.largest)) } }
                tr { td { "position of one touch, median / 95 %" } td { "not given" }
                    td.here { (pair_mm(r.reach.positions.theirs_mm)) } td.here { (pair_mm(r.reach.positions.ours_mm)) } }
            }
        } }
        p.note { "Force errors are parts of the full scale of 25 N. Their way of a force is the picture of their method at the tip, by the gain \
             that fits the gauge best; ours is the fitted touch with the creep taken out." }
    }
}

/// Error of the worst touch, and the lowest value of the picture; pressure makes no value negative.
fn worst(o: &Outcome) -> String {
    let off = o.errors_mm.iter().flatten().copied().fold(0.0, f64::max);
    if o.range[0] < 0.0 {
        format!("{off:.0} mm off, falls to −{:.0} %", -100.0 * o.range[0])
    } else {
        format!("{off:.1} mm off, no fall")
    }
}

fn percent(part: f64) -> String {
    format!("{:.1} %", 100.0 * part)
}

fn pair_mm([median, high]: [f64; 2]) -> String {
    format!("{median:.2} / {high:.1} mm")
}

/// Measured time of a frame by a way, and the median time from voltages to touches by a method, ms.
fn update_ms(r: &Report, way: &str, of: fn(&crate::paper::touches::Scene) -> &Outcome) -> f64 {
    let measuring = r
        .ways
        .iter()
        .find(|w| w.name.starts_with(way))
        .map_or(f64::NAN, |w| w.measured_ms);
    let times: Vec<f64> = r.touches.scenes.iter().map(|s| of(s).frame_ms).collect();
    measuring + times.iter().sum::<f64>() / times.len().max(1) as f64
}

fn gradients(r: &Report) -> Markup {
    html! {
        h2 id="fig4" { "Fig. 4: where a pair of electrodes listens" }
        p { "Product of the potential gradients of drive pair 1–2 and a sense pair. Red: a rise of the resistivity there raises the \
             voltage; blue: it lowers it. Each on its own scale of fourth roots. As in the paper the product is strong near the \
             electrodes in use and changes its sign in between." }
        div.maps.six { @for g in &r.gradients { figure {
            (g.map.svg(&format!("g{}", g.sense), &format!("product of gradients, sense pair {}", g.sense)))
            figcaption { b { "sense " (g.sense) "–" (g.sense % 16 + 1) } br;
                (format!("largest {:.2} mΩ per % mm²", 10.0 * g.largest_ohm_per_mm2)) br;
                (format!("sum {:.2} Ω, transfer {:.2} Ω", g.sum_ohm, g.transfer_ohm)) }
        } } }
        (bar(Palette::Diverging, "lowers", "", "raises"))
        p.note { "By theory the sum over the sheet is the transfer resistance itself, less what the contacts take." }
    }
}

pub(super) fn scale(o: &Outcome) -> String {
    match o.map.scale() {
        [0.0, high] => format!("0 … {:.1} %", 100.0 * high),
        [_, high] => format!("±{:.0} %", 100.0 * high),
    }
}

pub(super) fn errors(o: &Outcome, of: usize) -> String {
    let known: Vec<f64> = o.errors_mm.iter().flatten().copied().collect();
    match known.iter().copied().reduce(f64::max) {
        Some(worst) if known.len() == of => format!("{} found, within {worst:.1} mm", o.found),
        _ => format!("{} found", o.found),
    }
}

fn inverse(r: &Report) -> Markup {
    html! {
        h2 id="fig7" { "Fig. 7: the generalised inverse fails where non-negative least squares works" }
        p { "The frame of three touches below, by every method, each on its own scale. Rings: where was pressed; crosses: the touches \
             told. The paper shows that the generalised inverse gives nothing to recognise: so it is with fine elements, and with \
             elements of 20 mm in some frames; it falls where nothing was pressed in all of them." }
        div.maps.five { @for (k, p) in r.touches.panels.iter().enumerate() { figure {
            (p.outcome.map.svg(&format!("p{k}"), p.name))
            figcaption { b { (p.name) } br; (scale(&p.outcome)) br; (errors(&p.outcome, 3)) }
        } } }
        (bar(Palette::Viridis, "0", "rise of the resistivity, where nothing falls", "greatest"))
        (bar(Palette::Diverging, "falls", "where the picture falls too", "rises"))
    }
}

fn scenes(r: &Report) -> Markup {
    let empty = Map::empty(&r.touches.outline_mm, &circle_mm(RIM_MM, 16));
    html! {
        h2 id="fig8" { "Fig. 8: one to four touches" }
        p { "Fingers of 10 N, measured in the paper's way (208 values one by one, six periods each), one frame each. The true positions \
             stand for the paper's photographs." }
        p { b { "Where was pressed" } }
        div.maps.scenes { @for (k, s) in r.touches.scenes.iter().enumerate() { figure {
            (empty.clone().with_truth(&s.truth_mm).with_fingers().svg(&format!("t{k}"), "true positions"))
        } } }
        @for (title, id, of) in [
            ("The paper's method: Lawson–Hanson on 20 mm elements", "l", (|s| &s.theirs) as fn(&crate::paper::touches::Scene) -> &Outcome),
            ("Ours: ridge and x ≥ 0 on 5 mm cells, touches fitted", "o", |s| &s.ours),
        ] {
            p { b { (title) } }
            div.maps.scenes { @for (k, s) in r.touches.scenes.iter().enumerate() { figure {
                (of(s).map.svg(&format!("{id}{k}"), title))
                figcaption { (errors(of(s), s.truth_mm.len())) br; (scale(of(s))) }
            } } }
        }
        (bar(Palette::Viridis, "0", "rise of the resistivity", "greatest"))
    }
}

pub(super) fn line<'a>(name: &'a str, class: &'static str, points: Vec<[f64; 2]>) -> Series<'a> {
    Series {
        name,
        class,
        points,
        marked: false,
    }
}

fn tracking(r: &Report) -> Markup {
    let t = &r.tracking;
    html! {
        h2 id="fig10" { "Figs. 10 and 11: a tip pressed in a time-varying way" }
        p { "The paper's tip of 25 mm near the centre under a force gauge, on rubber that creeps. The reconstructed value follows the \
             force, and creep makes it fall behind: it goes on rising under a constant force, and after repeated loads a residual \
             stays, as in the paper." }
        @for (name, e) in [("Fig. 10: up and down", &t.varying), ("Fig. 11: the same load again and again", &t.repeated)] {
            p { b { (name) } }
            (Chart {
                label: name,
                axes: ["time, s", "force, N"],
                series: vec![
                    line("force gauge", "s1", e.moments.iter().map(|m| [m.time_s, m.gauge_n]).collect()),
                    line("the paper's method, best gain", "s4", e.moments.iter().map(|m| [m.time_s, m.theirs_n]).collect()),
                    line("ours with the creep in it", "s2", e.moments.iter().map(|m| [m.time_s, m.before_n]).collect()),
                    line("ours, creep taken out", "s3", e.moments.iter().map(|m| [m.time_s, m.after_n]).collect()),
                ],
                range: None,
            }.html())
        }
    }
}

fn creep(r: &Report) -> Markup {
    let (t, h) = (&r.tracking, &r.tracking.hold);
    let error = |e: &ForceError| {
        format!(
            "{:.1} / {:.1} / {:.1} %",
            100.0 * e.rms,
            100.0 * e.p99,
            100.0 * e.largest
        )
    };
    let names = [
        "delayed over instant compliance",
        "time constant, s",
        "pressure of a unit rise, MPa",
    ];
    html! {
        h2 id="creep" { "The creep taken out" }
        p { "The parameters are those that " code { "skin calibrate" } " fits to a press-and-hold of its own, at another place and with \
             other noise. A causal filter then recovers the force from the history of the resistivity." }
        (Chart {
            label: "press-and-hold and its fit",
            axes: ["time, s", "integrated rise, mm²"],
            series: vec![
                line("press-and-hold of 25 N", "s2", h.moments.iter().map(|m| [m[0], m[2]]).collect()),
                line("fit", "s1", h.moments.iter().map(|m| [m[0], m[3]]).collect()),
            ],
            range: None,
        }.html())
        div.wide { table {
            thead { tr { th { "parameter" } th.n { "fitted" } th.n { "standard error" } th.n { "the rubber's own" } } }
            tbody { @for (k, name) in names.iter().enumerate() { tr {
                td { (name) } td.n.here { (format!("{:.4}", h.fitted[k])) } td.n { (format!("{:.4}", h.standard_errors[k])) }
                td.n { (h.truth.map_or("not known".to_owned(), |t| format!("{:.4}", t[k]))) }
            } } }
        } }
        div.wide { table {
            thead { tr { th { "force error, rms / 99 % / largest, of 25 N" } th.n { "Fig. 10" } th.n { "Fig. 11" } } }
            tbody {
                tr { td { "the paper's method, best gain" } td.n { (error(&t.varying.theirs)) } td.n { (error(&t.repeated.theirs)) } }
                tr { td { "before: the instant gain" } td.n { (error(&t.varying.before)) } td.n { (error(&t.repeated.before)) } }
                tr { td { "before, with the gain that fits best" }
                    td.n { (error(&t.varying.before_best_gain)) } td.n { (error(&t.repeated.before_best_gain)) } }
                tr { td { "after" } td.n.here { (error(&t.varying.after)) } td.n.here { (error(&t.repeated.after)) } }
                tr { td { "left half a second after a release, before → after" }
                    @for e in [&t.varying, &t.repeated] {
                        td.n { (format!("{:.2} → {:.2} N", e.residual_n[1], e.residual_n[2])) }
                    } }
                tr { td { "correlation with the gauge, before" }
                    td.n { (format!("{:.4}", t.varying.correlation)) } td.n { (format!("{:.4}", t.repeated.correlation)) } }
            }
        } }
    }
}

fn time(r: &Report) -> Markup {
    html! {
        h2 id="time" { "Noise and time" }
        p { "Signal to noise by the paper's definition, 20 log₁₀ of the change under 25 N in the middle over the noise of the unpressed \
             sheet (2-norms over a frame). The time of a frame is measured by the board's clock, from frame to frame." }
        div.wide { table {
            thead { tr { th { "way of measuring" } th.n { "periods" } th.n { "computed, ms" } th.n { "measured, ms" } th.n { "frames/s" }
                th.n { "bytes" } th.n { "SNR, dB" } } }
            tbody { @for w in &r.ways { tr {
                td { (w.name) } td.n { (w.periods) } td.n { (format!("{:.1}", w.computed_ms)) } td.n.here { (format!("{:.1}", w.measured_ms)) }
                td.n { (format!("{:.1}", w.frames_per_s)) } td.n { (format!("{:.0}", w.bytes)) } td.n { (format!("{:.1}", w.snr_db)) }
            } } }
        } }
        p { (format!(
            "Update time, the paper's way: {:.0} ms, of which {:.2} ms are the reconstruction on this machine (the paper: about {:.0} ms \
             in all). Ours: {:.1} ms, of which {:.2} ms.",
            update_ms(r, "the paper", |s| &s.theirs), solve_ms(r, |s| &s.theirs), noise::PAPER_UPDATE_MS,
            update_ms(r, "ours", |s| &s.ours), solve_ms(r, |s| &s.ours),
        )) }
        p.note { "Times on the board are simulated and exact; times of the reconstruction are this machine's." }
    }
}

fn solve_ms(r: &Report, of: fn(&crate::paper::touches::Scene) -> &Outcome) -> f64 {
    r.touches.scenes.iter().map(|s| of(s).frame_ms).sum::<f64>() / r.touches.scenes.len().max(1) as f64
}

fn separation(r: &Report) -> Markup {
    let points = |width_mm: f64, of: fn(&crate::paper::reach::Separation) -> f64| -> Vec<[f64; 2]> {
        let list = r.reach.separations.iter().filter(|s| s.width_mm == width_mm);
        list.map(|s| [s.apart_mm, 100.0 * of(s)]).collect()
    };
    let [tip, finger] = crate::paper::reach::WIDTHS_MM;
    let marked = |name, class, width, of| Series {
        marked: true,
        ..line(name, class, points(width, of))
    };
    let frames = r.reach.separations.first().map_or(0, |s| s.frames);
    html! {
        h2 id="apart" { "Two touches closer and closer" }
        p { (format!(
            "Not in the paper. Two discs anywhere on the sheet, with the noise that 27 dB are in the middle: the paper's tips of \
             {tip:.0} mm and +20 %, which touch at {tip:.0} mm, and fingertips of {finger:.0} mm and +25 %. Told apart: two touches \
             are found, both within {:.0} mm or half of their distance. {frames} frames at every distance, the same for both methods.",
            crate::paper::reach::RESOLVED_MM
        )) }
        (Chart {
            label: "told apart against distance",
            axes: ["distance between the middles, mm", "told apart, %"],
            series: vec![
                marked("ours, tips", "s3", tip, |s| s.ours.both),
                marked("ours, fingertips", "s1", finger, |s| s.ours.both),
                marked("the paper's method, tips", "s2", tip, |s| s.theirs.both),
                marked("the paper's method, fingertips", "s4", finger, |s| s.theirs.both),
            ],
            range: Some([0.0, 105.0]),
        }.html())
    }
}

fn positions(r: &Report) -> Markup {
    let p = &r.reach.positions;
    let table = Palette::Viridis.table();
    let hexagons = |of: fn(&crate::paper::reach::Place) -> Option<f64>| -> Vec<([f64; 2], f64, [u8; 3])> {
        let colour = |mm: Option<f64>| {
            mm.map_or([120; 3], |mm| {
                let part = (mm / ERRORS_MM[0]).ln() / (ERRORS_MM[1] / ERRORS_MM[0]).ln();
                table[index(part as f32)]
            })
        };
        p.places
            .iter()
            .map(|q| (q.at_mm, p.spacing_mm, colour(of(q))))
            .collect()
    };
    let empty = Map::empty(&circle_mm(RIM_MM, 180), &circle_mm(RIM_MM, 16));
    html! {
        h2 id="position" { "Position error over the sheet" }
        p { "Not in the paper. One tip of 25 mm and +20 % at " (p.places.len()) " places, " (p.frames)
            (if p.frames == 1 { " frame" } else { " frames" }) " each, with the noise that 27 dB are in the middle. Median distance of \
             the touch found from the true place." }
        div.maps.two {
            @for (name, id, of, list, counted) in [
                ("the paper's method", "et", (|q| q.theirs_mm) as fn(&crate::paper::reach::Place) -> Option<f64>, p.theirs_mm, p.counted[0]),
                ("ours", "eo", |q| q.ours_mm, p.ours_mm, p.counted[1]),
            ] { figure {
                (empty.clone().with_hexagons(hexagons(of)).svg(id, &format!("position error, {name}")))
                figcaption { b { (name) } (format!(": median {:.2} mm, 95 % within {:.1} mm, count right in {:.0} %", list[0], list[1], 100.0 * counted)) }
            } }
        }
        (bar(Palette::Viridis, &format!("{} mm", ERRORS_MM[0]), "logarithmic", &format!("{:.0} mm", ERRORS_MM[1])))
    }
}
