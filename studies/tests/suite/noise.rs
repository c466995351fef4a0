//! A pattern without reciprocal pairs tells the noise as well.

use forward::{DiscTouch, Drive, Pattern, Sheet};
use inverse::reference::imager::Imager;
use inverse::reference::noise::NoiseSource;
use std::sync::Arc;
use studies::{TestSheet, noise_v, noisy, rng};

fn finger(x: f64, y: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: [x, y],
        radius_mm: 12.5,
        rise: 0.2,
    }
}

/// Opposite drive and adjacent sense, one frame as the baseline. The estimate is that of the noise within a factor of two, and
/// touches are fitted as well as with reciprocal pairs.
#[test]
fn touches_are_fitted_without_reciprocal_pairs() {
    let pattern = Pattern::rotating(16, 8, 1).unwrap();
    assert!(pattern.reciprocal_indices().iter().all(Option::is_none));
    let imager = Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 5.0).unwrap());
    let mut rng = rng(111);
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let mut reconstructor = sheet.reconstructor().unwrap();
    for touches in [
        vec![finger(40.0, 10.0)],
        vec![finger(-30.0, 45.0), finger(20.0, -50.0)],
        vec![finger(70.0, 0.0), finger(-40.0, 0.0), finger(0.0, 60.0)],
    ] {
        let clean = sheet.clean_frame(&touches).unwrap();
        let sigma = noise_v(&clean, &sheet.baseline.clone(), 27.0);
        for _ in 0..8 {
            let found = reconstructor.frame(&noisy(clean.clone(), sigma, &mut rng)).unwrap();
            let noise = found.noise.unwrap();
            assert!(matches!(noise.source, NoiseSource::Residual { .. }));
            assert!((0.5..2.0).contains(&(noise.sigma / sigma)), "{} {sigma}", noise.sigma);
            assert_eq!(found.touches.len(), touches.len(), "{:?}", found.touches);
            assert!(
                found.misfit.is_some() && found.doubt.is_none(),
                "{:?} {:?} {}",
                found.misfit,
                found.doubt,
                noise.sigma / sigma
            );
            for t in &touches {
                let off = |f: &inverse::touches::touch::Touch| (f.x_mm - t.centre_mm[0]).hypot(f.y_mm - t.centre_mm[1]);
                let near = found.touches.iter().map(off).fold(f64::INFINITY, f64::min);
                assert!(near < 1.0, "{near} mm: {:?}", found.touches);
            }
        }
    }
    // An empty frame shows nothing.
    let sigma = noise_v(
        &sheet.clean_frame(&[finger(48.0, 0.0)]).unwrap(),
        &sheet.baseline.clone(),
        27.0,
    );
    for _ in 0..20 {
        let frame = noisy(sheet.baseline.clone(), sigma, &mut rng);
        assert!(reconstructor.frame(&frame).unwrap().touches.is_empty());
    }
}
