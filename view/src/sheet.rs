//! The parts of an image of a sheet: where things are, the coloured sheet with its electrodes, touches, the colour bar and
//! the scale. For pictures of pressure and for any other map over the sheet.

use crate::canvas::{Align, Canvas, ImageError, Ink};
use crate::labels::{self, Area, Ring};
use crate::palette::{self, Palette, Rgb};
use crate::picture::{Bounds, PictureError};
use inverse::touches::touch::Touch;

/// Behind everything.
pub const BACKGROUND: Rgb = [13, 15, 20];
/// Text that matters.
pub const TEXT: Rgb = [228, 232, 240];
/// Text that does not have to be noticed.
pub const FAINT: Rgb = [139, 147, 163];
const RIM: Rgb = [92, 99, 115];
/// The electrodes.
pub const METAL: Rgb = [214, 160, 104];
/// Broken ones.
pub const BROKEN: Rgb = [255, 82, 82];

/// Least width of an image, px: below it the labels cannot be read.
pub const LEAST_PX: u32 = 320;

/// Where things are on the image.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// Size of the text, px.
    pub text: f32,
    /// Height of the image, px.
    pub height: u32,
    /// Room for the sheet with its numbers.
    pub map: Area,
    scale: f64,
    middle_mm: [f64; 2],
    bar: Area,
}

impl Layout {
    /// The layout of an image `width` px wide for a sheet with this outline.
    ///
    /// # Errors
    /// [`ImageError::Size`] and [`PictureError::Outline`].
    pub fn new(outline_mm: &[[f64; 2]], width: u32) -> Result<Self, ImageError> {
        let bounds = Bounds::of(outline_mm).ok_or(PictureError::Outline {
            points: outline_mm.len(),
        })?;
        if width < LEAST_PX {
            return Err(ImageError::Size { width, height: width });
        }
        let w = width as f32;
        let text = (w / 55.0).clamp(11.0, 40.0);
        // Around the sheet: room for the electrodes and their numbers.
        let (edge, head, foot, side) = (2.4 * text, 3.2 * text, 2.6 * text, 6.4 * text);
        let room = f64::from(w - side - 2.0 * edge - text);
        // A long narrow sheet must not give an endless image.
        let scale = (room / bounds.width()).min(1.5 * room / bounds.height());
        let map_height = (bounds.height() * scale) as f32 + 2.0 * edge;
        let map = Area {
            x: text,
            y: head,
            width: w - side - text,
            height: map_height,
        };
        let bar_height = (map_height - 5.0 * text).max(4.0 * text).min(map_height);
        let bar_y = head + 0.5 * (map_height - bar_height);
        let bar = Area {
            x: w - side + 0.8 * text,
            y: bar_y,
            width: 1.3 * text,
            height: bar_height,
        };
        let middle_mm = [0.5 * (bounds.left + bounds.right), 0.5 * (bounds.bottom + bounds.top)];
        Ok(Self {
            text,
            height: (head + map_height + foot).ceil() as u32,
            map,
            scale,
            middle_mm,
            bar,
        })
    }

    /// Pixels per mm.
    pub fn px_per_mm(&self) -> f64 {
        self.scale
    }

    /// The pixel position of a point of the sheet.
    pub fn to_px(&self, [x, y]: [f64; 2]) -> [f32; 2] {
        let (cx, cy) = (self.map.x + 0.5 * self.map.width, self.map.y + 0.5 * self.map.height);
        [
            cx + ((x - self.middle_mm[0]) * self.scale) as f32,
            cy - ((y - self.middle_mm[1]) * self.scale) as f32,
        ]
    }

    /// The point of the sheet at a pixel position, mm.
    pub fn to_mm(&self, [x, y]: [f32; 2]) -> [f64; 2] {
        let (cx, cy) = (self.map.x + 0.5 * self.map.width, self.map.y + 0.5 * self.map.height);
        [
            self.middle_mm[0] + f64::from(x - cx) / self.scale,
            self.middle_mm[1] - f64::from(y - cy) / self.scale,
        ]
    }
}

/// Draws the sheet: colours of `palette` at the value 0..1 that `value` gives for a point in mm, the rim, and the numbered
/// electrodes.
pub fn draw_sheet(
    canvas: &mut Canvas,
    layout: &Layout,
    outline_mm: &[[f64; 2]],
    electrodes_mm: &[[f64; 2]],
    value: impl Fn([f64; 2]) -> f32,
    palette: Palette,
) {
    let table = palette.table();
    let outline: Vec<[f32; 2]> = outline_mm.iter().map(|&p| layout.to_px(p)).collect();
    canvas.shade(&outline, |x, y| table[palette::index(value(layout.to_mm([x, y])))]);
    let line = layout.text / 9.0;
    canvas.stroke(&outline, true, line, RIM);
    let all = |_: &usize| true;
    draw_electrodes(canvas, layout, outline_mm, electrodes_mm, (all, METAL, FAINT));
}

