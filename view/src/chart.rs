//! A scatter chart on two logarithmic axes: what costs what.

use crate::canvas::{Align, Canvas, ImageError};
use crate::palette::Rgb;

const BACKGROUND: Rgb = [255, 255, 255];
const GRID: Rgb = [224, 227, 232];
const LINE: Rgb = [120, 126, 138];
const TEXT: Rgb = [32, 36, 44];

/// Okabe's and Ito's colours: told apart by readers who confuse red and green.
pub const COLOURS: [Rgb; 7] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [230, 159, 0],
    [86, 180, 233],
    [64, 64, 64],
];

/// A point of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Where; both positive.
    pub at: [f64; 2],
    /// Which series it belongs to.
    pub series: usize,
    /// What stands beside it.
    pub label: String,
}

/// What a chart shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Chart {
    /// Above it.
    pub title: String,
    /// Along the axes.
    pub axes: [String; 2],
    /// Names of the series.
    pub series: Vec<String>,
    /// The points; those that are not positive and finite are left out.
    pub marks: Vec<Mark>,
    /// Points that a line joins.
    pub front: Vec<[f64; 2]>,
}

impl Chart {
    /// Draws it.
    ///
    /// # Errors
    /// [`ImageError::Size`] for a size that no image may have.
    pub fn draw(&self, width: u32, height: u32) -> Result<Canvas, ImageError> {
        let mut canvas = Canvas::new(width, height, BACKGROUND)?;
        let text = (width as f32 / 60.0).clamp(10.0, 28.0);
        let good = |p: &[f64; 2]| p.iter().all(|v| v.is_finite() && *v > 0.0);
        let shown: Vec<&Mark> = self.marks.iter().filter(|m| good(&m.at)).collect();
        let axis = |k: usize| Axis::over(shown.iter().map(|m| m.at[k]));
        let (across, up) = (axis(0), axis(1));
        let (left, right) = (5.5 * text, width as f32 - 2.0 * text);
        let (top, bottom) = (3.2 * text, height as f32 - 4.2 * text);
        let place = |p: [f64; 2]| {
            [
                left + across.part(p[0]) * (right - left),
                bottom - up.part(p[1]) * (bottom - top),
            ]
        };
        for tick in across.ticks() {
            let [x, _] = place([tick, up.low]);
            canvas.stroke(&[[x, top], [x, bottom]], false, 1.0, GRID);
            canvas.text(x, bottom + 1.3 * text, 0.9 * text, Align::Middle, TEXT, &number(tick));
        }
        for tick in up.ticks() {
            let [_, y] = place([across.low, tick]);
            canvas.stroke(&[[left, y], [right, y]], false, 1.0, GRID);
            let at = [left - 0.5 * text, y + 0.3 * text];
            canvas.text(at[0], at[1], 0.9 * text, Align::End, TEXT, &number(tick));
        }
        let frame = [[left, top], [right, top], [right, bottom], [left, bottom]];
        canvas.stroke(&frame, true, 1.5, LINE);
        canvas.text(left, 1.5 * text, 1.1 * text, Align::Start, TEXT, &self.title);
        canvas.text(
            0.5 * (left + right),
            height as f32 - 1.2 * text,
            text,
            Align::Middle,
            TEXT,
            &self.axes[0],
        );
        canvas.text(0.4 * text, 2.8 * text, 0.9 * text, Align::Start, TEXT, &self.axes[1]);
        let front: Vec<[f32; 2]> = self.front.iter().filter(|p| good(p)).map(|p| place(*p)).collect();
        if front.len() > 1 {
            canvas.stroke(&front, false, 0.15 * text, LINE);
        }
        let mut taken: Vec<[f32; 4]> = Vec::new();
        for m in &shown {
            let ([x, y], colour) = (place(m.at), COLOURS[m.series % COLOURS.len()]);
            canvas.disc(x, y, 0.4 * text, colour);
            taken.push([x - 0.4 * text, y - 0.4 * text, x + 0.4 * text, y + 0.4 * text]);
        }
        for m in &shown {
            let ([x, y], colour) = (place(m.at), COLOURS[m.series % COLOURS.len()]);
            let (size, wide) = (0.8 * text, canvas.text_width(0.8 * text, &m.label));
            // Beside the point, on a side where nothing is yet; without such a side the legend and the table must do.
            let sides = [
                [x + 0.6 * text, y + 0.3 * size],
                [x - 0.6 * text - wide, y + 0.3 * size],
                [x - 0.5 * wide, y - 0.7 * text],
                [x - 0.5 * wide, y + 1.3 * text],
            ];
            let area = |[x, y]: [f32; 2]| [x, y - 0.8 * size, x + wide, y + 0.2 * size];
            let free = |a: [f32; 4]| {
                let inside = a[0] > left && a[2] < right && a[1] > top && a[3] < bottom;
                inside
                    && !taken
                        .iter()
                        .any(|t| a[0] < t[2] && t[0] < a[2] && a[1] < t[3] && t[1] < a[3])
            };
            if let Some(at) = sides.into_iter().find(|s| free(area(*s))) {
                canvas.text(at[0], at[1], size, Align::Start, colour, &m.label);
                taken.push(area(at));
            }
        }
        let mut x = right;
        for (k, name) in self.series.iter().enumerate().rev() {
            x -= canvas.text_width(0.9 * text, name);
            canvas.text(x, 2.7 * text, 0.9 * text, Align::Start, TEXT, name);
            x -= 0.7 * text;
            canvas.disc(x, 2.4 * text, 0.4 * text, COLOURS[k % COLOURS.len()]);
            x -= 1.2 * text;
        }
        Ok(canvas)
    }
}

