//! The newest picture as a PNG, drawn once for all who ask.

use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::body::Bytes;
use tokio::sync::Mutex;

use crate::canvas::ImageError;
use crate::picture::Picture;
use crate::png;
use crate::web::Shared;

/// Width of the picture, pixels.
const WIDTH_PX: u32 = 1200;

/// Askers are answered in turns, with so long between them.
const PAUSE: Duration = Duration::from_millis(250);

/// And so many times as long as a drawing took: askers cost a fifth of one processor, however many they are, however quickly they ask
/// again, and however slow the machine.
const PAUSE_DRAWINGS: u32 = 4;

/// A picture that was drawn.
struct Drawing {
    of: Arc<Picture>,
    png: Bytes,
    /// The turn in which it was given last: all who asked before it began are given this.
    begun: Instant,
    ended: Instant,
}

/// The last drawing. Whoever waits for the lock waits for the turn that goes on.
#[derive(Default)]
pub(super) struct Drawn {
    last: Mutex<Option<Drawing>>,
    #[cfg(test)]
    pub(super) count: std::sync::atomic::AtomicUsize,
}

/// A picture as a PNG that was the newest after somebody asked; none if there is no picture yet. To be run to its end, even if the asker
/// has gone: else its drawing would serve nobody.
///
/// # Errors
/// It cannot be drawn.
pub(super) async fn newest(shared: Arc<Shared>) -> Result<Option<Bytes>, String> {
    let asked = Instant::now();
    let mut last = shared.drawn.last.lock().await;
    if let Some(drawing) = &*last {
        if drawing.begun >= asked {
            return Ok(Some(drawing.png.clone()));
        }
        let pause = PAUSE.max(PAUSE_DRAWINGS * (drawing.ended - drawing.begun));
        tokio::time::sleep(pause.saturating_sub(drawing.ended.elapsed())).await;
    }
    let begun = Instant::now();
    let Some(newest) = shared.latest.borrow().as_ref().map(|l| Arc::clone(&l.picture)) else {
        return Ok(None);
    };
    let png = match &*last {
        Some(drawing) if Arc::ptr_eq(&drawing.of, &newest) => drawing.png.clone(),
        _ => {
            #[cfg(test)]
            shared.drawn.count.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            draw(Arc::clone(&newest)).await?
        }
    };
    *last = Some(Drawing {
        of: newest,
        png: png.clone(),
        begun,
        ended: Instant::now(),
    });
    Ok(Some(png))
}

async fn draw(picture: Arc<Picture>) -> Result<Bytes, String> {
    let draw = move || {
        let mut bytes = Vec::new();
        png::render(&picture, WIDTH_PX)?.encode_png(&mut bytes)?;
        Ok::<_, ImageError>(Bytes::from(bytes))
    };
    let drawn = tokio::task::spawn_blocking(draw).await;
    drawn
        .map_err(|_| "the picture could not be drawn")?
        .map_err(|e| e.to_string())
}
