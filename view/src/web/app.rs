//! What all that serves a connection knows.

use std::sync::Arc;

use tokio::sync::{OwnedSemaphorePermit, watch};

use crate::web::Shared;

/// What a connection's requests share.
#[derive(Clone)]
pub(super) struct App {
    /// Of the page that is asked for; the first one until that is known.
    pub(super) shared: Arc<Shared>,
    /// Of all pages.
    pub(super) pages: Arc<[Arc<Shared>]>,
    pub(super) stopped: watch::Receiver<bool>,
    /// The place of the connection, free again when the last copy is dropped.
    pub(super) place: Arc<OwnedSemaphorePermit>,
}

impl App {
    /// The same for a page.
    pub(super) fn of(mut self, page: usize) -> Self {
        if let Some(shared) = self.pages.get(page) {
            self.shared = Arc::clone(shared);
        }
        self
    }
}

/// Returns once the server is to stop.
pub(super) async fn ended(mut stopped: watch::Receiver<bool>) {
    // An error means that the sender is gone, which is an end as well.
    let _ = stopped.wait_for(|stop| *stop).await;
}