/// A logarithmic axis.
struct Axis {
    low: f64,
    high: f64,
}

impl Axis {
    fn over(values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = values.fold((f64::INFINITY, 0.0_f64), |(l, h), v| (l.min(v), h.max(v)));
        if high > 0.0 {
            Self {
                low: low / 1.3,
                high: 1.3 * high,
            }
        } else {
            Self { low: 0.1, high: 10.0 }
        }
    }

    /// 0 at the low end, 1 at the high one.
    fn part(&self, value: f64) -> f32 {
        ((value / self.low).ln() / (self.high / self.low).ln()) as f32
    }

    /// 1, 2 and 5 times powers of ten; powers of ten alone where those are many.
    fn ticks(&self) -> Vec<f64> {
        let (low, high) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
        let steps: &[f64] = if high - low > 4 { &[1.0] } else { &[1.0, 2.0, 5.0] };
        let all = (low..=high).flat_map(|p| steps.iter().map(move |s| s * 10.0_f64.powi(p)));
        all.filter(|t| (self.low..=self.high).contains(t)).collect()
    }
}

fn number(value: f64) -> String {
    if (1e-3..1e6).contains(&value) {
        format!("{}", (value * 1e6).round() / 1e6)
    } else {
        format!("{value:.0e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart() -> Chart {
        let mark = |x: f64, y: f64, series| Mark {
            at: [x, y],
            series,
            label: format!("{x}"),
        };
        Chart {
            series: vec!["a".into(), "b".into()],
            marks: vec![
                mark(1.0, 100.0, 0),
                mark(100.0, 1.0, 1),
                mark(f64::NAN, 1.0, 0),
                mark(0.0, 1.0, 0),
            ],
            ..Chart::default()
        }
    }

    #[test]
    fn points_lie_where_their_logarithms_say_and_bad_ones_nowhere() {
        let canvas = chart().draw(600, 400).unwrap();
        let of = |k: usize| {
            let mut sum = [0.0, 0.0, 0.0];
            // Below the legend.
            for y in 40..400 {
                for x in 0..600 {
                    if canvas.pixel(x, y) == Some(COLOURS[k]) {
                        sum = [sum[0] + f64::from(x), sum[1] + f64::from(y), sum[2] + 1.0];
                    }
                }
            }
            assert!(sum[2] > 20.0);
            [sum[0] / sum[2], sum[1] / sum[2]]
        };
        let (low, high) = (of(0), of(1));
        assert!(low[0] < 150.0 && high[0] > 450.0, "{low:?} {high:?}");
        assert!(low[1] < 100.0 && high[1] > 280.0, "{low:?} {high:?}");
    }

    #[test]
    fn an_empty_chart_and_the_ticks_of_an_axis() {
        assert!(Chart::default().draw(400, 300).is_ok());
        assert!(Chart::default().draw(10, 300).is_err());
        let ticks = Axis::over([1.0, 80.0].into_iter()).ticks();
        assert_eq!(ticks, [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]);
        let ticks = Axis::over([1.0, 1e7].into_iter()).ticks();
        assert_eq!(ticks.len(), 8, "{ticks:?}");
    }
}
