//! A picture as an image: the sheet with its field, electrodes and touches, a colour bar and a scale.

use std::path::Path;

use crate::SCALE_FLOOR;
use crate::canvas::{Align, Canvas, ImageError};
use crate::field::Field;
use crate::palette::{Palette, Rgb};
use crate::picture::{Grid, Picture};
use crate::sheet::{self, BACKGROUND, FAINT, Layout, TEXT};

const WARN: Rgb = [255, 196, 107];

/// How to draw a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageOptions {
    /// Width of the image, px; the height follows from the sheet's shape.
    pub width_px: u32,
    /// Colours of the field.
    pub palette: Palette,
    /// Rise shown in the last colour; none for the greatest rise of the picture and its touches.
    pub full_scale: Option<f32>,
    /// Least full scale where it is taken from the picture.
    pub floor: f32,
}

impl Default for ImageOptions {
    /// 1000 px wide, inferno, scale from the picture.
    fn default() -> Self {
        Self {
            width_px: 1000,
            palette: Palette::Inferno,
            full_scale: None,
            floor: SCALE_FLOOR,
        }
    }
}

/// Draws a picture `size_px` wide in the usual way.
///
/// # Errors
/// As [`render_with`].
pub fn render(picture: &Picture, size_px: u32) -> Result<Canvas, ImageError> {
    render_with(
        picture,
        &ImageOptions {
            width_px: size_px,
            ..ImageOptions::default()
        },
    )
}

/// Draws a picture and writes it as a PNG file, 1000 px wide.
///
/// # Errors
/// As [`render_with`], and [`ImageError::Write`] if the file cannot be written.
pub fn write_png(picture: &Picture, path: impl AsRef<Path>) -> Result<(), ImageError> {
    render_with(picture, &ImageOptions::default())?.write_png(path)
}

/// Draws a picture.
///
/// # Errors
/// [`ImageError::Size`] below 320 px or above [`crate::canvas::SIDE_PX`], [`ImageError::Picture`] if its parts do not fit.
pub fn render_with(picture: &Picture, options: &ImageOptions) -> Result<Canvas, ImageError> {
    picture.check()?;
    let layout = Layout::new(&picture.outline_mm, options.width_px)?;
    let mut canvas = Canvas::new(options.width_px, layout.height, BACKGROUND)?;
    let field = Field::new(&picture.grid, &picture.values);
    let needed = || greatest(&field, &picture.grid).max(picture.greatest_rise());
    let full = options.full_scale.unwrap_or_else(|| needed().max(options.floor));
    let full = if full.is_finite() && full > 0.0 {
        full
    } else {
        SCALE_FLOOR
    };
    sheet::draw_sheet(
        &mut canvas,
        &layout,
        &picture.outline_mm,
        &picture.electrodes_mm,
        |p| field.at(p[0], p[1]) / full,
        options.palette,
    );
    let faulty = &picture.stats.faulty;
    sheet::draw_faulty(
        &mut canvas,
        &layout,
        &picture.outline_mm,
        &picture.electrodes_mm,
        faulty,
    );
    let marks = sheet::electrode_marks(&layout, &picture.outline_mm, &picture.electrodes_mm);
    sheet::draw_touches(&mut canvas, &layout, &picture.strongest_first(), &marks);
    let top = f64::from(full);
    let title = if picture.stats.smoothed {
        "smoothed change"
    } else {
        "change"
    };
    sheet::draw_bar(&mut canvas, &layout, options.palette, title, [0.0, top], |v| {
        format!("{} %", trimmed(100.0 * v))
    });
    sheet::draw_scale(&mut canvas, &layout);
    draw_lines(&mut canvas, &layout, picture);
    Ok(canvas)
}

/// The title and the line at the bottom.
fn draw_lines(canvas: &mut Canvas, layout: &Layout, picture: &Picture) {
    let (size, stats) = (layout.text, &picture.stats);
    let right = canvas.width() as f32 - size;
    let count = match picture.touches.len() {
        0 => "no touch".to_owned(),
        1 => "1 touch".to_owned(),
        n => format!("{n} touches"),
    };
    canvas.text(
        size,
        2.0 * size,
        1.15 * size,
        Align::Start,
        TEXT,
        &format!("{count}  ·  {}", stats.source),
    );
    let frame = format!("frame {}  ·  {:.2} s", picture.sequence, picture.time_s);
    canvas.text(right, 2.0 * size, 0.9 * size, Align::End, FAINT, &frame);
    let foot = layout.height as f32 - 0.6 * size;
    if let Some(status) = &stats.status {
        canvas.text(right, foot, size, Align::End, WARN, status);
        return;
    }
    let mut parts = vec![format!("{:.0} frames/s", stats.frames_per_s)];
    parts.extend(stats.solve_us.map(|us| format!("solved in {us:.0} µs")));
    parts.extend(stats.residual.map(|r| format!("residual {:.1} %", 100.0 * r)));
    canvas.text(right, foot, 0.85 * size, Align::End, FAINT, &parts.join("  ·  "));
}

fn greatest(field: &Field, grid: &Grid) -> f32 {
    grid.centres_mm().map(|p| field.at(p[0], p[1])).fold(0.0, f32::max)
}

/// A number with as many decimals as a scale needs.
fn trimmed(v: f64) -> String {
    let text = format!("{v:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
#[path = "png_tests.rs"]
mod tests;