/// Draws the electrodes of this list (from 0) over those of [`draw_sheet`], as broken ones.
pub fn draw_faulty(
    canvas: &mut Canvas,
    layout: &Layout,
    outline_mm: &[[f64; 2]],
    electrodes_mm: &[[f64; 2]],
    faulty: &[usize],
) {
    let those = |k: &usize| faulty.contains(k);
    draw_electrodes(canvas, layout, outline_mm, electrodes_mm, (those, BROKEN, BROKEN));
}

/// Draws some of the electrodes in a colour, their numbers in another.
fn draw_electrodes(
    canvas: &mut Canvas,
    layout: &Layout,
    outline_mm: &[[f64; 2]],
    electrodes_mm: &[[f64; 2]],
    (which, colour, ink): (impl Fn(&usize) -> bool, Rgb, Rgb),
) {
    let line = layout.text / 9.0;
    // Numbers shrink where electrodes are close together.
    let closest = spacing_mm(electrodes_mm) * layout.scale;
    let size = (0.9 * layout.text).min(0.55 * closest as f32).max(7.0);
    for (k, &centre) in electrodes_mm.iter().enumerate().filter(|(k, _)| which(k)) {
        let ([nx, ny], [x, y]) = (outward(outline_mm, centre), layout.to_px(centre));
        let (nx, ny) = (nx as f32, -ny as f32);
        let half = (0.28 * closest as f32).clamp(2.0, 0.75 * layout.text);
        if colour == BROKEN {
            // A cross as well: not every eye tells the colours apart.
            let arm = 0.45 * layout.text;
            for way in [arm, -arm] {
                canvas.stroke(&[[x - arm, y - way], [x + arm, y + way]], false, 1.5 * line, colour);
            }
        }
        canvas.stroke(
            &[[x - ny * half, y + nx * half], [x + ny * half, y - nx * half]],
            false,
            2.6 * line,
            colour,
        );
        let (tx, ty) = (x + nx * 1.3 * layout.text, y + ny * 1.3 * layout.text + 0.36 * size);
        canvas.text(tx, ty, size, Align::Middle, ink, &format!("{}", k + 1));
    }
}

/// Where the electrodes are with their numbers, for labels to keep off.
pub fn electrode_marks(layout: &Layout, outline_mm: &[[f64; 2]], electrodes_mm: &[[f64; 2]]) -> Vec<Area> {
    let off = 0.65 * layout.text;
    let place = |&centre: &[f64; 2]| {
        let ([nx, ny], [x, y]) = (outward(outline_mm, centre), layout.to_px(centre));
        labels::square(x + off * nx as f32, y - off * ny as f32, 1.2 * layout.text)
    };
    electrodes_mm.iter().map(place).collect()
}

/// Draws a ring and a label for every touch; earlier touches choose the place of their label first. The labels keep off
/// the `marks` where they can.
pub fn draw_touches(canvas: &mut Canvas, layout: &Layout, touches: &[Touch], marks: &[Area]) {
    let size = 0.92 * layout.text;
    let texts: Vec<String> = touches.iter().map(touch_label).collect();
    let ring = |(touch, text): (&Touch, &String)| {
        let [x, y] = layout.to_px([touch.x_mm, touch.y_mm]);
        let radius = (labels::ring_radius_mm(touch) * layout.scale) as f32;
        Ring {
            x,
            y,
            radius,
            width: canvas.text_width(size, text) + 1.1 * size,
            height: 1.75 * size,
        }
    };
    let rings: Vec<Ring> = touches.iter().zip(&texts).map(ring).collect();
    let places = labels::place(&rings, layout.map, marks);
    let line = layout.text / 8.0;
    for (ring, place) in rings.iter().zip(&places) {
        leader(canvas, ring, place, 0.7 * line);
        canvas.ring(ring.x, ring.y, ring.radius, 2.4 * line, Ink([0; 3], 0.55));
        canvas.ring(ring.x, ring.y, ring.radius, line, [255; 3]);
    }
    for (place, text) in places.iter().zip(&texts) {
        canvas.fill_area(*place, 0.45 * size, Ink([10, 12, 16], 0.82));
        canvas.text(
            place.x + 0.55 * size,
            place.y + 1.22 * size,
            size,
            Align::Start,
            [255; 3],
            text,
        );
    }
}

/// The label of a touch: "1  12.3, −40.1 mm  +20 %", without the number if it has none, and with its force if that is known.
pub fn touch_label(touch: &Touch) -> String {
    let id = touch.id.map(|id| format!("{id}  ")).unwrap_or_default();
    format!("{id}{}  {}", labels::place_text(touch), labels::strength_text(touch))
}

