//! Maps over the sheet as SVG. The field is a small image inside, everything else are lines in the colours of the page.

use crate::paper::PaperError;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use inverse::reference::imager::Imager;
use maud::{Markup, html};
use view::canvas::Canvas;
use view::field::Field;
use view::palette::{Palette, Rgb, index};
use view::picture::Bounds;
use view::surface::grid_of;

/// A map.
#[derive(Clone, Debug, Default)]
pub struct Map {
    image: String,
    scale: [f64; 2],
    /// Rectangle of the image: left, bottom, width, height, mm.
    area: [f64; 4],
    outline_mm: Vec<[f64; 2]>,
    electrodes_mm: Vec<[f64; 2]>,
    active: Vec<usize>,
    truth_mm: Vec<[f64; 2]>,
    found_mm: Vec<[f64; 2]>,
    hexagons: Vec<([f64; 2], f64, Rgb)>,
    fingers: bool,
}

/// Side of the image of a field, px.
const IMAGE_PX: u32 = 196;

impl Map {
    /// The smoothed picture of cells on a scale of its own: from 0, or to both sides where a value is negative.
    pub(super) fn of_cells(imager: &Imager, x: &[f64]) -> Result<Self, PaperError> {
        let values: Vec<f32> = x.iter().map(|v| *v as f32).collect();
        let field = Field::new(grid_of(imager)?.as_ref(), &values);
        let at = |p: [f64; 2]| f64::from(field.at(p[0], p[1]));
        let shown = (0..imager.grid.len()).map(|k| at(imager.grid.centre(k)));
        let [low, high] = shown.fold([0.0_f64; 2], |r, v| [r[0].min(v), r[1].max(v)]);
        let falls = x.iter().any(|v| *v < 0.0);
        let full = high.max(-low);
        let (table, low, high) = if falls {
            (Palette::Diverging.table(), -full, full)
        } else {
            (Palette::Viridis.table(), 0.0, full)
        };
        let wide = (high - low).max(f64::MIN_POSITIVE);
        let mut map = Self::of_colours(&imager.outline_mm, &imager.electrodes_mm, |p| {
            table[index(((at(p) - low) / wide) as f32)]
        })?;
        map.scale = [low, high];
        Ok(map)
    }

    /// Values of the first and the last colour.
    pub(super) fn scale(&self) -> [f64; 2] {
        self.scale
    }

    /// Any colours at the points (mm) of a sheet.
    pub(super) fn of_colours(
        outline_mm: &[[f64; 2]],
        electrodes_mm: &[[f64; 2]],
        colour: impl Fn([f64; 2]) -> Rgb,
    ) -> Result<Self, PaperError> {
        let mut map = Self::empty(outline_mm, electrodes_mm);
        let [left, bottom, width, height] = map.area;
        let side = IMAGE_PX as f32;
        let mut canvas = Canvas::new(IMAGE_PX, IMAGE_PX, [255; 3])?;
        canvas.shade(&[[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]], |x, y| {
            let part = |v: f32| f64::from(v / side);
            colour([left + part(x) * width, bottom + (1.0 - part(y)) * height])
        });
        let mut bytes = Vec::new();
        canvas.encode_png(&mut bytes)?;
        map.image = format!("data:image/png;base64,{}", STANDARD.encode(bytes));
        Ok(map)
    }

    /// A sheet with nothing on it.
    pub(super) fn empty(outline_mm: &[[f64; 2]], electrodes_mm: &[[f64; 2]]) -> Self {
        let area = Bounds::of(outline_mm).map_or([-1.0, -1.0, 2.0, 2.0], |b| [b.left, b.bottom, b.width(), b.height()]);
        Self {
            area,
            outline_mm: outline_mm.to_vec(),
            electrodes_mm: electrodes_mm.to_vec(),
            ..Self::default()
        }
    }

    /// Rings at the places of the presses.
    pub(super) fn with_truth(mut self, truth_mm: &[[f64; 2]]) -> Self {
        self.truth_mm = truth_mm.to_vec();
        self
    }

    /// Crosses at the touches found.
    pub(super) fn with_found(mut self, found_mm: &[[f64; 2]]) -> Self {
        self.found_mm = found_mm.to_vec();
        self
    }

