//! Text as filled outlines, from a font inside the program: the same bytes on every machine.

use tiny_skia::{Path, PathBuilder};
use ttf_parser::{Face, OutlineBuilder};

/// A font that can be drawn at any size.
pub struct Font {
    face: Face<'static>,
}

impl Font {
    /// The regular sans-serif face; none only if the font inside the program were damaged.
    pub fn sans() -> Option<Self> {
        Face::parse(dejavu::sans::regular(), 0).ok().map(|face| Self { face })
    }

    /// Width of a line of text at a size in px, px.
    pub fn width(&self, text: &str, size: f32) -> f32 {
        let advance = |c: char| {
            self.face
                .glyph_index(c)
                .and_then(|g| self.face.glyph_hor_advance(g))
                .unwrap_or(0)
        };
        text.chars().map(|c| f32::from(advance(c))).sum::<f32>() * self.scale(size)
    }

    /// The outline of a line of text that starts at `x` on the baseline `y`; px, y down. None if nothing is to be drawn.
    pub fn outline(&self, text: &str, x: f32, y: f32, size: f32) -> Option<Path> {
        let mut pen = Pen {
            path: PathBuilder::new(),
            x,
            y,
            scale: self.scale(size),
        };
        for glyph in text.chars().filter_map(|c| self.face.glyph_index(c)) {
            self.face.outline_glyph(glyph, &mut pen);
            pen.x += f32::from(self.face.glyph_hor_advance(glyph).unwrap_or(0)) * pen.scale;
        }
        pen.path.finish()
    }

    fn scale(&self, size: f32) -> f32 {
        size / f32::from(self.face.units_per_em().max(1))
    }
}

/// Draws glyphs into a path at a place and a scale.
struct Pen {
    path: PathBuilder,
    x: f32,
    y: f32,
    scale: f32,
}

impl Pen {
    fn at(&self, x: f32, y: f32) -> (f32, f32) {
        (self.x + x * self.scale, self.y - y * self.scale)
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.at(x1, y1), self.at(x, y));
        self.path.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sign_used_in_images_is_in_the_font() {
        let font = Font::sans().unwrap();
        for sign in "0123456789+\u{2212}-.,% mm²µΩ×ρσ°".chars() {
            assert!(font.face.glyph_index(sign).is_some(), "{sign}");
        }
    }

    #[test]
    fn width_follows_size_and_length() {
        let font = Font::sans().unwrap();
        assert!((font.width("12.3", 20.0) - 2.0 * font.width("12.3", 10.0)).abs() < 1e-4);
        let path = font.outline("12.3", 5.0, 30.0, 20.0).unwrap();
        let bounds = path.bounds();
        assert!(bounds.left() >= 5.0 && bounds.right() <= 5.0 + font.width("12.3", 20.0));
        assert!(bounds.bottom() < 35.0 && bounds.top() > 10.0);
        assert!(font.outline("  ", 0.0, 0.0, 12.0).is_none());
    }
}