/// Draws the colour bar from `low` to `high` under a short title, its ticks written by `text`.
pub fn draw_bar(
    canvas: &mut Canvas,
    layout: &Layout,
    palette: Palette,
    title: &str,
    [low, high]: [f64; 2],
    text: impl Fn(f64) -> String,
) {
    let (bar, size, table) = (layout.bar, 0.85 * layout.text, palette.table());
    let (right, bottom) = (bar.x + bar.width, bar.y + bar.height);
    let corners = [[bar.x, bar.y], [right, bar.y], [right, bottom], [bar.x, bottom]];
    canvas.shade(&corners, |_, y| table[palette::index((bottom - y) / bar.height)]);
    canvas.stroke(&corners, true, layout.text / 14.0, RIM);
    canvas.text(
        bar.x + 0.5 * bar.width,
        bar.y - 0.8 * size,
        size,
        Align::Middle,
        FAINT,
        title,
    );
    for tick in ticks(low, high, 5) {
        let y = bottom - ((tick - low) / (high - low)) as f32 * bar.height;
        canvas.stroke(
            &[[right, y], [right + 0.35 * size, y]],
            false,
            layout.text / 14.0,
            FAINT,
        );
        canvas.text(
            right + 0.65 * size,
            y + 0.36 * size,
            size,
            Align::Start,
            TEXT,
            &text(tick),
        );
    }
}

/// Round values from `low` to `high`, about `count` of them, in steps of 1, 2 or 5 times a power of ten.
pub fn ticks(low: f64, high: f64, count: usize) -> Vec<f64> {
    let span = high - low;
    if !span.is_finite() || span <= 0.0 {
        return Vec::new();
    }
    let rough = span / count.max(1) as f64;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|m| m * power)
        .into_iter()
        .find(|s| *s >= 0.999 * rough)
        .unwrap_or(rough);
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).map(|k| k as f64 * step).collect()
}

/// The bar that says how long a round number of mm is.
pub fn draw_scale(canvas: &mut Canvas, layout: &Layout) {
    let mm = round_below(f64::from(layout.map.width) / layout.scale / 4.0);
    let (size, length) = (0.85 * layout.text, (mm * layout.scale) as f32);
    let (x, y) = (layout.map.x + 0.6 * size, layout.height as f32 - 0.9 * layout.text);
    for (a, b) in [
        ([x, y], [x + length, y]),
        ([x, y - 4.0], [x, y + 4.0]),
        ([x + length, y - 4.0], [x + length, y + 4.0]),
    ] {
        canvas.stroke(&[a, b], false, layout.text / 10.0, FAINT);
    }
    canvas.text(
        x + length + 0.7 * size,
        y + 0.36 * size,
        size,
        Align::Start,
        TEXT,
        &format!("{mm} mm"),
    );
}

/// The greatest of 1, 2 and 5 times a power of ten that is not above `limit`.
pub(super) fn round_below(limit: f64) -> f64 {
    let power = 10f64.powf(limit.log10().floor());
    [5.0, 2.0]
        .map(|m| m * power)
        .into_iter()
        .find(|v| *v <= limit)
        .unwrap_or(power)
}

/// A line from a ring to its label where they are apart.
fn leader(canvas: &mut Canvas, ring: &Ring, place: &Area, width: f32) {
    let to = [
        ring.x.clamp(place.x, place.x + place.width),
        ring.y.clamp(place.y, place.y + place.height),
    ];
    let (dx, dy) = (to[0] - ring.x, to[1] - ring.y);
    let length = dx.hypot(dy);
    if length > ring.radius {
        let from = [ring.x + dx * ring.radius / length, ring.y + dy * ring.radius / length];
        canvas.stroke(&[from, to], false, 3.0 * width, Ink([0; 3], 0.5));
        canvas.stroke(&[from, to], false, width, Ink([255; 3], 0.8));
    }
}

/// Least distance between two electrodes that follow each other, mm; a large one if there are none.
fn spacing_mm(electrodes_mm: &[[f64; 2]]) -> f64 {
    let next = electrodes_mm.iter().cycle().skip(1);
    let apart = electrodes_mm
        .iter()
        .zip(next)
        .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
    apart.filter(|d| *d > 0.0).fold(1e3, f64::min)
}

/// Unit vector out of the polygon, square to the side that is nearest to `p`.
fn outward(polygon: &[[f64; 2]], p: [f64; 2]) -> [f64; 2] {
    let sides = || polygon.iter().zip(polygon.iter().cycle().skip(1));
    let twice_area: f64 = sides().map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum();
    let distance = |(a, b): &(&[f64; 2], &[f64; 2])| {
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let t = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / (dx * dx + dy * dy).max(1e-12);
        let t = t.clamp(0.0, 1.0);
        (a[0] + t * dx - p[0]).hypot(a[1] + t * dy - p[1])
    };
    let nearest = sides().min_by(|s, t| distance(s).total_cmp(&distance(t)));
    let Some((a, b)) = nearest else { return [0.0, 1.0] };
    let length = (b[0] - a[0]).hypot(b[1] - a[1]).max(1e-12) * twice_area.signum();
    [(b[1] - a[1]) / length, (a[0] - b[0]) / length]
}
