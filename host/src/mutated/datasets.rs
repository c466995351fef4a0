//! Distributions of scenes that `skin dataset` draws from.

use super::{feed, utf8};
use ::forward::Sheet;
use studies::dataset::{Dataset, DatasetFile};

/// A shard of more is not made: it takes as long as was asked for.
const MOST_FRAMES: u64 = 20;

const FEW: &str = "frames_per_sheet = 3\nbaseline_frames = 2\n[sheet]\nresistivity_sd = 0.05\ncontact_mm = { uniform = [1, 2] }\n\
                   [touch]\ncount = [0, 1, 1]\nrise = { normal = [0.2, 0.05] }\n[board]\nsamples = true\n[[fault]]\n\
                   kind = \"contact_raised\"\nchance = 0.5\nohm = 100\n";

#[test]
fn mutated_scenes_of_datasets() {
    // As the example, without its remarks: what is changed there changes nothing.
    let example = include_str!("../../../studies/scenes/touches.toml");
    let lines = example
        .lines()
        .map(|line| line.split('#').next().unwrap_or_default().trim_end());
    let example = lines.collect::<Vec<_>>().join("\n");
    // Few frames of few electrodes: every key is read, and a shard is made in milliseconds.
    let example = example.replace("= 1000\n", "= 3\n").replace("= 24\n", "= 2\n");
    let sheet = Sheet::disc(100.0, 4, 30.0, 1.0, 1000.0);
    feed(
        "scenes of a dataset",
        &[example.into_bytes(), FEW.into()],
        true,
        |bytes| {
            let Ok(file) = toml::from_str::<DatasetFile>(utf8(bytes)) else {
                return false;
            };
            let Ok(dataset) = Dataset::new(file, sheet.clone()) else {
                return false;
            };
            let file = dataset.file();
            if (file.frames_per_sheet + file.baseline_frames) * file.sheets_per_shard > MOST_FRAMES {
                return true;
            }
            let Ok(shard) = dataset.shard(0) else {
                return false;
            };
            for row in &shard.rows {
                // A value that is none is one that the converter clipped.
                assert!(row.values_v.iter().all(|v| !v.is_infinite()));
                assert!(row.noise_v.is_finite() && row.resistance.is_finite());
                let numbers = row
                    .touches
                    .iter()
                    .flat_map(|t| [t.centre_mm[0], t.centre_mm[1], t.radius_mm, t.rise]);
                assert!(numbers.into_iter().all(f64::is_finite));
            }
            true
        },
    );
}
