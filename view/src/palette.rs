//! Colour maps as tables of 256 colours.

/// A colour, 8 bits each of red, green and blue.
pub type Rgb = [u8; 3];

/// A colour map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Palette {
    /// Black over red to pale yellow, lightness rising evenly: the default.
    #[default]
    Inferno,
    /// Blue over green to yellow, lightness rising evenly; for readers who confuse red and green, and for print.
    Viridis,
    /// Black to white.
    Grey,
    /// Blue over white to red, for values of both signs; 0.5 is zero.
    Diverging,
}

impl Palette {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Inferno, Self::Viridis, Self::Grey, Self::Diverging];

    /// Its name, in lower case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Inferno => "inferno",
            Self::Viridis => "viridis",
            Self::Grey => "grey",
            Self::Diverging => "diverging",
        }
    }

    /// Its 256 colours, from 0 to 1.
    pub fn table(self) -> [Rgb; 256] {
        let colour = |k: usize| {
            let t = k as f64 / 255.0;
            match self {
                Self::Inferno => rgb(colorous::INFERNO.eval_continuous(t)),
                Self::Viridis => rgb(colorous::VIRIDIS.eval_continuous(t)),
                Self::Grey => [k as u8; 3],
                Self::Diverging => rgb(colorous::RED_BLUE.eval_continuous(1.0 - t)),
            }
        };
        std::array::from_fn(colour)
    }

    /// The colour at `t`, which is limited to 0..1; not-a-number is 0.
    pub fn at(self, t: f64) -> Rgb {
        self.table()[index(t as f32)]
    }
}

/// The entry of a table of 256 for `t`, limited to 0..1; not-a-number is 0.
pub fn index(t: f32) -> usize {
    (t.clamp(0.0, 1.0) * 255.0 + 0.5) as usize
}

fn rgb(colour: colorous::Color) -> Rgb {
    [colour.r, colour.g, colour.b]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance of an sRGB colour (IEC 61966-2-1).
    fn luminance(colour: Rgb) -> f64 {
        let linear = colour.map(|v| {
            let v = f64::from(v) / 255.0;
            if v <= 0.04045 {
                v / 12.92
            } else {
                ((v + 0.055) / 1.055).powf(2.4)
            }
        });
        0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    }

    #[test]
    fn sequential_maps_grow_lighter_all_the_way() {
        for palette in [Palette::Inferno, Palette::Viridis, Palette::Grey] {
            let light = palette.table().map(luminance);
            // 8-bit rounding of one channel moves the luminance by up to 0.007.
            assert!(light.windows(2).all(|w| w[1] > w[0] - 0.004), "{}", palette.name());
            assert!(light[255] - light[0] > 0.6);
        }
    }

    #[test]
    fn diverging_is_blue_white_red() {
        let [low, middle, high] = [0.0, 0.5, 1.0].map(|t| Palette::Diverging.at(t));
        assert!(low[2] > low[0] && high[0] > high[2]);
        assert!(middle.iter().all(|&v| v > 235), "{middle:?}");
    }

    #[test]
    fn out_of_range_is_limited() {
        assert_eq!([index(f32::NAN), index(-1.0), index(2.0)], [0, 0, 255]);
    }
}
