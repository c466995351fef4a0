//! Connections to the server: so many and no more, and none that keeps its place without asking for anything.

use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};
use tokio::time::{sleep, timeout};

use crate::web::app::{App, ended};
use crate::web::refused::Refused;
use crate::web::{FAREWELL, Shared};

/// Most connections at once.
pub(super) const MOST: usize = 64;

/// A connection waits for a place so long: longer than most requests take.
const PLACE_WAIT: Duration = Duration::from_secs(2);

/// A request's header has to come in so long, and a connection without a request is closed after it.
pub(super) const HEADER_WAIT: Duration = Duration::from_secs(5);

/// Requests over one connection are served for so long; a page that is shown live is no request any more.
const OLDEST: Duration = Duration::from_secs(30);

/// Most of a request's header that is taken, bytes. Cookies of all programs on this computer are in it.
const HEADER: usize = 64 * 1024;

/// No place was free.
const FULL: &[u8] =
    b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nCross-Origin-Resource-Policy: same-origin\r\n\
    Content-Type: text/plain; charset=utf-8\r\nContent-Length: 67\r\n\r\n\
    this page is open too often (64 connections); close it where it is\n";

/// Serves connections until the server stops; then gives them a little time to end.
pub(super) async fn serve(
    listener: TcpListener,
    router: Router<App>,
    pages: Arc<[Arc<Shared>]>,
    stopped: watch::Receiver<bool>,
) {
    let Some(first) = pages.first() else { return };
    let places = Arc::new(Semaphore::new(MOST));
    let mut stop = pin!(ended(stopped.clone()));
    loop {
        let stream = tokio::select! {
            biased;
            () = &mut stop => break,
            accepted = listener.accept() => match accepted {
                Ok((stream, _)) => stream,
                Err(error) => {
                    tracing::debug!("no connection to the page: {error}");
                    // Perhaps there are too many open files. Others end.
                    sleep(PLACE_WAIT).await;
                    continue;
                }
            },
        };
        let Ok(Ok(place)) = timeout(PLACE_WAIT, Arc::clone(&places).acquire_owned()).await else {
            first.refused.count(Refused::Connection);
            refuse(stream);
            continue;
        };
        let app = App {
            shared: Arc::clone(first),
            pages: Arc::clone(&pages),
            stopped: stopped.clone(),
            place: Arc::new(place),
        };
        tokio::spawn(attend(stream, router.clone().with_state(app), stopped.clone()));
    }
    // Once all places are free nobody is served any more.
    let _ = timeout(FAREWELL, places.acquire_many(MOST as u32)).await;
}

/// Serves a connection until it ends, or becomes a page that is shown live.
async fn attend(stream: TcpStream, router: Router, stopped: watch::Receiver<bool>) {
    // Answers are short, and are to leave at once.
    let _ = stream.set_nodelay(true);
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new())
        .header_read_timeout(HEADER_WAIT)
        .max_buf_size(HEADER);
    let connection = http.serve_connection(TokioIo::new(stream), TowerToHyperService::new(router));
    let mut connection = pin!(connection.with_upgrades());
    let outcome = tokio::select! {
        outcome = &mut connection => Ok(outcome),
        () = async { tokio::select! { () = sleep(OLDEST) => {}, () = ended(stopped) => {} } } => {
            connection.as_mut().graceful_shutdown();
            timeout(HEADER_WAIT, connection).await
        }
    };
    if !matches!(outcome, Ok(Ok(()))) {
        tracing::debug!("a connection was ended: {outcome:?}");
    }
}

/// Says that there are too many, without waiting for anything.
fn refuse(stream: TcpStream) {
    use std::io::{Read, Write};
    if let Ok(mut stream) = stream.into_std() {
        // What was not read would take the answer with it.
        let _ = stream.read(&mut [0; 4096]);
        let _ = stream.write(FULL);
    }
}
