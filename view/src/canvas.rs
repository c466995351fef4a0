//! A small drawing board: filled and stroked shapes, text, shaded areas, and PNG out.
//!
//! Positions are pixels from the upper left corner, y down. Everything is drawn in software without vector
//! instructions, so the same calls give the same bytes on every machine.

use std::io::Write;
use std::path::Path as FilePath;

use tiny_skia::{
    Color, FillRule, FilterQuality, LineCap, LineJoin, Paint, Path, PathBuilder, Pattern, Pixmap, PremultipliedColorU8,
    Rect, Shader, SpreadMode, Stroke, Transform,
};

use crate::labels::Area;
use crate::palette::Rgb;
use crate::picture::PictureError;
use crate::text::Font;

/// Least and greatest side of an image, px.
pub const SIDE_PX: std::ops::RangeInclusive<u32> = 64..=8192;

/// Why an image could not be drawn or written.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// A size outside [`SIDE_PX`].
    #[error("an image of {width} x {height} pixels cannot be drawn; each side must be {} to {}", SIDE_PX.start(), SIDE_PX.end())]
    Size {
        /// Width asked for, px.
        width: u32,
        /// Height asked for, px.
        height: u32,
    },
    /// The picture's parts do not fit together.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// The font inside the program cannot be read.
    #[error("the font inside this program is damaged; build it again")]
    Font,
    /// The file cannot be written.
    #[error("cannot write {path}: {source}; check that the folder exists and may be written to")]
    Write {
        /// Where it was to go.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The image cannot be encoded.
    #[error("cannot encode the image: {0}")]
    Encode(#[from] png::EncodingError),
}

/// Which point of a line of text is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// Its start.
    Start,
    /// Its middle.
    Middle,
    /// Its end.
    End,
}

/// A colour with an opacity of 0..1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ink(pub Rgb, pub f32);

impl From<Rgb> for Ink {
    fn from(colour: Rgb) -> Self {
        Self(colour, 1.0)
    }
}

/// An image that is being drawn.
pub struct Canvas {
    pixels: Pixmap,
    font: Font,
}

impl Canvas {
    /// An image in one colour.
    ///
    /// # Errors
    /// [`ImageError::Size`] if a side is not in [`SIDE_PX`].
    pub fn new(width: u32, height: u32, background: Rgb) -> Result<Self, ImageError> {
        let fits = SIDE_PX.contains(&width) && SIDE_PX.contains(&height);
        let pixels = fits.then(|| Pixmap::new(width, height)).flatten();
        let mut pixels = pixels.ok_or(ImageError::Size { width, height })?;
        pixels.fill(colour(background.into()));
        Ok(Self {
            pixels,
            font: Font::sans().ok_or(ImageError::Font)?,
        })
    }

    /// Width, px.
    pub fn width(&self) -> u32 {
        self.pixels.width()
    }

    /// Height, px.
    pub fn height(&self) -> u32 {
        self.pixels.height()
    }

    /// Four bytes (red, green, blue, opacity 255) per pixel, rows from the top.
    pub fn rgba(&self) -> &[u8] {
        self.pixels.data()
    }

    /// The colour of a pixel; none outside the image.
    pub fn pixel(&self, x: u32, y: u32) -> Option<Rgb> {
        let inside = x < self.width() && y < self.height();
        let pixel = inside.then(|| self.pixels.pixel(x, y)).flatten();
        pixel.map(|p| [p.red(), p.green(), p.blue()])
    }

    /// Fills a polygon.
    pub fn fill(&mut self, points: &[[f32; 2]], ink: impl Into<Ink>) {
        self.fill_path(polygon(points, true), ink.into());
    }

    /// Fills a rectangle with corners rounded to `radius`.
    pub fn fill_area(&mut self, area: Area, radius: f32, ink: impl Into<Ink>) {
        self.fill_path(rounded(area, radius), ink.into());
    }

    /// Fills a disc.
    pub fn disc(&mut self, x: f32, y: f32, radius: f32, ink: impl Into<Ink>) {
        self.fill_path(PathBuilder::from_circle(x, y, radius), ink.into());
    }