    /// Fingers instead of the rings.
    pub(super) fn with_fingers(mut self) -> Self {
        self.fingers = true;
        self
    }

    /// Electrodes that drive or sense, counted from 0.
    pub(super) fn with_active(mut self, active: &[usize]) -> Self {
        self.active = active.to_vec();
        self
    }

    /// Hexagons: middle and distance to the neighbours (mm), colour.
    pub(super) fn with_hexagons(mut self, hexagons: Vec<([f64; 2], f64, Rgb)>) -> Self {
        self.hexagons = hexagons;
        self
    }

    /// The map as SVG. `id` is unique in the document, `label` is the text for readers who cannot see the map.
    pub(super) fn svg(&self, id: &str, label: &str) -> Markup {
        let [left, bottom, width, height] = self.area;
        let margin = 0.1 * width.max(height);
        let frame = [
            left - margin,
            -(bottom + height) - margin,
            width + 2.0 * margin,
            height + 2.0 * margin,
        ];
        let list = |v: &[f64]| v.iter().map(|n| format!("{n:.1}")).collect::<Vec<_>>().join(" ");
        let path = |points: &[[f64; 2]]| {
            let pairs: Vec<String> = points.iter().map(|p| format!("{:.1},{:.1}", p[0], -p[1])).collect();
            pairs.join(" ")
        };
        let clip = format!("clip-{id}");
        html! {
            svg class="map" viewBox=(list(&frame)) role="img" aria-label=(label) {
                @if !self.image.is_empty() {
                    clipPath id=(clip) { polygon points=(path(&self.outline_mm)) {} }
                    image href=(self.image) x=(left) y=(-(bottom + height)) width=(width) height=(height)
                        clip-path=(format!("url(#{clip})")) preserveAspectRatio="none" {}
                }
                @for (at, spacing, [r, g, b]) in &self.hexagons {
                    polygon points=(path(&hexagon(*at, *spacing))) fill=(format!("rgb({r},{g},{b})")) {}
                }
                polygon class="rim" points=(path(&self.outline_mm)) {}
                @for (k, [x, y]) in self.electrodes_mm.iter().enumerate() {
                    circle class=(if self.active.contains(&k) { "electrode active" } else { "electrode" })
                        cx=(format!("{x:.1}")) cy=(format!("{:.1}", -y))
                        r=(format!("{:.1}", if self.active.contains(&k) { 0.024 * width } else { 0.014 * width })) {}
                    @if self.active.contains(&k) {
                        text class="number" x=(format!("{:.1}", 1.115 * x)) y=(format!("{:.1}", -1.1 * y + 0.02 * width)) { (k + 1) }
                    }
                }
                @for [x, y] in &self.truth_mm {
                    @for class in if self.fingers { &["finger"][..] } else { &["truth-halo", "truth"][..] } {
                        circle class=(class) cx=(format!("{x:.1}")) cy=(format!("{:.1}", -y)) r=(format!("{:.1}", 0.0641 * width)) {}
                    }
                }
                @for [x, y] in &self.found_mm {
                    @for class in ["found-halo", "found"] {
                        path class=(class) d=(format!("M{:.1} {:.1}h8m-4 -4v8", x - 4.0, -y)) {}
                    }
                }
            }
        }
    }
}

/// Corners of a hexagon of a honeycomb, a little apart from its neighbours.
fn hexagon(at: [f64; 2], spacing: f64) -> Vec<[f64; 2]> {
    let radius = 0.97 * spacing / 3.0_f64.sqrt();
    (0..6)
        .map(|k| (f64::from(k) + 0.5) * std::f64::consts::PI / 3.0)
        .map(|a| [at[0] + radius * a.cos(), at[1] + radius * a.sin()])
        .collect()
}

/// A bar with the colours of a palette and the values of its ends.
pub(super) fn bar(palette: Palette, low: &str, title: &str, high: &str) -> Markup {
    let table = palette.table();
    let stops: Vec<String> = (0..=10)
        .map(|k| table[k * 255 / 10])
        .map(|[r, g, b]| format!("rgb({r},{g},{b})"))
        .collect();
    html! {
        div.bar {
            span { (low) }
            span.colours style=(format!("background:linear-gradient(to right,{})", stops.join(","))) {}
            span { (high) }
            span.title { (title) }
        }
    }
}
