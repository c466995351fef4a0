//! A picture of the error against the number of known presses, an SVG.

use super::bench::Row;

/// Width and height of a panel, and the room around its axes.
const PANEL: [f64; 2] = [330.0, 300.0];
const ROOM: [f64; 4] = [48.0, 34.0, 14.0, 44.0];
/// Ends of the axes: known presses, and mm.
const KNOWN: [f64; 2] = [4.0, 1300.0];
const ERROR_MM: [f64; 2] = [0.8, 60.0];
/// Of learning, of kernel ridge regression, of the model alone (Okabe and Ito 2008).
const COLOURS: [&str; 3] = ["#0072b2", "#d55e00", "#009e73"];

fn along(value: f64, [low, high]: [f64; 2]) -> f64 {
    ((value / low).ln() / (high / low).ln()).clamp(0.0, 1.0)
}

/// Place of a point in a panel.
fn at(known: f64, error_mm: f64) -> [f64; 2] {
    let [left, top, right, bottom] = ROOM;
    [
        left + along(known, KNOWN) * (PANEL[0] - left - right),
        PANEL[1] - bottom - along(error_mm, ERROR_MM) * (PANEL[1] - top - bottom),
    ]
}

fn line(points: &[(f64, f64)], colour: &str, dashes: &str) -> String {
    let there: Vec<String> = (points.iter().filter(|(_, mm)| mm.is_finite()))
        .map(|(known, mm)| at(*known, *mm))
        .map(|[x, y]| format!("{x:.1},{y:.1}"))
        .collect();
    let mut text = format!(
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\" stroke-dasharray=\"{dashes}\"/>\n",
        there.join(" ")
    );
    if dashes.is_empty() {
        for point in there {
            let [x, y] = [0, 1].map(|k| point.split(',').nth(k).unwrap_or_default().to_owned());
            text += &format!("<circle cx=\"{x}\" cy=\"{y}\" r=\"3\" fill=\"{colour}\"/>\n");
        }
    }
    text
}

fn words(x: f64, y: f64, anchor: &str, colour: &str, text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{text}</text>\n")
}

fn axes() -> String {
    let grey = "#555555";
    let mut text = String::new();
    for known in [5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0] {
        let ([x, low], [_, high]) = (at(known, ERROR_MM[0]), at(known, ERROR_MM[1]));
        text += &format!("<path d=\"M{x:.1} {low:.1}V{high:.1}\" stroke=\"#dddddd\"/>\n");
        text += &words(x, low + 14.0, "middle", grey, &format!("{known}"));
    }
    for mm in [1.0, 2.0, 5.0, 10.0, 20.0, 50.0] {
        let ([left, y], [right, _]) = (at(KNOWN[0], mm), at(KNOWN[1], mm));
        text += &format!("<path d=\"M{left:.1} {y:.1}H{right:.1}\" stroke=\"#dddddd\"/>\n");
        text += &words(left - 5.0, y + 4.0, "end", grey, &format!("{mm} mm"));
    }
    let [x, y] = at((KNOWN[0] * KNOWN[1]).sqrt(), ERROR_MM[0]);
    text + &words(x, y + 30.0, "middle", grey, "known presses")
}

fn panel(name: &str, rows: &[&Row]) -> String {
    let known = || rows.iter().filter(|r| r.known > 0);
    let of = |value: fn(&Row) -> f64| -> Vec<(f64, f64)> { known().map(|r| (r.known as f64, value(r))).collect() };
    let mut text = axes() + &words(ROOM[0], 20.0, "start", "black", name);
    text += &line(&of(|r| r.median_mm), COLOURS[0], "");
    text += &line(&of(|r| r.percentile_95_mm), COLOURS[0], "5 4");
    text += &line(&of(|r| r.ridge_median_mm.unwrap_or(f64::NAN)), COLOURS[1], "");
    text += &line(&of(|r| r.ridge_percentile_95_mm.unwrap_or(f64::NAN)), COLOURS[1], "5 4");
    for row in rows.iter().filter(|r| r.known == 0) {
        let all = |mm: f64| KNOWN.map(|known| (known, mm));
        text += &line(&all(row.median_mm), COLOURS[2], "1 3");
    }
    text
}

/// A panel for every skin: medians as points, 95th percentiles dashed.
pub(super) fn svg(rows: &[Row]) -> String {
    let mut names: Vec<&str> = rows.iter().map(|r| r.skin.as_str()).collect();
    names.dedup();
    let (width, height) = (PANEL[0] * names.len().max(1) as f64, PANEL[1] + 26.0);
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
         font-family=\"sans-serif\" font-size=\"11\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    );
    for (k, name) in names.iter().enumerate() {
        let of_skin: Vec<&Row> = rows.iter().filter(|r| r.skin == *name).collect();
        text += &format!(
            "<g transform=\"translate({} 0)\">\n{}</g>\n",
            PANEL[0] * k as f64,
            panel(name, &of_skin)
        );
    }
    let legend = ["learned maps", "kernel ridge regression", "model alone, median"];
    for (k, (colour, name)) in COLOURS.iter().zip(legend).enumerate() {
        text += &words(ROOM[0] + 130.0 * k as f64, PANEL[1] + 8.0, "start", colour, name);
    }
    text += &words(
        ROOM[0],
        PANEL[1] + 21.0,
        "start",
        "black",
        "solid: median; dashed: 95th percentile",
    );
    text + "</svg>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_skin_has_a_panel_and_larger_errors_lie_higher() {
        let row = |known: usize, median_mm: f64| Row {
            skin: "a<b".to_owned(),
            known,
            median_mm,
            percentile_95_mm: f64::INFINITY,
            ..Row::default()
        };
        let text = svg(&[row(0, 6.0), row(10, 4.0), row(100, 2.0)]);
        assert!(
            text.contains("a&lt;b") && !text.contains("inf") && !text.contains("NaN"),
            "{text}"
        );
        assert_eq!(text.matches("<circle").count(), 2);
        assert!(at(10.0, 4.0)[1] < at(100.0, 2.0)[1] && at(10.0, 4.0)[0] < at(100.0, 2.0)[0]);
    }
}