    /// Draws a circle.
    pub fn ring(&mut self, x: f32, y: f32, radius: f32, width: f32, ink: impl Into<Ink>) {
        self.stroke_path(PathBuilder::from_circle(x, y, radius), width, ink.into());
    }

    /// Draws lines from point to point, and back to the first if `closed`.
    pub fn stroke(&mut self, points: &[[f32; 2]], closed: bool, width: f32, ink: impl Into<Ink>) {
        self.stroke_path(polygon(points, closed), width, ink.into());
    }

    /// Draws a line of text on the baseline `y`, `size` px high from line to line.
    pub fn text(&mut self, x: f32, y: f32, size: f32, align: Align, ink: impl Into<Ink>, text: &str) {
        let width = self.font.width(text, size);
        let start = match align {
            Align::Start => x,
            Align::Middle => x - 0.5 * width,
            Align::End => x - width,
        };
        self.fill_path(self.font.outline(text, start, y, size), ink.into());
    }

    /// Width of a line of text, px.
    pub fn text_width(&self, size: f32, text: &str) -> f32 {
        self.font.width(text, size)
    }

    /// Fills a polygon with a colour per pixel: `shade` is given the pixel's centre.
    pub fn shade(&mut self, points: &[[f32; 2]], shade: impl Fn(f32, f32) -> Rgb) {
        let Some(path) = polygon(points, true) else { return };
        let bounds = path.bounds();
        let (left, top) = (bounds.left().floor(), bounds.top().floor());
        let side = |length: f32| (length.ceil() as u32 + 1).clamp(1, *SIDE_PX.end());
        let Some(mut tile) = Pixmap::new(side(bounds.right() - left), side(bounds.bottom() - top)) else {
            return;
        };
        let width = tile.width() as usize;
        for (k, pixel) in tile.pixels_mut().iter_mut().enumerate() {
            let (x, y) = ((k % width) as f32 + 0.5, (k / width) as f32 + 0.5);
            let [r, g, b] = shade(left + x, top + y);
            *pixel = PremultipliedColorU8::from_rgba(r, g, b, 255).unwrap_or(*pixel);
        }
        let place = Transform::from_translate(left, top);
        let pattern = Pattern::new(tile.as_ref(), SpreadMode::Pad, FilterQuality::Nearest, 1.0, place);
        let paint = Paint {
            shader: pattern,
            ..Paint::default()
        };
        self.pixels
            .fill_path(&path, &paint, FillRule::EvenOdd, Transform::identity(), None);
    }

    /// Writes the image as a PNG file. The same image gives the same bytes.
    ///
    /// # Errors
    /// [`ImageError::Encode`], which includes a writer that fails.
    pub fn encode_png(&self, out: impl Write) -> Result<(), ImageError> {
        let mut encoder = png::Encoder::new(out, self.width(), self.height());
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Balanced);
        let mut writer = encoder.write_header()?;
        let rgb: Vec<u8> = self
            .pixels
            .pixels()
            .iter()
            .flat_map(|p| [p.red(), p.green(), p.blue()])
            .collect();
        writer.write_image_data(&rgb)?;
        Ok(writer.finish()?)
    }

    /// Writes a PNG file, replacing what is there.
    ///
    /// # Errors
    /// [`ImageError::Write`] with the path, or [`ImageError::Encode`].
    pub fn write_png(&self, path: impl AsRef<FilePath>) -> Result<(), ImageError> {
        let path = path.as_ref();
        let mut bytes = Vec::new();
        self.encode_png(&mut bytes)?;
        crate::replace::replace(path, |file| file.write_all(&bytes)).map_err(|source| ImageError::Write {
            path: path.display().to_string(),
            source,
        })
    }

    fn fill_path(&mut self, path: Option<Path>, ink: Ink) {
        if let Some(path) = path {
            self.pixels
                .fill_path(&path, &paint(ink), FillRule::Winding, Transform::identity(), None);
        }
    }

    fn stroke_path(&mut self, path: Option<Path>, width: f32, ink: Ink) {
        let stroke = Stroke {
            width,
            line_cap: LineCap::Round,
            line_join: LineJoin::Round,
            ..Stroke::default()
        };
        if let Some(path) = path {
            self.pixels
                .stroke_path(&path, &paint(ink), &stroke, Transform::identity(), None);
        }
    }
}

