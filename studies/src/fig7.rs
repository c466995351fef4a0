//! The picture of one frame by every method (the paper's Fig. 7). The generalised inverse fails where non-negative
//! least squares works.

use crate::paper::PaperError;
use crate::scene::{Kind, Scene, rng};
use crate::test_sheet::{TestSheet, imager, imager_for};
use ::forward::Drive;
use inverse::pipeline::{Reconstructor, ReconstructorOptions};
use inverse::reference::Reference;
use inverse::reference::imager::Imager;
use inverse::reference::noise::FrameNoise;
use inverse::solvers::Method;
use std::path::Path;
use view::canvas::{Align, Canvas, Ink};
use view::field::Field;
use view::palette::Palette;
use view::sheet::{self, BACKGROUND, FAINT, Layout, TEXT};
use view::surface::grid_of;

const PANEL_PX: u32 = 520;
const COLUMNS: u32 = 3;
/// The panels beside the truth.
const PANELS: [(Method, f64, &str); 5] = [
    (Method::PseudoInverse, 20.0, "generalised inverse, 20 mm cells"),
    (Method::PseudoInverse, 5.0, "generalised inverse, 5 mm cells"),
    (Method::LawsonHanson, 20.0, "Lawson-Hanson, 20 mm cells (the paper)"),
    (Method::Tikhonov, 5.0, "Tikhonov, 5 mm cells"),
    (Method::Nnls, 5.0, "nnls, 5 mm cells, fitted"),
];

/// Draws three touches of 25 mm and +20 % at 27 dB by every method.
///
/// # Errors
/// Where the sheet cannot be modelled or the file not be written.
pub fn write(drive: Drive, seed: u64, path: &Path) -> Result<(), PaperError> {
    let mut rng = rng(seed);
    let fine = imager(drive, 5.0)?;
    let mut sheet = TestSheet::new(&fine, drive, 0.0, 0.0, &mut rng)?;
    let scene = Kind::Equal(3).scene(&mut rng, 27.0);
    let frame = sheet.frame(&scene, &mut rng)?;
    let inside = |p: [f64; 2]| {
        let hit = scene.touches.iter().filter(|t| {
            let [x, y] = t.centre_mm;
            (p[0] - x).hypot(p[1] - y) < t.radius_mm
        });
        hit.map(|t| t.rise).sum::<f64>()
    };
    let mut panels = vec![panel(
        &fine,
        "pressed: three discs of 25 mm, +20 %",
        &scene,
        0.2,
        false,
        inside,
    )?];
    for (method, cell_mm, title) in PANELS {
        let imager = imager_for(method, drive, cell_mm)?;
        let reference = Reference::new(imager.clone(), sheet.baseline.clone(), FrameNoise::Unknown)?;
        let mut r = Reconstructor::new(reference, ReconstructorOptions::for_imager(&imager, method));
        let found = r.frame(&frame)?;
        let values: Vec<f32> = found.x.iter().map(|x| *x as f32).collect();
        let field = Field::new(grid_of(&imager)?.as_ref(), &values);
        let centres = (0..imager.grid.len()).map(|k| imager.grid.centre(k));
        let largest = centres.map(|p| field.at(p[0], p[1]).abs()).fold(0.0, f32::max);
        let signed = found.x.iter().any(|x| *x < 0.0);
        let full = f64::from(largest);
        let mut canvas = panel(&imager, title, &scene, full, signed, |p| {
            f64::from(field.at(p[0], p[1]))
        })?;
        let note = match method {
            Method::Nnls => format!("{} touches found", found.touches.len()),
            _ => format!("{} peaks found", found.touches.len()),
        };
        foot(&mut canvas, &note);
        panels.push(canvas);
    }
    let (width, height) = (panels[0].width(), panels[0].height());
    let rows = (panels.len() as u32).div_ceil(COLUMNS);
    let mut whole = Canvas::new(width * COLUMNS, height * rows, BACKGROUND)?;
    for (k, panel) in panels.iter().enumerate() {
        let (left, top) = ((k as u32 % COLUMNS) * width, (k as u32 / COLUMNS) * height);
        let (l, t) = (left as f32, top as f32);
        let corners = [
            [l, t],
            [l + width as f32, t],
            [l + width as f32, t + height as f32],
            [l, t + height as f32],
        ];
        let inside = |x: f32, y: f32| panel.pixel((x - l) as u32, (y - t) as u32);
        whole.shade(&corners, |x, y| inside(x, y).unwrap_or(BACKGROUND));
    }
    // The error already names the file and the cause.
    Ok(whole.write_png(path)?)
}

fn foot(canvas: &mut Canvas, text: &str) {
    let (x, y) = (canvas.width() as f32 - 12.0, canvas.height() as f32 - 10.0);
    canvas.text(x, y, 13.0, Align::End, FAINT, text);
}

/// One panel: a map over the sheet with a scale of its own, and rings where it was pressed.
fn panel(
    imager: &Imager,
    title: &str,
    scene: &Scene,
    full: f64,
    signed: bool,
    value: impl Fn([f64; 2]) -> f64,
) -> Result<Canvas, PaperError> {
    let layout = Layout::new(&imager.outline_mm, PANEL_PX)?;
    let mut canvas = Canvas::new(PANEL_PX, layout.height, BACKGROUND)?;
    let full = if full > 0.0 { full } else { 1.0 };
    let (palette, low) = if signed {
        (Palette::Diverging, -full)
    } else {
        (Palette::Inferno, 0.0)
    };
    let part = |p: [f64; 2]| ((value(p) - low) / (full - low)) as f32;
    sheet::draw_sheet(
        &mut canvas,
        &layout,
        &imager.outline_mm,
        &imager.electrodes_mm,
        part,
        palette,
    );
    for t in &scene.touches {
        let [x, y] = layout.to_px(t.centre_mm);
        let radius = (t.radius_mm * layout.px_per_mm()) as f32;
        canvas.ring(x, y, radius, 3.0, Ink([0; 3], 0.6));
        canvas.ring(x, y, radius, 1.5, Ink([255; 3], 0.9));
    }
    sheet::draw_bar(&mut canvas, &layout, palette, "rise", [low, full], |v| {
        format!("{:.0} %", 100.0 * v)
    });
    canvas.text(
        layout.text,
        2.0 * layout.text,
        1.2 * layout.text,
        Align::Start,
        TEXT,
        title,
    );
    Ok(canvas)
}
