//! Line charts as SVG that follow the page's colours.

use maud::{Markup, html};
use view::sheet::ticks;

/// One line of a chart.
pub(super) struct Series<'a> {
    /// Its name, in the legend.
    pub(super) name: &'a str,
    /// Its colour: a class of the page's style.
    pub(super) class: &'static str,
    /// The points.
    pub(super) points: Vec<[f64; 2]>,
    /// Whether every point is marked.
    pub(super) marked: bool,
}

/// A chart.
pub(super) struct Chart<'a> {
    /// Text for readers who cannot see the chart.
    pub(super) label: &'a str,
    /// Labels of the axes: below and beside.
    pub(super) axes: [&'a str; 2],
    /// Lines, drawn in this order.
    pub(super) series: Vec<Series<'a>>,
    /// Lowest and highest value of the vertical axis; `None` takes those of the points.
    pub(super) range: Option<[f64; 2]>,
}

const WIDTH: f64 = 520.0;
const HEIGHT: f64 = 290.0;
/// Margins: left, right, top, bottom, px.
const MARGIN: [f64; 4] = [50.0, 12.0, 12.0, 44.0];
/// Points closer than this to the simplified line are left out, px.
const FINE: f64 = 0.25;

impl Chart<'_> {
    /// The chart with its legend.
    pub(super) fn html(&self) -> Markup {
        let all = || {
            self.series
                .iter()
                .flat_map(|s| &s.points)
                .filter(|p| p[0].is_finite() && p[1].is_finite())
        };
        let bounds = |k: usize| {
            let start = [f64::INFINITY, f64::NEG_INFINITY];
            all()
                .map(|p| p[k])
                .fold(start, |b: [f64; 2], v| [b[0].min(v), b[1].max(v)])
        };
        let (mut across, mut up) = (bounds(0), bounds(1));
        up = self
            .range
            .unwrap_or_else(|| [up[0].min(0.0), up[1] + 0.05 * (up[1] - up[0].min(0.0))]);
        for b in [&mut across, &mut up] {
            if b[0].partial_cmp(&b[1]) != Some(std::cmp::Ordering::Less) {
                *b = [0.0, 1.0];
            }
        }
        let [left, right, top, bottom] = MARGIN;
        let x = |v: f64| left + (v - across[0]) / (across[1] - across[0]) * (WIDTH - left - right);
        let y = |v: f64| HEIGHT - bottom - (v - up[0]) / (up[1] - up[0]) * (HEIGHT - top - bottom);
        let place = |p: &[f64; 2]| [x(p[0]), y(p[1].clamp(up[0], up[1]))];
        let number = |v: f64| format!("{}", (v * 1e6).round() / 1e6);
        html! {
            figure.chart {
                svg viewBox=(format!("0 0 {WIDTH} {HEIGHT}")) role="img" aria-label=(self.label) {
                    @for v in ticks(up[0], up[1], 5) {
                        line class="grid" x1=(left) x2=(WIDTH - right) y1=(px(y(v))) y2=(px(y(v))) {}
                        text class="tick end" x=(left - 6.0) y=(px(y(v) + 4.0)) { (number(v)) }
                    }
                    @for v in ticks(across[0], across[1], 7) {
                        line class="grid" x1=(px(x(v))) x2=(px(x(v))) y1=(top) y2=(HEIGHT - bottom) {}
                        text class="tick middle" x=(px(x(v))) y=(HEIGHT - bottom + 16.0) { (number(v)) }
                    }
                    line class="axis" x1=(left) x2=(WIDTH - right) y1=(HEIGHT - bottom) y2=(HEIGHT - bottom) {}
                    text class="axis-name middle" x=((left + WIDTH - right) / 2.0) y=(HEIGHT - 5.0) { (self.axes[0]) }
                    text class="axis-name middle" transform=(format!("translate(12 {}) rotate(-90)", (top + HEIGHT - bottom) / 2.0)) {
                        (self.axes[1])
                    }
                    @for s in &self.series {
                        @let all = s.points.iter().filter(|p| p[0].is_finite() && p[1].is_finite()).map(place).collect();
                        @let points = if s.marked { all } else { thinned(all) };
                        polyline class=(format!("line {}", s.class))
                            points=(points.iter().map(|p| format!("{},{}", px(p[0]), px(p[1]))).collect::<Vec<_>>().join(" ")) {}
                        @if s.marked {
                            @for p in &points { circle class=(format!("mark {}", s.class)) cx=(px(p[0])) cy=(px(p[1])) r="3.5" {} }
                        }
                    }
                }
                div.legend { @for s in &self.series { span class=(s.class) { i {} (s.name) } } }
            }
        }
    }
}

fn px(v: f64) -> String {
    format!("{:.1}", v)
}

/// The line without points that make no visible difference (Ramer 1972, Douglas and Peucker 1973).
fn thinned(points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    if points.len() < 3 {
        return points;
    }
    let mut keep = vec![false; points.len()];
    let last = points.len() - 1;
    (keep[0], keep[last]) = (true, true);
    let mut open = vec![(0, last)];
    while let Some((from, to)) = open.pop() {
        let ([ax, ay], [bx, by]) = (points[from], points[to]);
        let length = (bx - ax).hypot(by - ay).max(1e-9);
        let off = |p: &[f64; 2]| ((p[0] - ax) * (by - ay) - (p[1] - ay) * (bx - ax)).abs() / length;
        let far = (from + 1..to)
            .map(|k| (off(&points[k]), k))
            .max_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((distance, k)) = far.filter(|f| f.0 > FINE) {
            debug_assert!(distance > FINE);
            keep[k] = true;
            open.extend([(from, k), (k, to)]);
        }
    }
    points
        .into_iter()
        .zip(keep)
        .filter_map(|(p, keep)| keep.then_some(p))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_nobody_sees_is_left_out_and_a_spike_is_not() {
        let mut line: Vec<[f64; 2]> = (0..=100).map(|k| [f64::from(k), 0.1 * f64::from(k % 2)]).collect();
        assert_eq!(thinned(line.clone()).len(), 2);
        line[40][1] = 30.0;
        let kept = thinned(line);
        assert!(kept.contains(&[40.0, 30.0]) && kept.len() < 8, "{kept:?}");
    }

    #[test]
    fn a_chart_without_points_is_drawn() {
        let chart = Chart {
            label: "nothing",
            axes: ["a", "b"],
            series: vec![Series {
                name: "none",
                class: "s1",
                points: vec![[f64::NAN, 1.0]],
                marked: true,
            }],
            range: None,
        };
        let text = chart.html().into_string();
        assert!(
            text.contains("polyline") && !text.contains("NaN") && !text.contains("inf"),
            "{text}"
        );
    }
}