fn colour(Ink([r, g, b], opacity): Ink) -> Color {
    let opacity = (opacity.clamp(0.0, 1.0) * 255.0).round() as u8;
    Color::from_rgba8(r, g, b, opacity)
}

fn paint(ink: Ink) -> Paint<'static> {
    Paint {
        shader: Shader::SolidColor(colour(ink)),
        anti_alias: true,
        ..Paint::default()
    }
}

fn polygon(points: &[[f32; 2]], closed: bool) -> Option<Path> {
    let mut builder = PathBuilder::new();
    for (k, p) in points.iter().enumerate() {
        if k == 0 {
            builder.move_to(p[0], p[1])
        } else {
            builder.line_to(p[0], p[1])
        }
    }
    if closed {
        builder.close();
    }
    builder.finish()
}

fn rounded(area: Area, radius: f32) -> Option<Path> {
    let rect = Rect::from_xywh(area.x, area.y, area.width, area.height)?;
    let r = radius.clamp(0.0, 0.5 * area.width.min(area.height));
    let mut b = PathBuilder::new();
    b.move_to(rect.left() + r, rect.top());
    b.line_to(rect.right() - r, rect.top());
    b.quad_to(rect.right(), rect.top(), rect.right(), rect.top() + r);
    b.line_to(rect.right(), rect.bottom() - r);
    b.quad_to(rect.right(), rect.bottom(), rect.right() - r, rect.bottom());
    b.line_to(rect.left() + r, rect.bottom());
    b.quad_to(rect.left(), rect.bottom(), rect.left(), rect.bottom() - r);
    b.line_to(rect.left(), rect.top() + r);
    b.quad_to(rect.left(), rect.top(), rect.left() + r, rect.top());
    b.close();
    b.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_land_where_they_are_put() {
        let mut canvas = Canvas::new(100, 80, [10, 20, 30]).unwrap();
        canvas.fill_area(
            Area {
                x: 10.0,
                y: 10.0,
                width: 20.0,
                height: 20.0,
            },
            3.0,
            [200, 0, 0],
        );
        canvas.disc(60.0, 40.0, 10.0, [0, 200, 0]);
        canvas.shade(&[[80.0, 0.0], [100.0, 0.0], [100.0, 80.0], [80.0, 80.0]], |x, y| {
            [x as u8, y as u8, 0]
        });
        assert_eq!(canvas.pixel(20, 20), Some([200, 0, 0]));
        assert_eq!(canvas.pixel(60, 40), Some([0, 200, 0]));
        assert_eq!(canvas.pixel(90, 70), Some([90, 70, 0]));
        assert_eq!(canvas.pixel(50, 5), Some([10, 20, 30]));
        assert_eq!(canvas.pixel(100, 0), None);
    }

    #[test]
    fn a_png_is_read_back_as_drawn() {
        let mut canvas = Canvas::new(64, 64, [1, 2, 3]).unwrap();
        canvas.text(32.0, 40.0, 16.0, Align::Middle, [255; 3], "20 %");
        let mut bytes = Vec::new();
        canvas.encode_png(&mut bytes).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        let rgb: Vec<u8> = canvas.rgba().chunks(4).flat_map(|p| p[..3].to_vec()).collect();
        assert_eq!(pixels, rgb);
    }

    #[test]
    fn impossible_sizes_and_paths_are_errors() {
        assert!(matches!(Canvas::new(10, 100, [0; 3]), Err(ImageError::Size { .. })));
        let canvas = Canvas::new(64, 64, [0; 3]).unwrap();
        let error = canvas.write_png("no/such/folder/x.png").unwrap_err();
        assert!(error.to_string().contains("no/such/folder/x.png"));
    }
}
